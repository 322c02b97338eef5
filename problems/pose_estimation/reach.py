"""Centres of pressure that no pose has: a proof, where there is one, that measured loads cannot be carried.

Pressure pushes an element along its normal n, at its centre c. Alone it would have the centre of pressure

    e = (x - y·n_x/n_y,  z - y·n_z/n_y)        as (Tz/Fy, -Tx/Fy) of c × n

and with n_y > 0 a side's centre of pressure is a mean of those of its elements, with weights that pressure makes
positive. So that of both, Σ_p F_p·e_p / Σ_p F_p, lies within Σ_p F_p·max_e(e·u) / Σ_p F_p along every direction u.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ContactModel, ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.motion.load_cycle import LoadCycle

_DIRECTIONS = 64


def beyond_reach_mm(model: ContactModel, cycle: LoadCycle) -> Array:
    """How far (n,) [mm] the wanted centres of pressure lie at least beyond those that contact on the elements can have;
    0 where this proves nothing: within reach, without load, with elements that face down, or without elements."""
    if not isinstance(model, ElasticFoundation):
        return np.zeros(len(cycle))
    elements = model.scene.elements(model.grid)
    if any((e.normals[:, 1] <= 0.0).any() for e in elements):
        return np.zeros(len(cycle))
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    along = np.stack([np.cos(angles), np.sin(angles)])
    farthest = []
    for e in elements:
        own = e.centres_mm[:, [0, 2]] - e.centres_mm[:, [1]] * e.normals[:, [0, 2]] / e.normals[:, [1]]
        farthest.append((own @ along).max(axis=0))
    forces = -np.column_stack([cycle.fy_med, cycle.fy_lat])
    total = forces.sum(axis=1, keepdims=True)
    reach = forces @ np.array(farthest) / np.where(total > 0.0, total, 1.0)
    wanted = np.column_stack([cycle.cop_ap_mm, cycle.cop_ml_mm]) @ along
    return np.asarray(np.where(total[:, 0] > 0.0, (wanted - reach).max(axis=1).clip(0.0), 0.0))
