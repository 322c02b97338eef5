"""An unseen walking sequence inside domain D1 [EF15 §3.6]."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.settings import SamplingSettings


def unseen_walking(model: ContactModel, motion: ReferenceMotion, count: int = 5, seed: int = 51) -> Array:
    """Poses (n, 6) of `count` new cycles: random weighted means of the reference cycles' sample-point inputs.

    Weighted means lie inside the reference envelopes and so inside D1, and none is a reference cycle or a sample. A
    single cycle has no others to go between: each of its inputs is shifted instead, by up to half of how far D1 reaches
    beside it. Each frame is settled on the given model; frames that do not settle are left out.
    """
    cycles, rng = len(motion.curves), np.random.default_rng(seed)
    if cycles == 1:
        settings = SamplingSettings.from_scene(model.scene)
        fixed = {name: d1 for name, (d1, _) in settings.fixed_offsets.items()}
        box = motion.envelopes.expand(settings.d1_fraction, settings.d1_offset, fixed)
        curves = motion.curves + 0.5 * rng.uniform(-0.5, 0.5, (count, 1, len(box.names))) * box.widths
    else:
        curves = np.einsum("wc,cfi->wfi", rng.dirichlet(np.ones(cycles), size=count), motion.curves)
    inputs = curves.reshape(-1, curves.shape[2])
    loads = {name: inputs[:, motion.point.inputs.index(name)] for name in motion.point.load_inputs}
    poses, report = settle(model, motion.starts(inputs), motion.point.free, loads)
    return poses[report.converged]
