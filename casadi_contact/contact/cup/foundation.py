"""The elastic foundation of a ball in a spherical cup, as a contact model."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.compiled.pressures import CompiledPressures
from casadi_contact.contact.compiled.source import C_FOLDER
from casadi_contact.contact.cup.cup import cup_of
from casadi_contact.contact.cup.pressures import cup_moments
from casadi_contact.contact.cup.quadrature import cup_loads
from casadi_contact.contact.cup.source import cup_source
from casadi_contact.contact.pressure.law import law_of
from casadi_contact.core.conventions import Array
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.scenes.scene import Scene

POINTS = 12


class CupFoundation(CompiledPressures):
    """Elastic foundation of a ball in a cup with its rim, integrated over one angle: nothing of it is a grid.

    points: on whole circles about the deepest point and on those that the rim cuts, a multiple of 4. Raises ValueError
    for another number, or a scene of another shape than `CUP_SHAPE`.
    """

    def __init__(self, scene: Scene, points: int = POINTS, *, compiled: bool = True) -> None:
        super().__init__(scene, compiled=compiled)
        if points < 4 or points % 4:
            raise ValueError(f"points = {points}, expected a multiple of 4")
        self.points = points
        self.cup = cup_of(scene)
        self.law = law_of(scene.material)

    @property
    def resolution(self) -> str:
        """Points of the quadrature."""
        return f"{self.points} points"

    def _patch_source(self) -> str:
        return cup_source(self.cup, self.points)

    def _moments_source(self) -> str:
        return c_text("cup_pressures.h", C_FOLDER)

    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        value, by_centre = cup_moments(self.cup, self.law, self.points, t)
        return value[:, None], np.concatenate([by_centre, np.zeros_like(by_centre)], -1)[:, None]

    def _by_twist(self, R: Array, t: Array) -> tuple[Array, Array, Array, Array, np.ndarray]:
        found = cup_loads(self.cup, self.law, self.points, t)
        wrench, stiffness, gap_slope = np.zeros((len(t), 6)), np.zeros((len(t), 6, 6)), np.zeros((len(t), 6))
        wrench[:, :3], wrench[:, 3:] = found.force, np.cross(self.cup.centre, found.force)
        stiffness[:, :3, :3] = found.stiffness
        stiffness[:, 3:, :3] = np.swapaxes(np.cross(self.cup.centre, np.swapaxes(found.stiffness, 1, 2)), 1, 2)
        gap_slope[:, :3] = found.gap_slope
        return wrench[:, None], stiffness[:, None], found.gap[:, None], gap_slope[:, None], found.cut[:, None]
