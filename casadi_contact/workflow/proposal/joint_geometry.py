"""What two meshes show of their joint: where the bodies touch, in which patches, and which kind of joint it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import WRENCH_NAMES, Array
from casadi_contact.geometry.projection import axis_name
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.workflow.proposal.pair import ContactPlacement, Pair, centre_of_normals, contact_placement
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
    contact_areas: number of separate contact areas. Equal to the number of patches, except where two areas always share
    load and were merged.
    """

    pair: Pair
    placement: ContactPlacement
    patches: Patches
    joint: Joint
    rotation: Array
    contact_areas: int

    @property
    def tilt_deg(self) -> float:
        """Angle between the direction of pressing and the nearest axis; 0 for a cup.

        At most that of the direction midway between the patches: files may place the body on the slope of one of them.
        """
        patch = self.patches.patch_of(self.pair.points_mm) == np.arange(len(self.patches.anchors_mm))[:, None]
        sums = (self.patches.weight * patch) @ self.pair.normals
        midway = -(sums / np.linalg.norm(sums, axis=1, keepdims=True)).sum(axis=0)
        ways = (self.placement.pressing, midway / np.linalg.norm(midway))
        return min(float(np.degrees(np.arccos(np.abs(way).max()))) for way in ways) if self.joint.pressing else 0.0


def joint_geometry(
    meshes: Mapping[str, TriangleMesh], kind: str | None = None, *, upright: bool = True, most_tilt_deg: float = 15.0
) -> JointGeometry:
    """Analyse the "moving" and the "fixed" mesh.

    upright: if the moving body presses across the axes of the files, rotate both and analyse them again. Raises
    ValueError for meshes that do not touch, or not in as many places as the kind of joint has.
    """
    meshes = {body: without_specks(mesh) for body, mesh in meshes.items()}
    geometry = _analysed(meshes, kind, np.eye(3))
    if not upright or geometry.tilt_deg <= most_tilt_deg:
        return geometry
    pressing = geometry.placement.pressing
    axis = np.sign(pressing) * (np.abs(pressing) == np.abs(pressing).max())
    turn, _ = Rotation.align_vectors(axis[None], pressing[None])
    return _analysed(meshes, kind, turn.as_matrix())


def without_specks(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh without loose pieces of less than 1 % of its largest piece's area, as segmentation leaves them, if these
    make up less than 5 % of its area."""
    areas = np.bincount(mesh.pieces, mesh.areas_mm2)
    small = np.flatnonzero(areas < 0.01 * areas.max())
    if not len(small) or areas[small].sum() > 0.05 * areas.sum():
        return mesh
    return mesh.part(~np.isin(mesh.pieces, small))


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
    joint, contact_areas = joint_of(pair, placement, patches, kind), len(patches.anchors_mm)
    if kind is None and contact_areas > 1 and not patches_are_independent(pair, placement, patches, joint):
        patches = find_patches(pair, placement, parted=False)
        joint = joint_of(pair, placement, patches)
    return JointGeometry(pair, placement, patches, joint, turn, contact_areas)


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
        if count == 1:
            kind = "hip" if encloses and patches.hollow else "other"
        else:
            kind = "patella" if _angle_deg(pair, patches) > groove_deg else "knee"
            kind = kind if count == 2 and pair.scale == 1.0 else "other"  # as large as a knee
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


def patches_are_independent(
    pair: Pair, placement: ContactPlacement, patches: Patches, joint: Joint, least_ratio: float = 0.1
) -> bool:
    """Whether the sensitive pose parameters can shift load between the patches.

    The mean gaps of the patches have a Jacobian with respect to the two parameters; it must have a ratio of singular
    values above `least_ratio`. A spool in a notch fails: a rotation about its axis changes no gap.
    """
    pressed, beside = (np.eye(3)[int(axis)] for axis in (np.abs(placement.pressing).argmax(), patches.axis or 0))
    patch, axis = patches.patch_of(pair.points_mm), np.cross(pressed, beside)
    shares = patches.weight * (patch == np.arange(len(joint.patches))[:, None])
    shares /= shares.sum(axis=1, keepdims=True)
    second = pair.normals @ beside
    if joint.kind != "patella":
        across = np.eye(3) - np.outer(axis, axis)
        normals, sizes = pair.normals @ across, np.linalg.norm(pair.normals @ across, axis=1)
        used = sizes > 0.5  # a normal along the axis has no direction across it
        points = pair.points_mm @ across
        pivot = centre_of_normals(points[used], (normals[used].T / sizes[used]).T, patches.weight[used])
        second = np.cross(points - pivot, normals) @ axis / (0.5 * np.ptp(shares @ points @ beside))
    jacobian = shares @ np.stack([pair.normals @ pressed, second], axis=1)
    singular = np.linalg.svd(jacobian, compute_uv=False)
    return bool(singular[1] > least_ratio * singular[0])


def _angle_deg(pair: Pair, patches: Patches) -> float:
    """Angle between the mean normals of the first and the last patch."""
    patch, means = patches.patch_of(pair.points_mm), []
    for number in (0, len(patches.cuts_mm)):
        mean = (patches.weight * (patch == number)) @ pair.normals
        means.append(mean / max(float(np.linalg.norm(mean)), 1e-300))
    return float(np.degrees(np.arccos(np.clip(means[0] @ means[1], -1.0, 1.0))))
