"""What two meshes show of their joint, seen upright: bodies that were scanned askew are turned first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.workflow.proposal.damage import without_specks
from casadi_contact.workflow.proposal.joint import Joint, joint_of, patches_part
from casadi_contact.workflow.proposal.meeting import Meeting, check_moving_outside, meeting_of
from casadi_contact.workflow.proposal.pair import Pair
from casadi_contact.workflow.proposal.regions import SMALL_SHARE, Regions, regions_of

_TILTED_DEG = 15.0  # joints lie at lesser angles to the axes that they are drawn in


@dataclass(frozen=True, eq=False)
class Sight:
    """How the bodies meet, where, and as what joint, in the axes of their files; turned (3, 3): by which rotation of
    both files' points all of this was seen, the unit matrix for files that stand upright; places: in how many, side by
    side, the bodies come near each other: as many as patches, unless no pose shifts load between them."""

    pair: Pair
    meeting: Meeting
    regions: Regions
    joint: Joint
    turned: Array
    places: int

    @property
    def tilt_deg(self) -> float:
        """Between the way the moving body presses and the nearest axis; 0 for a cup, which encloses it. No more than
        the way midway between its patches: files may place the body nearer to one of them, on a slope."""
        ways = (self.meeting.pressing, self._midway)
        return min(float(np.degrees(np.arccos(np.abs(way).max()))) for way in ways) if self.joint.pressing else 0.0

    @property
    def _midway(self) -> Array:
        """The direction (3,) midway between those that the patches are pressed along."""
        patch = self.regions.patch_of(self.pair.points_mm) == np.arange(len(self.regions.anchors_mm))[:, None]
        sums = (self.regions.weight * patch) @ self.pair.normals
        middle = -(sums / np.linalg.norm(sums, axis=1, keepdims=True)).sum(axis=0)
        return np.asarray(middle / np.linalg.norm(middle))

    @property
    def turned_deg(self) -> float:
        """The angle of ``turned``."""
        return float(np.degrees(Rotation.from_matrix(self.turned).magnitude()))


def sight_of(meshes: Mapping[str, TriangleMesh], kind: str | None = None, *, upright: bool = True) -> Sight:
    """Look at the "moving" and the "fixed" mesh, without loose specks; upright: once more, turned, where the moving
    body presses across the axes of the files. Raises ValueError for meshes that do not meet, or not as the kind of
    joint asks."""
    meshes = {body: without_specks(mesh) for body, mesh in meshes.items()}
    seen = _seen(meshes, kind, np.eye(3))
    if not upright or seen.tilt_deg <= _TILTED_DEG:
        return seen
    pressing = seen.meeting.pressing
    axis = np.sign(pressing) * (np.abs(pressing) == np.abs(pressing).max())
    turned, _ = Rotation.align_vectors(axis[None], pressing[None])
    return _seen(meshes, kind, turned.as_matrix())


def _seen(meshes: Mapping[str, TriangleMesh], kind: str | None, turned: Array) -> Sight:
    moving, fixed = (
        TriangleMesh(mesh.name, mesh.vertices_mm @ turned.T, mesh.faces) for mesh in (meshes["moving"], meshes["fixed"])
    )
    pair = Pair.of(moving, fixed)
    meeting = meeting_of(pair)
    check_moving_outside(pair, meeting)
    regions = regions_of(pair, meeting)
    if kind == "hip" and regions.hollow:
        regions = regions_of(pair, meeting, parted=False)
    if kind in ("knee", "patella") and len(regions.anchors_mm) == 1:
        regions = regions_of(pair, meeting, least_share=SMALL_SHARE)
    joint, places = joint_of(pair, meeting, regions, kind), len(regions.anchors_mm)
    if kind is None and places > 1 and not patches_part(pair, meeting, regions, joint):
        regions = regions_of(pair, meeting, parted=False)
        joint = joint_of(pair, meeting, regions)
    return Sight(pair, meeting, regions, joint, turned, places)
