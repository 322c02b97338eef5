"""CPU time per evaluation, on which other programs tell least, measured several times in turn within one run."""

import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array

Name = TypeVar("Name", bound=Hashable)


@dataclass(frozen=True)
class Timing:
    """Microseconds per pose: median, lowest and highest of the repeated measurements."""

    median_us: float
    low_us: float
    high_us: float


def time_batch(evaluate: Callable[[Array], object], poses: Array) -> float:
    """CPU seconds per pose of one call with all poses."""
    start = time.process_time()
    evaluate(poses)
    return (time.process_time() - start) / len(poses)


def time_single_calls(function: ca.Function, poses: Array, *others: Array) -> float:
    """CPU seconds per call of a CasADi function (pose, *others) -> outputs, called pose by pose through its buffer.

    Includes the copy of each pose into the buffer, as a simulation would make it. Other arguments stay as given."""
    buffer, call = function.buffer()
    pose = np.zeros(poses.shape[1])
    view, rows = memoryview(pose), [memoryview(row) for row in np.ascontiguousarray(poses)]  # type: ignore[arg-type]
    outputs = [np.zeros(function.sparsity_out(i).nnz()) for i in range(function.n_out())]
    buffer.set_arg(0, view)  # type: ignore[call-arg, arg-type]
    for i, value in enumerate(others, start=1):
        buffer.set_arg(i, memoryview(value))  # type: ignore[call-arg, arg-type]
    for i, output in enumerate(outputs):
        buffer.set_res(i, memoryview(output))  # type: ignore[call-arg, arg-type]
    start = time.process_time()
    for row in rows:
        view[:] = row
        call()
    return (time.process_time() - start) / len(poses)


def time_mapped(mapped: ca.Function, poses: Array) -> float:
    """CPU seconds per pose of one buffered call of a CasADi function poses (6 x n) -> outputs, for n = len(poses)."""
    return time_single_calls(mapped, np.reshape(poses, (1, -1))) / len(poses)  # CasADi stores column after column


def compare(measurements: Mapping[Name, Callable[[], float]], repeats: int = 7) -> dict[Name, Timing]:
    """Run each measurement (which returns seconds per pose) once to warm up, then all in turn, `repeats` times."""
    for measure in measurements.values():
        measure()
    seconds: dict[Name, list[float]] = {name: [] for name in measurements}
    for _ in range(repeats):
        for name, measure in measurements.items():
            seconds[name].append(measure())
    us = {name: 1e6 * np.array(values) for name, values in seconds.items()}
    return {name: Timing(float(np.median(t)), float(t.min()), float(t.max())) for name, t in us.items()}


Stopwatch = Callable[[Array], float]
"""Poses (n, 6) -> CPU seconds per pose, on one thread."""
