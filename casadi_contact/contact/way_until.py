"""The way until something holds: outwards in equal steps, then by bisection."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casadi_contact.conventions import Array

_BISECTIONS = 12


def way_until(holds: Callable[[np.ndarray, Array], np.ndarray], count: int, step: float, reach: float) -> Array:
    """Ways (count,) at which it begins to hold, to step/2^12; reach where it does not hold by then.

    holds(which (k,), ways (k,)): whether it does (k,), of those that are asked for by number. What holds for less than
    a step may be passed over. Raises what `holds` raises.
    """
    far, searching = np.zeros(count), np.arange(count)
    while len(searching):
        far[searching] = np.minimum(far[searching] + step, reach)
        searching = searching[~holds(searching, far[searching]) & (far[searching] < reach)]
    near, everyone = np.maximum(far - step, 0.0), np.arange(count)
    for _ in range(_BISECTIONS if count else 0):
        middle = 0.5 * (near + far)
        held = holds(everyone, middle)
        near, far = np.where(held, near, middle), np.where(held, middle, far)
    return far
