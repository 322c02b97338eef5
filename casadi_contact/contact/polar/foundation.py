"""The elastic foundation of smooth shapes by polar quadrature, as a contact model."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.compiled.pressures import CompiledPressures
from casadi_contact.contact.compiled.source import C_FOLDER
from casadi_contact.contact.polar.patches import smooth_patches
from casadi_contact.contact.polar.pressures import patch_moments
from casadi_contact.contact.polar.quadrature import patch_loads
from casadi_contact.contact.polar.rays import Rays
from casadi_contact.contact.polar.source import polar_source
from casadi_contact.contact.pressure.law import law_of
from casadi_contact.core.conventions import Array
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.scenes.scene import Scene

RAYS = Rays(16, 3)


class PolarFoundation(CompiledPressures):
    """Elastic foundation between smooth surfaces, integrated on rays from the middle of each patch's spot.

    Contact is found in any pose that presses the moving arcs on the patch. Where the rim cuts the spot (`at_edge`),
    loads are off by 0.1 to 0.4 % in the median and 1 to 2 % in the worst hundredth, against elements. The rays serve
    one spot, and a second one on the rim. On the body's back, beyond its outermost arcs, the distance jumps and contact
    may be passed over.

    rays: multiples of 4. Raises ValueError for another number, or a scene of another shape than `POLAR_SHAPES`.
    """

    def __init__(self, scene: Scene, rays: Rays = RAYS, *, compiled: bool = True) -> None:
        super().__init__(scene, compiled=compiled)
        if rays.count < 4 or rays.count % 4 or rays.points < 1:
            raise ValueError(f"rays = {rays}, expected a multiple of 4 rays and at least 1 point")
        self.rays = rays
        self.lanes = 8 if rays.count % 8 == 0 else 4
        self.patches = smooth_patches(scene)
        self.law = law_of(scene.material)

    @property
    def resolution(self) -> str:
        """Rays of a patch, and Gauss points on each of them."""
        return str(self.rays)

    def _patch_source(self) -> str:
        return polar_source(self.patches, self.rays)

    def _moments_source(self) -> str:
        return c_text("polar_pressures.h", C_FOLDER)

    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        found = [patch_moments(patch, self.law, self.rays, R, t) for patch in self.patches]
        return np.stack([value for value, _ in found], 1), np.stack([slope for _, slope in found], 1)

    def _by_twist(self, R: Array, t: Array) -> tuple[Array, Array, Array, Array, np.ndarray]:
        found = [patch_loads(patch, self.law, self.rays, R, t) for patch in self.patches]
        keys = ("wrench", "stiffness", "gap", "gap_slope", "cut")
        wrench, stiffness, gap, gap_slope, cut = (np.stack([getattr(f, key) for f in found], 1) for key in keys)
        return wrench, stiffness, gap, gap_slope, cut
