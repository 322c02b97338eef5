"""Cycles that may be in other units than they say: centres of pressure in metres."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.quantities import LENGTH, of_kind
from problems.pose_estimation.wanted import WantedLoads

_SHARE = 0.01  # of the patches' extent


def centre_warnings(wanted: WantedLoads, model: ContactModel | str) -> list[str]:
    """A line where all centres of pressure lie within a hundredth of the patches' extent about the origin; none where
    all are zero.

    model: `own_model` of the scene; where it has no elements, nothing is known of their extent.
    """
    centres = of_kind(tuple(wanted.values), LENGTH)
    largest = max((float(np.abs(wanted.values[name]).max()) for name in centres), default=0.0)
    if largest == 0.0 or not isinstance(model, ElasticFoundation):
        return []
    points = np.concatenate([patch.centres_mm for patch in wanted.scene.elements(model.grid)])
    extent = float(np.ptp(points, axis=0).max())
    if largest >= _SHARE * extent:
        return []
    return [
        f"all centres of pressure lie within {largest:.2g} mm of the origin, on patches that reach over {extent:.3g} "
        "mm: are they in mm, or in m?"
    ]
