"""Archard's law on the elements of a contact surface: pressure times sliding, summed over a cycle.

    h = k·∮ p·|v_t| dt        [mm³/(N·m) · MPa · mm, over 1000 = mm]

for each element of the fixed surface, with p its pressure, v_t the part of the moving body's velocity at its centre
that lies in its plane, and k the wear factor. Of each step between two poses the pressure is the mean of both ends; the
sliding is that of the rigid motion between them, about the middle:

    Δs = Δt + ω × (c - t_m),    Δs_t = Δs - n·(n·Δs)

with ω the skew part of R₂R₁ᵀ. The volume Σ A·h grows in proportion to the cycles: the surface stays as it is, since
what a million cycles remove is a few thousandths of the layer. Motion across the main direction of sliding, creep, and
lubrication are not in the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array, as_poses, rotation

# Fregly BJ, Sawyer WG, Harman MK, Banks SA. Computational wear prediction of a total knee replacement from in vivo
# kinematics. J Biomech 38 (2005) 305-314 take this size. Factors of polyethylene differ several-fold between tests.
WEAR_FACTOR = 1e-7  # mm³/(N·m)
CYCLES = 1e6
_MM_PER_M = 1000.0


@dataclass(frozen=True)
class PatchWear:
    """One patch's elements: centres_mm (m, 3), areas_mm2 (m,); of one cycle depth_mm (m,) and sliding_mm (m,), the way
    slid under pressure."""

    patch: str
    centres_mm: Array
    areas_mm2: Array
    depth_mm: Array
    sliding_mm: Array

    @property
    def volume_mm3(self) -> float:
        """Volume worn off in one cycle."""
        return float(self.depth_mm @ self.areas_mm2)


def volume_mm3(patches: Sequence[PatchWear]) -> float:
    """Volume of all patches, worn off in one cycle."""
    return sum(patch.volume_mm3 for patch in patches)


def check_wear_factor(wear_factor: float) -> None:
    """Raises ValueError unless a wear factor [mm³/(N·m)] is positive and finite."""
    if not 0.0 < wear_factor < np.inf:
        raise ValueError(f"wear factor {wear_factor}, expected a positive number [mm³/(N·m)]")


def archard_wear(model: ElasticFoundation, poses: Array, wear_factor: float = WEAR_FACTOR) -> list[PatchWear]:
    """Wear of every patch over a closed cycle of poses (n, 6), whose last is joined to its first.

    wear_factor [mm³/(N·m)]. Raises ValueError for fewer than two poses and a factor that is not positive.
    """
    poses = as_poses(poses)
    check_wear_factor(wear_factor)
    if len(poses) < 2:
        raise ValueError(f"{len(poses)} poses, expected at least 2")
    elements = model.scene.elements(model.grid)
    depths, slides = ([np.zeros(len(e.areas_mm2)) for e in elements] for _ in range(2))
    before = [found.pressures_mpa for found in model.pressure_maps(poses[-1])]
    for k in range(len(poses)):
        now = [found.pressures_mpa for found in model.pressure_maps(poses[k])]
        middle, shift, turn = _step(poses[k - 1], poses[k])
        for p, e in enumerate(elements):
            mean = 0.5 * (before[p] + now[p])
            pressed = np.flatnonzero(mean)
            moved = shift + np.cross(turn, e.centres_mm[pressed] - middle)
            normals = e.normals[pressed]
            slid = np.linalg.norm(moved - np.sum(normals * moved, axis=1)[:, None] * normals, axis=1)
            depths[p][pressed] += wear_factor / _MM_PER_M * mean[pressed] * slid
            slides[p][pressed] += slid
        before = now
    return [
        PatchWear(patch, e.centres_mm, e.areas_mm2, depth, slid)
        for patch, e, depth, slid in zip(model.patch_names, elements, depths, slides, strict=True)
    ]


def _step(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Middle of the origin's way, the way, and the turn ω, each (3,), between two poses (6,)."""
    turn = rotation(second[3:]) @ rotation(first[3:]).T
    skew = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return 0.5 * (first[:3] + second[:3]), second[:3] - first[:3], skew
