"""The elastic foundation of smooth shapes by polar quadrature, as a contact model, and its C (``c/polar.h``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.foundation_source import C_FOLDER, braces, definitions
from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.polar.caps import fan_angles
from casadi_contact.contact.polar.lines import Rays, ray_angles
from casadi_contact.contact.polar.peak import ACROSS
from casadi_contact.contact.polar.quadrature import OUTWARDS, RIM_STARTS, fits_closely, patch_loads, patch_moments
from casadi_contact.contact.polar.surfaces import SmoothPatch, Torus, smooth_patches
from casadi_contact.contact.pressure_law import law_of
from casadi_contact.core.conventions import Array
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.scenes.scene import Scene


def polar_source(patches: Sequence[SmoothPatch], rays: Rays) -> str:
    """Tables of the patches and `patch_loads`."""
    free, at_rim = ray_angles(rays.count), ray_angles(rays.at_rim)
    rim_starts = np.concatenate([RIM_STARTS, OUTWARDS])
    x, weight = np.polynomial.legendre.leggauss(rays.points)
    sizes = {
        "RAYS": rays.count,
        "RIM_RAYS": rays.at_rim,
        "GAUSS": rays.points,
        "ARCS": len(patches[0].arcs),
        "TORUS": int(patches[0].torus is not None),
        "TURNED": int(any((patch.turn != np.eye(3)).any() for patch in patches)),
        "CURVED_RIM": int(np.isfinite(patches[0].rim.spread)),
        "CAP_LINES": rays.in_caps,
        **{name.upper(): value for name, value in asdict(patches[0].tuning).items()},
        "STARTS": len(ACROSS),
        "RIM_STARTS": RIM_STARTS.shape[1],
    }
    tables = {
        "ray_cos[RAYS]": free[0],
        "ray_sin[RAYS]": free[1],
        "rim_cos[RIM_RAYS]": at_rim[0],
        "rim_sin[RIM_RAYS]": at_rim[1],
        "gauss_x[GAUSS]": 0.5 * (1.0 + x),
        "gauss_w[GAUSS]": 0.5 * weight,
        "starts[2 * STARTS]": np.concatenate([ACROSS, ACROSS]),
        **{f"rim_{name}[RIM_STARTS]": row for name, row in zip(("w", "v", "out_u", "out_v"), rim_starts, strict=True)},
    }
    has_caps = len(patches[0].arcs) > 1
    if has_caps:
        fan = fan_angles(rays.in_caps)
        tables |= {"fan_cos[CAP_LINES]": fan[0], "fan_sin[CAP_LINES]": fan[1], "fan_weight[CAP_LINES]": fan[2]}
    return "\n".join(
        [
            *definitions(sizes, tables),
            c_text("polar_surfaces.h", C_FOLDER),
            f"static const Surfaces surfaces[PATCHES] = {{{', '.join(map(_surfaces, patches))}}};",
            c_text("polar_peak.h", C_FOLDER),
            c_text("polar_lines.h", C_FOLDER),
            *([c_text("polar_second.h", C_FOLDER)] if patches[0].torus is not None else []),
            *([c_text("polar_caps.h", C_FOLDER)] if has_caps else []),
            c_text("polar.h", C_FOLDER),
        ]
    )


def _surfaces(patch: SmoothPatch) -> str:
    """The fields of `Surfaces` in their order."""
    torus, rim = patch.torus or Torus(0.0, 1.0, 0.0, 1.0, 1.0), patch.rim
    spread = rim.spread if np.isfinite(rim.spread) else 0.0
    numbers = [torus.offset, torus.radius, torus.height, torus.rho_sign, torus.w_sign, *rim.u, *rim.v, spread]
    numbers += [patch.z_0, patch.tube_radius, patch.centre_z, fits_closely(patch)]
    fields = [repr(float(number)) for number in numbers]
    fields += [f"{{{', '.join(map(braces, patch.turn))}}}"]
    return f"{{{', '.join(fields)}, {{{', '.join(map(braces, patch.arcs))}}}}}"


class PolarFoundation(CompiledFoundation):
    """Elastic foundation between smooth surfaces, integrated on rays from the peak of each patch's contact area.

    Contact is found in any pose that presses the moving arcs on the patch. Where the rim cuts the contact area
    (`at_edge`), loads are off by 0.1 to 0.4 % in the median and 1 to 2 % in the worst hundredth, against elements. The
    rays serve one contact area, and a second one on the rim. The distance jumps on the body's back, beyond its last
    arcs: contact may be missed there.

    rays: multiples of 4. Raises ValueError for another number, or a scene of another shape than `POLAR_SHAPES`.
    """

    def __init__(
        self,
        scene: Scene,
        rays: Rays = Rays(16, 3),  # noqa: B008
        *,
        compiled: bool = True,
    ) -> None:
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

    def _patch_loads(self, R: Array, t: Array) -> list[PatchLoads]:
        return [patch_loads(patch, self.law, self.rays, R, t) for patch in self.patches]
