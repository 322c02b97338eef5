"""Centres of pressure that no pose has: a proof, where there is one, that measured loads cannot be carried.

Pressure pushes an element along its normal n, at its centre c. Alone it would have the centre of pressure, across the
axis a of pressing,

    e_b = c_b - c_a·n_b/n_a        for a knee (x - y·n_x/n_y,  z - y·n_z/n_y), as (Tz/Fy, -Tx/Fy) of c × n

and where all n_a have one sign a patch's centre of pressure is a mean of those of its elements, with weights that
pressure makes positive. So that of all, Σ_p F_p·e_p / Σ_p F_p, lies within Σ_p F_p·max_e(e·u) / Σ_p F_p along every
direction u.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from problems.pose_estimation.wanted import WantedLoads

_DIRECTIONS = 64


def beyond_reach_mm(model: ContactModel, wanted: WantedLoads) -> Array:
    """How far (n,) [mm] the wanted centres of pressure lie at least beyond those that contact on the elements can have;
    0 where this proves nothing: within reach, without load, without elements or with such that face away, or where
    not both coordinates and all normal loads are wanted."""
    none = np.zeros(len(next(iter(wanted.values.values()))))
    normals = model.scene.normal_loads
    known = len(wanted.centres) == 2 and {name for n in normals for name in n.loads} <= set(wanted.values)
    if not isinstance(model, ElasticFoundation) or not known:
        return none
    a = int(normals[0].index or 0)
    across = [centre.axis for centre in wanted.centres.values()]
    elements = model.scene.elements(model.grid)
    if any((normal.sign * e.normals[:, a] >= 0.0).any() for normal, e in zip(normals, elements, strict=True)):
        return none
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    along = np.stack([np.cos(angles), np.sin(angles)])
    farthest = []
    for e in elements:
        own = e.centres_mm[:, across] - e.centres_mm[:, [a]] * e.normals[:, across] / e.normals[:, [a]]
        farthest.append((own @ along).max(axis=0))
    forces = np.column_stack([normal.sign * wanted.values[normal.loads[0]] for normal in normals])
    total = forces.sum(axis=1, keepdims=True)
    reach = forces @ np.array(farthest) / np.where(total > 0.0, total, 1.0)
    centres = np.column_stack([wanted.values[name] for name in wanted.centres]) @ along
    return np.asarray(np.where(total[:, 0] > 0.0, (centres - reach).max(axis=1).clip(0.0), 0.0))
