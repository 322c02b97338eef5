"""Compiled functions over arrays of poses, on all cores (``c/arrays.h``)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numba
import numpy as np

from casadi_contact.conventions import Array

_LEAST = 256  # poses that make another thread worth its start
_SHARES = 8  # of each thread: those that finish early take over
_MULTIPLE = 64  # of the poses of a share: no block of lanes is cut


@cache
def loaded(path: Path) -> ctypes.CDLL:
    """The shared library, loaded once: objects keep its path, so that they can be sent to other processes."""
    return ctypes.CDLL(str(path))


def call_in_shares(
    library: Path, function: str, poses: Array, *arrays: np.ndarray | None, constants: Sequence[np.ndarray] = ()
) -> None:
    """Call function(n, poses, *arrays, *constants) of a library on shares of the rows, on as many threads as numba has.

    Every array has a row for each pose; None is passed on as 0. Constants are passed on whole.
    """
    entry = getattr(loaded(library), function)
    threads = max(1, min(numba.get_num_threads(), len(poses) // _LEAST))
    size = len(poses) if threads == 1 else -(-len(poses) // (_SHARES * threads * _MULTIPLE)) * _MULTIPLE

    whole = [constant.ctypes.data_as(ctypes.c_void_p) for constant in constants]

    def one(start: int) -> None:
        part = slice(start, start + size)
        pointers = [None if a is None else a[part].ctypes.data_as(ctypes.c_void_p) for a in (poses, *arrays)]
        entry(ctypes.c_longlong(len(poses[part])), *pointers, *whole)

    starts = range(0, len(poses), max(size, 1))
    if threads == 1:
        for start in starts:
            one(start)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, starts))
