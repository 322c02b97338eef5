"""NumPy over many poses: in blocks whose intermediate arrays fit a core's cache, on as many threads as numba has."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar, cast

import numba
import numpy as np

from casadi_contact.core.conventions import Array

_ROWS = 2000  # whatever the number of threads, so that this does not change a bit of the results
_Arrays = TypeVar("_Arrays", bound=Array | tuple[Array, ...])


def in_blocks(function: Callable[[Array], _Arrays], poses: Array) -> _Arrays:
    """What a function of poses (n, 6) returns, an array (n, ...) or a tuple of such, from blocks of the poses."""
    if len(poses) <= _ROWS:
        return function(poses)
    blocks = [poses[first : first + _ROWS] for first in range(0, len(poses), _ROWS)]
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        found = list(pool.map(function, blocks))
    if isinstance(found[0], tuple):
        return cast(_Arrays, tuple(np.concatenate(parts) for parts in zip(*found, strict=True)))
    return cast(_Arrays, np.concatenate(found))
