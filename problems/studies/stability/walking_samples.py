"""A few samples of a contact model around walking, for methods that cannot take more."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array, pose_index
from casadi_contact.samples.samples import TRAIN, VALIDATION, Samples

_MOVES = {"tx": 3.0, "tz": 0.5, "ry": 0.05, "rz": 0.1}  # [mm, rad] about walking
_LOADS_N = (20.0, 1500.0)
_LIFTED_SHARE, _LIFT_MM = 0.1, 1.0


def walking_samples(model: ElasticFoundation, poses: Array, count: int, seed: int = 0) -> Samples:
    """Poses about given ones (n, 6), each side under a random load from 20 to 1500 N, a tenth lifted by up to 1 mm.

    Poses whose loads cannot be carried are left out, so that there may be a few less than count.
    """
    rng = np.random.default_rng(seed)
    drawn = poses[rng.integers(len(poses), size=count)]
    for name, move in _MOVES.items():
        drawn[:, pose_index(name)] += rng.uniform(-move, move, count)
    low, high = _LOADS_N
    targets = {name: -np.exp(rng.uniform(np.log(low), np.log(high), count)) for name in model.scene.sensitive_loads}
    drawn, report = settle(model, drawn, ("ty", "rx"), targets, tolerance=1e-3)
    drawn = drawn[report.converged & ~model.at_edge(drawn).any(axis=1)]
    lifted = rng.random(len(drawn)) < _LIFTED_SHARE
    drawn[lifted, pose_index("ty")] += rng.uniform(0.0, _LIFT_MM, int(lifted.sum()))
    role = np.where(np.arange(len(drawn)) % 10 == 9, VALIDATION, TRAIN).astype(np.uint8)
    domain = np.where(lifted, 4, 1).astype(np.uint8)
    return Samples(model.scene, drawn, model.wrenches(drawn), model.gaps(drawn), domain, role)
