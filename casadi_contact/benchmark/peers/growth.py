"""Fit on ever more points until time or memory ends: how far do methods come whose cost grows as n² and n³?"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator

import numpy as np

from casadi_contact.benchmark.candidate import Candidate

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
    seconds: float,
    bytes_per_pair: float,
    first: int = 1000,
    memory: float | None = None,
) -> Iterator[Candidate]:
    """fit(n) for n = first, 2·first, ... up to all points, each a candidate of its own.

    The next size is tried only if half of the memory holds its n² pairs and its time fits in what is left of the
    seconds. Its time is what the last two fits let expect, between n² and n³. What ends the growth stays as a
    candidate with the failure's text.
    """
    memory = physical_bytes() if memory is None else memory
    spent = took = 0.0
    factor = 8.0
    count = min(first, points)
    while True:
        failure, needed = "", bytes_per_pair * count**2
        if needed > memory / 2:
            failure = f"needs about {needed / GIB:.1f} GiB, more than half of the {memory / GIB:.1f} GiB here"
        elif spent and spent + factor * took > seconds:
            failure = f"needs about {factor * took:.0f} s, {max(seconds - spent, 0.0):.0f} of {seconds:.0f} s are left"
        else:
            before, began = took, time.perf_counter()
            try:
                candidate = fit(count)
            except (np.linalg.LinAlgError, MemoryError) as error:
                failure = " ".join(str(error).split()) or type(error).__name__
            took = time.perf_counter() - began
            spent += took
            factor = min(8.0, max(4.0, 1.3 * took / before)) if before else 8.0
        if failure:
            yield Candidate(f"{family} {count}", family, None, samples=count, failure=failure)
            return
        yield candidate
        if count == points:
            return
        count = min(2 * count, points)
