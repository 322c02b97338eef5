"""Kernels of the shipped knees beside that of version 0.1 and the fastest untrained model, in turn in one run:

    python -m tests.benchmarks.bench_versions [surrogate.h5 ...]

"in C": poses one after the other in a loop in C. "called": single buffered calls of CasADi, as an optimiser makes them.
A surrogate of another ready scene, such as a planar knee, is asked for its own loads at the poses of its own motion.
"""

from __future__ import annotations

import ctypes
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.core.compiler import machine_flags, shared_library
from casadi_contact.core.conventions import Array
from casadi_contact.core.machine import machine_record
from casadi_contact.core.workers import one_thread
from casadi_contact.networks.kernel.casadi_interface import casadi_interface
from casadi_contact.workflow.benchmark.timing import compare, time_single_calls
from casadi_contact.workflow.project import Project, available_motion

VERSION_0_1 = Path(__file__).with_name("knee_0_1.c")
_LOOP = """
void values(long long n, const double *poses, double *loads) {
  for (long long i = 0; i < n; i++) guarded_value(poses + 6 * i, loads + LOADS * i, 0);
}
"""


def in_c(source: str, loads: int, poses: Array) -> Callable[[], float]:
    """Measures the seconds per pose of a kernel's C in a loop."""
    library = ctypes.CDLL(str(shared_library(source + _LOOP)))
    out = np.empty((len(poses), loads))

    def measure() -> float:
        start = time.perf_counter()
        library.values(ctypes.c_longlong(len(poses)), *(a.ctypes.data_as(ctypes.c_void_p) for a in (poses, out)))
        return (time.perf_counter() - start) / len(poses)

    return measure


def _poses(scene: str) -> Array:
    """Five cycles of a ready scene's own motion."""
    with tempfile.TemporaryDirectory() as folder:
        motion = available_motion(Project.open(scene, "quick", Path(folder)))
    return np.ascontiguousarray(motion.poses.reshape(-1, 6)[:505])


def main(names: list[str]) -> None:
    """Print a line for each kernel."""
    poses = _poses("knee")
    old = VERSION_0_1.read_text("utf-8")
    measurements = {"version 0.1, in C": in_c(old, 7, poses)}
    called = casadi_interface({"old": {"loads": 7}})
    external = ca.external("old", str(shared_library(f"{old}\n{called}")))
    measurements["version 0.1, called"] = partial(time_single_calls, external, poses)
    for name in names:
        surrogate = cc.load_surrogate(name)
        count, own = len(surrogate.load_names), _poses(surrogate.scene.name)
        source = surrogate._kernel(surrogate.load_names, roots=False).source(loads=count, roots=0)  # that of `function`
        measurements[f"{name}, in C"] = in_c(source, count, own)
        measurements[f"{name}, called"] = partial(time_single_calls, surrogate.function(compiled=True), own)
    measurements["cc.foundation, called"] = partial(time_single_calls, cc.foundation("knee").function(), poses)
    with one_thread():
        timings = compare(measurements, repeats=31)
    print(machine_record(), " ".join(machine_flags()))
    for name, timing in timings.items():
        first = timings[f"version 0.1, {name.rpartition(', ')[2]}"]
        ratio = timing.low_us / first.low_us
        print(f"{name:28s} median {timing.median_us:.3f} µs, least {timing.low_us:.3f}, {ratio:.2f} of version 0.1's")


if __name__ == "__main__":
    main(sys.argv[1:] or ["knee"])
