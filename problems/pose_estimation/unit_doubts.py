"""Cycles that may be in other units than they say: forces in kN or body weights, centres of pressure in metres."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ContactModel, ElasticFoundation
from casadi_contact.quantities import FORCE, LENGTH, quantity, two_digits
from problems.pose_estimation.wanted import WantedLoads

_SHARE = 0.01  # of the scene's reference load, and of its patches' extent


def unit_doubts(wanted: WantedLoads, model: ContactModel | str) -> list[str]:
    """A line where all forces of a cycle are below a hundredth of the scene's reference load, and one where all centres
    of pressure lie within a hundredth of the patches' extent about the origin; none where all are zero.

    model: `own_model` of the scene; where it has no elements, nothing is known of their extent.
    """
    scene = wanted.scene
    doubts = []
    if 0.0 < (force := _largest(wanted, FORCE.unit)) < _SHARE * scene.reference_load:
        doubts.append(
            f"the largest force is {two_digits(force)} N, where the scene's reference load is "
            f"{scene.reference_load:.4g} N: are forces in N, or in kN or body weights?"
        )
    if (centre := _largest(wanted, LENGTH.unit)) > 0.0 and isinstance(model, ElasticFoundation):
        points = np.concatenate([patch.centres_mm for patch in scene.elements(model.grid)])
        if centre < _SHARE * (extent := float(np.ptp(points, axis=0).max())):
            doubts.append(
                f"all centres of pressure lie within {centre:.2g} mm of the origin, on patches that reach over "
                f"{extent:.3g} mm: are they in mm, or in m?"
            )
    return doubts


def _largest(wanted: WantedLoads, unit: str) -> float:
    """The largest size of what is wanted in a unit; 0 where nothing is."""
    sizes = [np.abs(curve).max() for name, curve in wanted.values.items() if quantity(name).kind.unit == unit]
    return float(max(sizes, default=0.0))
