"""Threads of this process: shares of the rows of an array, one after the other or side by side.

They are made for each call and gone after it, so that a process may be forked between calls; threads of OpenMP, which
stay, hang in the fork.
"""

import ctypes
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np

from casadi_contact.core.conventions import Array

Result = TypeVar("Result")
THREADS_VARIABLE = "NUMBA_NUM_THREADS"
SHARES_OF_A_THREAD = 8
_most: ContextVar[int | None] = ContextVar("most threads", default=None)


def thread_count() -> int:
    """Threads that a call may take: $NUMBA_NUM_THREADS, or one for each core that this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return _most.get() or int(os.environ.get(THREADS_VARIABLE) or cores)


@contextmanager
def at_most_threads(count: int) -> Iterator[None]:
    """Calls of the block take no more threads."""
    token = _most.set(count)
    try:
        yield
    finally:
        _most.reset(token)


def in_shares(
    rows: int, work: Callable[[slice], Result], *, rows_of_a_thread: int = 256, multiple: int = 64
) -> list[Result]:
    """Results of ``work(slice)`` for consecutive shares of the rows, in order, evaluated on several threads; work must
    release Python's lock. Each thread gets at least rows_of_a_thread rows, since threads cost more than they gain on
    few. There are several shares for a thread, so that fast threads take over from slow ones; a share is a multiple of
    a kernel's lanes."""
    threads = min(thread_count(), rows // rows_of_a_thread)
    if threads < 2:
        return [work(slice(0, rows))]
    size = -(-rows // (SHARES_OF_A_THREAD * threads * multiple)) * multiple
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, (slice(start, start + size) for start in range(0, rows, size))))


@cache
def loaded(path: Path) -> ctypes.CDLL:
    """The shared library, loaded once: objects keep its path, so that they can be sent to other processes."""
    return ctypes.CDLL(str(path))


def call_in_shares(library: Path, function: str, poses: Array, *arrays: np.ndarray | None) -> None:
    """Call function(n, poses, *arrays) of a library on shares of the rows (see `in_shares`): every array has a row for
    each pose (None is passed on as 0)."""
    entry = getattr(loaded(library), function)

    def one(part: slice) -> None:
        pointers = [None if a is None else a[part].ctypes.data_as(ctypes.c_void_p) for a in (poses, *arrays)]
        entry(ctypes.c_longlong(len(poses[part])), *pointers)

    in_shares(len(poses), one)
