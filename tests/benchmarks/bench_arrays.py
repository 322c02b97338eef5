"""A million poses on all cores against the rate of one core, by the shipped knee and its foundation; run on demand:

python -m pytest -s tests/benchmarks/bench_arrays.py
"""

import time

import numba
import numpy as np
import pytest

import casadi_contact as cc

LEAST_SHARE = 0.8  # of cores times the rate of one


@pytest.fixture(scope="module")
def poses():
    low, high = np.array(list(cc.load_surrogate("knee").record["pose_range"].values())).T
    return low + (high - low) * np.random.default_rng(0).random((1_000_000, 6))


def seconds_per_pose(call, poses, repeats):
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        call(poses)
        seconds.append(time.perf_counter() - start)
    return min(seconds) / len(poses)


@pytest.mark.parametrize("what", ["__call__", "jacobian", "validity", "expected_error"])
@pytest.mark.parametrize("kind", ["surrogate", "foundation"])
def bench_a_million_poses_use_all_cores(kind, what, poses):
    model = cc.load_surrogate("knee") if kind == "surrogate" else cc.foundation("knee")
    call = getattr(model, what, None)
    if call is None:
        pytest.skip("a foundation has no such number")
    call(poses[:2000])
    alone, threads = seconds_per_pose(call, poses[:100_000], 5), numba.config.NUMBA_NUM_THREADS  # tests have one thread
    numba.set_num_threads(threads)
    try:
        together = seconds_per_pose(call, poses, 3)
    finally:
        numba.set_num_threads(1)
    share = alone / (threads * together)
    print(f"{kind} {what}: {1e6 * alone:.2f} µs a pose on one core, {threads} cores at {share:.0%} of their rate")
    assert share >= LEAST_SHARE
