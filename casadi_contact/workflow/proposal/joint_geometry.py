"""What two meshes show of their joint: where the bodies touch, in which patches, and which kind of joint it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import WRENCH_NAMES, Array
from casadi_contact.geometry.projection import axis_name
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.workflow.proposal.pair import ContactPlacement, Pair, contact_placement
from casadi_contact.workflow.proposal.patches import SETTINGS, Patches, find_patches

JOINTS = ("knee", "hip", "patella", "other")


@dataclass(frozen=True)
class Joint:
    """kind: one of `JOINTS`. patches: names by falling coordinate (library's axes) along which they lie side by side.
    pressing: signed axis of the library along which each patch is pressed ("-y"); "" if the force turns (a cup)."""

    kind: str
    patches: tuple[str, ...]
    pressing: str

    @property
    def sensitive(self) -> list[str]:
        """The scene's loads.sensitive: the normal load of each patch."""
        if not self.pressing:
            return ["F"] if len(self.patches) == 1 else [f"F_{patch}" for patch in self.patches]
        sign = "-" if self.pressing[0] == "-" else "+"
        return [f"{sign}{name}" for name in self._forces]

    @property
    def loads(self) -> list[str]:
        """The scene's loads.names: the normal loads by patch, all others summed over the patches."""
        if not self.pressing:
            split = [f"{force}_{patch}" for patch in self.patches for force in WRENCH_NAMES[:3]]
            return [*(split if len(self.patches) > 1 else WRENCH_NAMES[:3]), *WRENCH_NAMES[3:]]
        pressed = f"F{self.pressing[1]}"
        return [*self._forces, *(name for name in WRENCH_NAMES if name != pressed)]

    @property
    def sensitive_pose(self) -> list[str]:
        """The pose parameters to which the normal loads are most sensitive; of the knee [EF15 §2.1]."""
        if not self.pressing:
            return ["tx", "ty", "tz"]
        press = f"t{self.pressing[1]}"
        if len(self.patches) == 1:
            return [press]
        return [press, "tz" if self.kind == "patella" else "rx" if self.pressing[1] == "y" else "ry"]

    def pressed_along(self, direction: Array) -> Joint:
        """The joint in given axes, in which the moving body presses along `direction` (3,)."""
        return replace(self, pressing=axis_name(direction)) if self.kind == "other" and self.pressing else self

    @property
    def _forces(self) -> list[str]:
        force = f"F{self.pressing[1]}"
        return [force] if len(self.patches) == 1 else [f"{force}_{patch}" for patch in self.patches]


@dataclass(frozen=True, eq=False)
class JointGeometry:
    """How and where the bodies touch, and as which joint, in the axes of the files.

    rotation (3, 3): applied to the points of both files before the analysis; the unit matrix for upright files.
    """

    pair: Pair
    placement: ContactPlacement
    patches: Patches
    joint: Joint
    rotation: Array

    @property
    def tilt_deg(self) -> float:
        """Angle between the direction of pressing and the nearest axis; 0 for a cup.

        At most that of the direction midway between the patches: files may place the body on the slope of one of them.
        """
        midway = self.patches.mean_normals(self.pair).sum(axis=0)
        ways = (self.placement.pressing, midway / np.linalg.norm(midway))
        return min(float(np.degrees(np.arccos(np.abs(way).max()))) for way in ways) if self.joint.pressing else 0.0


def joint_geometry(
    meshes: Mapping[str, TriangleMesh], kind: str | None = None, *, upright: bool = True, most_tilt_deg: float = 15.0
) -> JointGeometry:
    """Analyse the "moving" and the "fixed" mesh.

    upright: if the moving body presses across the axes of the files, rotate both and analyse them again. Raises
    ValueError for meshes that do not touch, or not in as many places as the kind of joint has.
    """
    geometry = _analysed(meshes, kind, np.eye(3))
    if not upright or geometry.tilt_deg <= most_tilt_deg:
        return geometry
    pressing = geometry.placement.pressing
    axis = np.sign(pressing) * (np.abs(pressing) == np.abs(pressing).max())
    turn, _ = Rotation.align_vectors(axis[None], pressing[None])
    return _analysed(meshes, kind, turn.as_matrix())


def _analysed(meshes: Mapping[str, TriangleMesh], kind: str | None, turn: Array) -> JointGeometry:
    moving, fixed = (
        TriangleMesh(mesh.name, mesh.vertices_mm @ turn.T, mesh.faces) for mesh in (meshes["moving"], meshes["fixed"])
    )
    pair = Pair.of(moving, fixed)
    placement = contact_placement(pair)
    patches = find_patches(pair, placement)
    if kind == "hip" and patches.hollow:
        patches = find_patches(pair, placement, parted=False)
    if kind in ("knee", "patella") and len(patches.anchors_mm) == 1:
        patches = find_patches(pair, placement, least_share=SETTINGS.least_share_requested)
    return JointGeometry(pair, placement, patches, joint_of(pair, placement, patches, kind), turn)


def joint_of(
    pair: Pair,
    placement: ContactPlacement,
    patches: Patches,
    kind: str | None = None,
    *,
    cup_concentration: float = 0.9,
    groove_deg: float = 40.0,
) -> Joint:
    """The given kind of joint, or the one that the bodies resemble.

    A single patch with normals less concentrated than `cup_concentration` encloses the moving body. Two patches whose
    normals differ by more than `groove_deg` are a patella's. Raises ValueError for a kind with another number of
    patches.
    """
    count = len(patches.cuts_mm) + 1
    encloses = placement.concentration < cup_concentration
    if kind is None:
        kind = "hip" if count == 1 and encloses and patches.hollow else "other"
        if count == 2 and pair.scale == 1.0:  # as large as a knee
            one, other = patches.mean_normals(pair)
            kind = "patella" if one @ other < np.cos(np.radians(groove_deg)) else "knee"
    expected = {"knee": 2, "hip": 1, "patella": 2}.get(kind, count)
    if count != expected:
        raise ValueError(
            f"the bodies come near each other in {'one place' if count == 1 else f'{count} places side by side'}, a "
            f"{kind} in {expected}: choose another --joint, or cut the meshes to the surfaces that touch"
        )
    if count == 1:
        names: Sequence[str] = ("contact",)
    else:
        names = [f"p{k + 1}" for k in range(count)] if kind == "other" else ("med", "lat")
    force_turns = count == 1 and (kind == "hip" or encloses)
    return Joint(kind, tuple(names), "" if force_turns else "+x" if kind == "patella" else "-y")
