"""Cycles whose signs may not be a right knee's: flexion turned round, sides exchanged, forces on the other body."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from problems.pose_estimation.wanted import WantedLoads

_HYPEREXTENDED_RAD = 0.35  # 20 degrees: no knee that walks goes farther
_MIRRORED = 0.5  # of the distance, that the mirror image leaves


def sign_warnings(wanted: WantedLoads, measured: Mapping[str, Array], model: ContactModel | str) -> list[str]:
    """A line where a knee is hyperextended by more than 20 degrees, one where centres of pressure fit the forces of
    both sides far better in their mirror image, and one where all forces point out of the fixed body's surface.

    measured: pose parameters by name, each (n,). model: `own_model` of the scene; where it has no elements, the last
    two are not told.
    """
    warnings = [_flexion(wanted, measured["rz"])] if "rz" in measured else []
    if isinstance(model, ElasticFoundation):
        warnings += [*_sides(wanted, model), _pull(wanted, model)]
    return [warning for warning in warnings if warning]


def _flexion(wanted: WantedLoads, rz: Array) -> str:
    if not {"Fy_med", "Fy_lat"} <= set(wanted.values) or rz.max() <= _HYPEREXTENDED_RAD:
        return ""
    return (
        f"rz reaches {rz.max():.2g} rad at frame {int(rz.argmax())}, a knee hyperextended by "
        f"{np.degrees(rz.max()):.0f} degrees: flexion is negative, is its sign reversed?"
    )


def _sides(wanted: WantedLoads, model: ElasticFoundation) -> list[str]:
    """Of the centre of pressure along which the patches' middles m_p lie farthest apart, whether it follows
    Σ_p F_p·m_p / Σ_p F_p, or rather minus that, as in the other knee, or its image about the middle of all, as with
    exchanged sides."""
    scene = wanted.scene
    loads = [normal.loads[0] for normal in scene.normal_loads]
    if len(loads) < 2 or not wanted.centres or not set(loads) <= set(wanted.values):
        return []
    forces = np.abs(np.column_stack([wanted.values[name] for name in loads]))
    middle_mm = np.array([patch.centres_mm.mean(axis=0) for patch in scene.elements(model.grid)])
    total, warnings = forces.sum(axis=1), []
    for name, centre in wanted.centres.items():
        if centre.axis != np.ptp(middle_mm, axis=0).argmax():
            continue
        middles = middle_mm[:, centre.axis]
        torque = total * wanted.values[name]
        off = np.linalg.norm(torque - forces @ middles)
        images = {
            "is this a left knee that was not mirrored": np.linalg.norm(torque + forces @ middles),
            "are the sides exchanged": np.linalg.norm(torque + forces @ (middles - 2.0 * middles.mean())),
        }
        if asked := [question for question, left in images.items() if left < _MIRRORED * off]:
            off_mm, left_mm = np.array([off, min(images.values())]) / np.linalg.norm(total)
            warnings.append(
                f"{name} lies {off_mm:.2g} mm from where {' and '.join(loads)} put it, its mirror image {left_mm:.2g} "
                f"mm: {', or '.join(asked)}?"
            )
    return warnings


def _pull(wanted: WantedLoads, model: ElasticFoundation) -> str:
    """Whether forces of no set direction (a hip's) point out of the surface that pressure can only push into."""
    for normal, patch in zip(wanted.scene.normal_loads, wanted.scene.elements(model.grid), strict=True):
        if normal.direction is not None or not set(normal.loads) <= set(wanted.values):
            continue
        into = -(patch.areas_mm2[:, None] * patch.normals).sum(axis=0)
        along = np.column_stack([wanted.values[name] for name in normal.loads]) @ into
        if along.any() and (along <= 0.0).all():
            return (
                f"{', '.join(normal.loads)} point out of the fixed body in every frame, contact only pushes into it: "
                "are they the forces on the other body?"
            )
    return ""
