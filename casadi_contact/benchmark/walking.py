"""An unseen walking sequence inside domain D1 [EF15 §3.6]."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ContactModel
from casadi_contact.conventions import Array
from casadi_contact.sampling import ReferenceMotion
from casadi_contact.statics import settle


def unseen_walking(model: ContactModel, motion: ReferenceMotion, count: int = 5, seed: int = 51) -> Array:
    """Poses (n, 6) of `count` new cycles: random weighted means of the reference cycles' sample-point inputs.

    Weighted means lie inside the reference envelopes and so inside D1, and none is a reference cycle or a sample.
    Each frame is settled on the given model; frames that do not settle are left out. Raises ValueError for a motion
    of a single cycle, which has no others in between.
    """
    cycles = motion.curves.shape[0]
    if cycles < 2:
        raise ValueError("the reference motion has 1 cycle, expected at least 2 to make an unseen one in between")
    weights = np.random.default_rng(seed).dirichlet(np.ones(cycles), size=count)
    inputs = np.einsum("wc,cfi->wfi", weights, motion.curves).reshape(-1, motion.curves.shape[2])
    loads = {name: inputs[:, motion.point.inputs.index(name)] for name in motion.point.load_inputs}
    poses, report = settle(model, motion.starts(inputs), motion.point.free, loads)
    return poses[report.converged]
