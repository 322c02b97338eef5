"""Fit on ever more points until budget or memory ends: how far do methods come whose cost grows as n² and n³?"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import numpy as np

from casadi_contact.workflow.benchmark.candidate import Candidate

GIB = 2.0**30


def physical_bytes() -> float:
    """Memory of this machine, infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return float("inf")


def grow(
    fit: Callable[[int], Candidate],
    *,
    family: str,
    points: int,
    gflop: float,
    gflop_of: Callable[[int], float],
    bytes_per_pair: float,
    first: int = 1000,
    memory: float | None = None,
) -> Iterator[Candidate]:
    """fit(n) for n = first, 2·first, ... up to all points, each a candidate of its own.

    gflop_of(n): 10⁹ floating-point operations of fit(n). A size is tried only if half of the memory holds its n²
    pairs and, after the first, if it fits in what is left of the budget. What ends the growth stays as a candidate
    with the failure's text.
    """
    memory = physical_bytes() if memory is None else memory
    left = gflop
    count = min(first, points)
    while True:
        failure, needed = "", bytes_per_pair * count**2
        if needed > memory / 2:
            failure = f"needs about {needed / GIB:.1f} GiB, more than half of the {memory / GIB:.1f} GiB here"
        elif left < gflop and gflop_of(count) > left:
            failure = f"needs about {gflop_of(count):.3g} Gflop, {max(left, 0.0):.3g} of {gflop:.3g} are left"
        else:
            try:
                candidate = fit(count)
            except (np.linalg.LinAlgError, MemoryError) as error:
                failure = " ".join(str(error).split()) or type(error).__name__
            left -= gflop_of(count)
        if failure:
            yield Candidate(f"{family} {count}", family, None, samples=count, failure=failure)
            return
        yield candidate
        if count == points:
            return
        count = min(2 * count, points)
