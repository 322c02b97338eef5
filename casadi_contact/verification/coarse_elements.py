"""Elements too coarse to judge a pose by: grids were chosen on a scene's own motion, and a cycle may lead elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.shapes.checks import MOST_ELEMENTS
from casadi_contact.verification.verify import loads_on


def off_finer(model: ElasticFoundation, poses: Array, names: Sequence[str], allowed: Array) -> Array:
    """What the elements are off by in poses (n, 6): their named loads (n, L) minus those of elements half as wide.

    Elements twice as wide are asked first, which takes a quarter of the model's time. Poses in which these differ by no
    more than `allowed` (L,) are left at zero: errors fall with the width, so the model's own are smaller still.
    """
    nx, nz = model.grid
    off = np.zeros((len(poses), len(names)))
    if 4 * nx * nz > MOST_ELEMENTS:
        return off
    loads = loads_on(model, poses, names)
    half = ElasticFoundation(model.scene, ((nx + 1) // 2, (nz + 1) // 2))
    unsure = (np.abs(loads - loads_on(half, poses, names)) > allowed).any(axis=1)
    if unsure.any():
        finer = ElasticFoundation(model.scene, (2 * nx, 2 * nz))
        off[unsure] = loads[unsure] - loads_on(finer, poses[unsure], names)
    return off
