"""Discretisation error of an element grid in given poses, estimated by elements of another width."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.verification.verify import loads_on
from casadi_contact.scenes.shapes.checks import MOST_ELEMENTS

_UNSURE = 0.5  # of what is allowed: elements twice as wide that differ by less let the model pass


def off_finer(model: ElasticFoundation, poses: Array, names: Sequence[str], allowed: Array) -> Array | None:
    """What the elements are off by in poses (n, 6): their named loads (n, L) minus those of elements half as wide; None
    where these are a mesh's own triangles, and so the same for every grid.

    Elements twice as wide are asked first, which takes a quarter of the model's time. Poses in which these differ by no
    more than half of `allowed` (L,) are left at zero. That is a sieve and no proof, since errors need not fall with the
    width: of 544 poses of the knee in which 40×20 elements are off by more than allowed, a sieve twice as wide let two
    pass. Where half the width would be too many elements, the wider ones stand in for the finer.
    """
    if model.scene.geometry.get("elements") == "triangles":
        return None
    nx, nz = model.grid
    loads = loads_on(model, poses, names)
    wider = ElasticFoundation(model.scene, ((nx + 1) // 2, (nz + 1) // 2))
    off = loads - loads_on(wider, poses, names)
    unsure = (np.abs(off) > _UNSURE * allowed).any(axis=1)
    if unsure.any() and 4 * nx * nz <= MOST_ELEMENTS:
        finer = ElasticFoundation(model.scene, (2 * nx, 2 * nz))
        off[unsure] = loads[unsure] - loads_on(finer, poses[unsure], names)
    off[~unsure] = 0.0
    return off
