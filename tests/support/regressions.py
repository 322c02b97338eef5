"""Small regressions for the tests of training."""

import numpy as np

from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.settings import TrainingSettings

FIXED = TrainingSettings(sizes=((6, 5),), max_iterations=40)  # ends by iterations, the same on any machine


def smooth(rows=400, seed=0, tolerance=0.0, name="smooth") -> Regression:
    """A smooth function of three inputs, weights spread over a factor of 50, a fifth of the rows for validation."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, (rows, 3)) * (1.0, 5.0, 0.2) + (0.0, 27.0, 0.0)
    y = np.sqrt(1.5 + x[:, 0] * np.cos(0.4 * (x[:, 1] - 27.0)) * 0.9) + 3.0 * x[:, 2] ** 2
    weights = rng.uniform(2.0, 100.0, rows)
    return Regression(name, x, y, weights, rng.random(rows) < 0.2, tolerance)
