"""A ball in a spherical cup: the numbers that its contact depends on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.scenes.scene import Scene

CUP_SHAPE = "ball_in_cup"


@dataclass(frozen=True)
class Cup:
    """Radii [mm], centre (3,) [mm] and unit vector (3,) to the deepest point; half_angle [rad] from there to the rim.

    The ball's centre is the origin of the moving body.
    """

    ball_radius: float
    radius: float
    half_angle: float
    pole: Array
    centre: Array


def cup_of(scene: Scene) -> Cup:
    """The cup of a scene of the shape `CUP_SHAPE`; raises ValueError for another shape."""
    if scene.shape != CUP_SHAPE:
        raise ValueError(f"scene {scene.name} has the shape {scene.shape}, expected {CUP_SHAPE}")
    g, pole = scene.geometry, np.asarray(scene.geometry["cup_pole"], dtype=float)
    half_angle = float(np.deg2rad(g["cup_half_angle_deg"]))
    centre = np.asarray(g["cup_centre"], dtype=float)
    return Cup(float(g["ball_radius"]), float(g["cup_radius"]), half_angle, pole / np.linalg.norm(pole), centre)
