"""Which file axis is which of the library's, whether the joint is mirrored, and where the origins go."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.mesh import axes_rotation
from casadi_contact.geometry.placement import Placement
from casadi_contact.geometry.projection import axis_name
from casadi_contact.workflow.proposal.meeting import REACH_MM
from casadi_contact.workflow.proposal.pair import Pair
from casadi_contact.workflow.proposal.regions import Regions
from casadi_contact.workflow.proposal.sight import Sight

_FAR_MM = 50.0  # from a body to its file's origin: a scan's
_LEVER_MM = 2.0  # from a ball's centre to its file's origin, as far as a cup may be wider than its ball
_NOTCH_MM = 4.0  # half the width of the band between a femur's condyles
_CLEARLY_MM = 2.0


@dataclass(frozen=True)
class Frame:
    """axes as in a scene's geometry; placements of the two bodies; what is known of it, and what is not.

    rotation_deg: of both placements, where the bodies were seen turned; vectors and points are those that were seen.
    """

    axes: tuple[str, ...]
    mirror: str
    offsets_mm: dict[str, tuple[float, ...]]
    rotation_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    told: list[str] = field(default_factory=list)
    untold: list[str] = field(default_factory=list)

    def directions(self, vectors: Array) -> Array:
        """Vectors (..., 3) of the files in the library's axes."""
        return Placement(mirror=self.mirror).points(vectors @ axes_rotation(self.axes).T)

    def points(self, points_mm: Array, body: str) -> Array:
        """Points (n, 3) of a body's file [mm] in its frame."""
        return np.asarray(self.directions(points_mm) + self.offsets_mm[body])


def frame_of(sight: Sight, side: str | None = None, axes: Sequence[str] | None = None) -> Frame:
    """x posterior, y superior, z medial as far as the surfaces tell; a left joint is mirrored in z, which makes it a
    right one. axes: those of a scene's geometry, where they are known; ValueError where patches then lie side by side
    along another axis than z."""
    told = (
        [f"the bodies stand askew by {sight.turned_deg:.0f} degrees: turned, see placement"] if sight.turned_deg else []
    )
    untold: list[str] = []
    regions, joint = sight.regions, sight.joint
    if axes is not None and len(_side_by_side([tuple(axes)], regions)) == 0:
        raise ValueError(
            f"--axes {','.join(axes)}: the patches lie beside each other along the file's "
            f"{'xyz'[regions.axis or 0]}, expected it as the third axis, z"
        )
    mirror = "z" if side == "left" and joint.kind != "other" else ""
    if joint.kind != "other":
        told.append(f"a {side} joint, mirrored in z into a right one" if mirror else "a right joint")
        if side is None:
            untold.append("the side: taken as right (--side left mirrors it)")
    elif side is not None:
        untold.append(f"what {side} means here: only a knee, a hip or a patella is mirrored for its side (--joint)")
    known = tuple(axes) if axes is not None else _axes(sight, mirror, told, untold)
    to_library = Placement(mirror=mirror).points(axes_rotation(known).T).T
    offsets = _offsets(sight, to_library, told)
    turn = Rotation.from_matrix(to_library @ sight.turned @ to_library.T).as_euler("XYZ", degrees=True)
    return Frame(known, mirror, offsets, tuple(turn.round(4).tolist()), told, untold)


def _axes(sight: Sight, mirror: str, told: list[str], untold: list[str]) -> tuple[str, ...]:
    meeting, regions, joint = sight.meeting, sight.regions, sight.joint
    candidates, wanted = _side_by_side(_all_axes(), regions), {1: -meeting.pressing}
    if joint.kind == "patella":
        wanted = {0: meeting.pressing}
        told.append(f"the moving body presses along the file's {axis_name(meeting.pressing)}: posterior (+x)")
        untold.append("which way along the groove is superior: kept as in the file where it can be (--axes)")
    elif joint.kind == "hip":
        wanted = {1: meeting.pressing}
        level = meeting.pressing - meeting.pressing * (np.arange(3) == np.abs(meeting.pressing).argmax())
        wanted[2] = -level if mirror else level
        untold.append(
            f"which way is up and which medial: taken as the file's {axis_name(meeting.pressing)} and "
            f"{axis_name(level)}, the ways in which the cup is deep (--axes)"
        )
    else:
        told.append(f"the fixed surface faces the file's {axis_name(-meeting.pressing)}: up (+y)")
    if joint.kind == "knee":
        wanted[0] = _posterior(sight.pair, regions, told, untold)
    elif joint.kind == "other":
        untold.append("what x and z stand for: kept as in the file where they can be (--axes)")
    return _best(candidates, wanted)


def _side_by_side(candidates: list[tuple[str, ...]], regions: Regions) -> list[tuple[str, ...]]:
    """The axes whose z is the file's along which patches lie beside each other, if there are several."""
    if regions.axis is None:
        return candidates
    return [axes for axes in candidates if abs(axes_rotation(list(axes))[2, regions.axis]) > 0.5]


def _all_axes() -> list[tuple[str, ...]]:
    """The 24 rotations of axes, those nearest to the file's own first."""
    found = []
    for order in itertools.permutations("xyz"):
        for signs in itertools.product(("", "-"), repeat=3):
            axes = tuple(sign + axis for sign, axis in zip(signs, order, strict=True))
            matrix = np.array([[("-" + a == b) * -1.0 + (a == b) for a in "xyz"] for b in axes])
            if np.linalg.det(matrix) > 0.5:
                found.append((float(np.trace(matrix)), axes))
    return [axes for _, axes in sorted(found, key=lambda each: -each[0])]


def _best(candidates: list[tuple[str, ...]], wanted: dict[int, Array]) -> tuple[str, ...]:
    """The candidate whose axes lie nearest to the wanted directions; of equal ones the first."""

    def agreement(axes: tuple[str, ...]) -> float:
        rows = axes_rotation(axes)
        return sum(float(rows[row] @ direction) for row, direction in wanted.items())

    return max(candidates, key=lambda axes: round(agreement(axes), 6))


def _posterior(pair: Pair, regions: Regions, told: list[str], untold: list[str]) -> Array:
    """Between a femur's condyles there is a notch behind and the groove of the patella before."""
    assert regions.axis is not None
    across = [a for a in range(3) if a != regions.axis]
    flat = min(across, key=lambda a: abs(float((regions.weight @ pair.normals)[a])))
    ends = pair.moving.vertices_mm - pair.moving.vertices_mm.mean(axis=0)
    width = np.ptp(pair.moving.vertices_mm[:, regions.axis])
    middle = 0.5 * (pair.moving.vertices_mm[:, regions.axis].max() + pair.moving.vertices_mm[:, regions.axis].min())
    band = np.abs(pair.moving.vertices_mm[:, regions.axis] - middle) < max(pair.scale * _NOTCH_MM, 0.06 * width)
    ahead = float(ends[band, flat].mean()) if band.any() else 0.0
    posterior = -np.sign(ahead or -1.0) * np.eye(3)[flat]
    if abs(ahead) > pair.scale * _CLEARLY_MM:
        told.append(
            f"posterior is the file's {axis_name(posterior)}: the moving body's condyles are joined at its other end"
        )
    else:
        untold.append(
            f"which way is posterior: taken as the file's {axis_name(posterior)}; check that flexion is rz < 0"
        )
    return np.asarray(posterior)


def _offsets(sight: Sight, to_library: Array, told: list[str]) -> dict[str, tuple[float, ...]]:
    """What brings the bodies' origins to where they mean something; zero where the files' own do.

    Files whose origin lies far from the bodies: to what the moving body turns about, the middle of its curvature where
    it touches, of a ball in a cup to the cup's centre; the same for both bodies where the files place them together. A
    ball in a cup: its origin to its own centre in any case, or turning it would move it by more than the tenths of a
    millimetre that a cup leaves, and of a pose's translation nothing could be told; not a spool's in its notch, which
    turns about an axis. A knee of one scan: the fixed
    origin, which centres of pressure refer to, in x to the middle of contact and in z to between the patches, as a
    tray's.
    """
    pair, meeting, regions, joint = sight.pair, sight.meeting, sight.regions, sight.joint
    centre = regions.anchors_mm.mean(axis=0) + meeting.translation_mm if joint.pressing else regions.centre_mm
    origins = {}
    for body, points in (("moving", pair.moving.vertices_mm), ("fixed", pair.points_mm)):
        low, high = points.min(axis=0), points.max(axis=0)
        far = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)) > _FAR_MM
        origins[body] = centre if far else np.zeros(3)
        if far and body == "moving" and not meeting.together:
            origins[body] = centre - meeting.translation_mm
    if any(origin.any() for origin in origins.values()):
        if meeting.together:
            origins = dict.fromkeys(origins, centre)
        moved = " and ".join(body for body, origin in origins.items() if origin.any())
        told.append(
            f"the origin of the {moved} file lies far from the bodies: moved to what the moving body turns about, see "
            "placement"
        )
    lever_mm = float(np.linalg.norm(regions.anchors_mm[0]))
    if not joint.pressing and regions.centred and not origins["moving"].any() and lever_mm > pair.scale * _LEVER_MM:
        origins["moving"] = regions.anchors_mm[0]
        told.append(
            f"the moving body's origin lies {lever_mm:.3g} mm from what it turns about in its cup: moved there, see "
            "placement"
        )
    if joint.kind == "knee" and meeting.together:
        up = int(np.abs(meeting.pressing).argmax())
        origins["fixed"] = _middle(pair, meeting.translation_mm, regions) * (np.arange(3) != up) + origins["fixed"] * (
            np.arange(3) == up
        )
        told.append(
            "the fixed body's origin lies at the middle of contact, between the patches: centres of pressure refer to "
            "it; poses in the files' frame differ by its placement"
        )
    return {body: tuple((0.0 - to_library @ origin).round(3).tolist()) for body, origin in origins.items()}


def _middle(pair: Pair, translation_mm: Array, regions: Regions) -> Array:
    """The mean over the patches of what is near at touch; along the axis they part on, the cut between them [mm]."""
    weight = pair.areas_mm2 * pair.near(np.eye(3), translation_mm, pair.scale * REACH_MM)
    patch = regions.patch_of(pair.points_mm)
    middles = [weight[patch == p] @ pair.points_mm[patch == p] / weight[patch == p].sum() for p in np.unique(patch)]
    middle = np.mean(middles, axis=0)
    if regions.axis is not None:
        middle[regions.axis] = np.mean(regions.cuts_mm)
    return np.asarray(middle)
