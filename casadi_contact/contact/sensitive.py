"""Sensitive directions of a contact model: which pose changes change its loads most [EF15 §2.1]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.model import ContactModel, with_loads
from casadi_contact.core.conventions import LEVER_MM, POSE_NAMES, Array, as_poses
from casadi_contact.core.quantities import newton_scales


@dataclass(frozen=True)
class SensitiveDirections:
    """How strongly a contact model's loads answer to its pose parameters, in comparable units [N/mm].

    names: pose parameters, most sensitive first; stiffness by name: root of the sum of squares of the loads' changes
    (torques over the lever) by 1 mm, or by the rotation that moves a point at the lever by 1 mm. directions (6, 6):
    the unit directions of pose change (tx ty tz [mm], rx ry rz [rad times lever]) in rows, strongest first, and
    their stiffnesses (6,): the right singular vectors and singular values of the scaled Jacobian.
    """

    names: tuple[str, ...]
    stiffness: dict[str, float]
    directions: Array
    stiffnesses: Array

    def __str__(self) -> str:
        lines = [f"  {name}  {self.stiffness[name]:12.1f}" for name in self.names]
        return "\n".join(["stiffness [N/mm], rotations at the lever:", *lines])


def sensitive_directions(
    model: ContactModel, pose: ArrayLike, *, lever_mm: float = LEVER_MM, loads: Sequence[str] | None = None
) -> SensitiveDirections:
    """Rank the pose parameters by the loads they change at a pose (6,) in contact.

    With S = D_loads⁻¹·(d loads/d pose)·D_pose, D = 1 for forces and translations, the lever for torques and 1/lever
    for rotations. loads: which (see `ContactModel`), the model's load_names if left out. Parameters that the scene ties
    follow; those that it locks or ties are ranked last, with a stiffness of zero. Raises ValueError for a bad pose,
    lever or load, and out of contact, where no load changes.
    """
    if not np.isfinite(lever_mm) or lever_mm <= 0.0:
        raise ValueError(f"lever_mm is {lever_mm}, expected a length above 0")
    model = model if loads is None else with_loads(model, loads)
    poses = as_poses(np.atleast_2d(np.asarray(pose, dtype=float)))
    if len(poses) != 1:
        raise ValueError(f"got {len(poses)} poses, expected one: tx ty tz [mm] rx ry rz [rad]")
    of_load = newton_scales(model.load_names, lever_mm)
    of_pose = np.array([1.0] * 3 + [lever_mm] * 3)
    scaled = model.scene.pose_space.pull_back(model.jacobian(poses)[1][0]) / of_load[:, None] / of_pose
    if not np.isfinite(scaled).all():
        raise ValueError("the model's loads are not finite at this pose, expected a pose at which it gives numbers")
    if not scaled.any():
        raise ValueError("no load changes at this pose, expected a pose in contact")
    columns = np.linalg.norm(scaled, axis=0)
    _, values, directions = np.linalg.svd(np.vstack([scaled, np.zeros((6, 6))]), full_matrices=False)
    ranked = tuple(POSE_NAMES[k] for k in np.argsort(-columns, kind="stable"))
    return SensitiveDirections(ranked, dict(zip(POSE_NAMES, columns.tolist(), strict=True)), directions, values)
