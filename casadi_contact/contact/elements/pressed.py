"""Which elements bear load in a pose."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array


def pressed_elements(model: ElasticFoundation, pose: Array) -> tuple[Array, Array]:
    """Centres (m, 3) [mm] of the elements that bear load and their forces p·A (m,) [N]."""
    maps = model.pressure_maps(pose)
    force = np.concatenate([each.forces_n for each in maps])
    return np.concatenate([each.centres_mm for each in maps])[force > 0.0], force[force > 0.0]
