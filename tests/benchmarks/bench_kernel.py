"""Times of the shipped knee's forms, one group per order of derivative; run on demand:

pip install -e ".[bench]"; python -m pytest tests/benchmarks/bench_kernel.py
"""

import numpy as np
import pytest

from casadi_contact.optimisation.pose_estimation import PoseEstimation
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.workflow.benchmark.kernel_speed import jacobian_of, lagrangian_hessian

FORMS = {"graph": False, "kernel": True}


@pytest.fixture(scope="module")
def solved(knee):
    return PoseEstimation.of_cycle(knee, reference_cycle()).solve().poses


def buffered(function, *arguments):
    """A call without arguments through the function's buffer."""
    buffer, call = function.buffer()
    kept = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
    kept += [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
    for i in range(len(arguments)):
        buffer.set_arg(i, memoryview(kept[i]))
    for i in range(function.n_out()):
        buffer.set_res(i, memoryview(kept[len(arguments) + i]))
    return lambda: (call(), buffer, kept)  # the buffer and its memory must live as long as the call


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.benchmark(group="value")
def bench_value(benchmark, knee, solved, form):
    benchmark(buffered(knee.function(compiled=FORMS[form]), solved[30]))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.benchmark(group="Jacobian")
def bench_jacobian(benchmark, knee, solved, form):
    benchmark(buffered(jacobian_of(knee.function(compiled=FORMS[form])), solved[30]))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.benchmark(group="Hessian")
def bench_hessian(benchmark, knee, solved, form):
    benchmark(buffered(lagrangian_hessian(knee.function(compiled=FORMS[form])), solved[30], np.ones(7)))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.benchmark(group="101 poses")
def bench_batch(benchmark, knee, solved, form):
    benchmark(buffered(knee.function(compiled=FORMS[form], batch=len(solved)), solved))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.benchmark(group="pose estimation")
def bench_pose_estimation(benchmark, knee, form):
    problem = PoseEstimation.of_cycle(knee, reference_cycle(), compiled=FORMS[form])
    benchmark.pedantic(problem.solve, rounds=5, warmup_rounds=1)
