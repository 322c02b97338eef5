"""Stopwatches on one thread: single calls as an optimiser makes them, and one call for all poses."""

from __future__ import annotations

import time
from collections.abc import Callable

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.workflow.benchmark.candidate import Stopwatch
from casadi_contact.workflow.benchmark.timing import one_thread, time_batch, time_single_calls


def single_calls(call: Callable[[Array], object]) -> Stopwatch:
    """Seconds per pose of call(pose (6,)), one pose after the other."""

    def measure(poses: Array) -> float:
        with one_thread():
            start = time.perf_counter()
            for pose in poses:
                call(pose)
            return (time.perf_counter() - start) / len(poses)

    return measure


def one_call(model: Callable[[Array], object]) -> Stopwatch:
    """Seconds per pose of model(poses (n, 6))."""

    def measure(poses: Array) -> float:
        with one_thread():
            return time_batch(model, poses)

    return measure


def casadi_calls(function: ca.Function, *others: Array) -> Stopwatch:
    """Seconds per pose of function(pose, *others), called through its buffer; the others stay as they are."""
    constants = [np.ascontiguousarray(value, dtype=float) for value in others]

    def measure(poses: Array) -> float:
        with one_thread():
            return time_single_calls(function, poses, *constants)

    return measure
