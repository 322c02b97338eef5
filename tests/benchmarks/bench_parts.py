"""Steps of networks of a patch's parts, fitted on together in C and in NumPy on one core; run on demand:

python -m pytest -s tests/benchmarks/bench_parts.py
"""

import time

import numpy as np
import pytest

from casadi_contact.network import PartsRegression
from casadi_contact.training.levenberg_marquardt import LevenbergMarquardt
from casadi_contact.training.parts_mlp import PartsMlp, flatten_parts
from casadi_contact.training.weights import initial_network

ROWS, PARTS, HIDDEN = 60_000, 11, (20, 20, 20)
STEPS = 4


@pytest.fixture(scope="module")
def patch():
    """A patch as wide as four of its parts, and of each part the rows that a part of `tka_mesh` learns from."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (ROWS, 6))
    places = np.linspace(-1.0, 1.0, PARTS)
    roots = np.stack(
        [0.4 + 0.3 * x[:, 1] - 2.0 * np.square(x[:, 0] - at) + 0.1 * np.sin(9.0 * x[:, 2]) for at in places]
    )
    shares = rng.uniform(0.5, 1.0, (ROWS, PARTS, 6))
    wanted = np.einsum("kn,nkj->nj", np.square(np.maximum(roots, 0.0)), shares)
    weights = np.where((roots > 0.0) | (rng.random(roots.shape) < 0.125), 0.1, 0.0)
    names, nothing = tuple(f"root_{k}" for k in range(PARTS)), np.zeros(ROWS, bool)
    return PartsRegression("patch", names, (x,) * PARTS, shares, wanted, roots.T, weights.T, nothing, 0.0)


def test_steps_in_c_and_in_numpy(patch):
    networks = [initial_network(patch.inputs[0], s, HIDDEN, "algebraic", k) for k, s in enumerate(patch.targets.T)]
    seconds = {}
    for compiled in (True, False):
        lm = LevenbergMarquardt(PartsMlp(networks, patch, compiled=compiled), flatten_parts(networks), 0)
        taken = []
        for _ in range(STEPS):
            start = time.perf_counter()
            lm.step()
            taken.append(time.perf_counter() - start)
        seconds[compiled] = np.median(taken)
        how = "C" if compiled else "NumPy"
        print(f"{how}: {seconds[compiled]:.2f} s a step, RMS {lm.rms:.4g}, {1e-9 * lm.flop:.0f} Gflop")
    print(f"NumPy takes {seconds[False] / seconds[True]:.1f} times as long")
    assert seconds[True] < seconds[False]
