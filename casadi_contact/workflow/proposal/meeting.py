"""How two bodies meet: whether their files share a frame, and which way the moving one presses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.workflow.proposal.pair import Pair

REACH_MM = 2.0
_DEEPEST_MM = 4.0  # bodies scanned together overlap less
_LEAST_SHARE = 0.03  # of the fixed surface that is near, for the files to share a frame
_PARALLEL, _MOST = 0.998, 0.6  # cos to the mean normal, and of which share of the area: edges are rounded, and of holes
_PLANES_COUNT = 0.2  # of their area
_INSIDE_OUT = 2.0  # times the area, over which an open moving surface meets the fixed one turned round


@dataclass(frozen=True, eq=False)
class Meeting:
    """together: the files place both bodies in one frame, so that the pose zero is as scanned. pressing (3,): unit
    vector along which the moving body presses. translation_mm (3,): where it touches, unturned. concentration: length
    of the mean outward normal of the fixed surface nearby, 1 for a plane, 1/2 for a half-sphere."""

    together: bool
    pressing: Array
    translation_mm: Array
    concentration: float


def meeting_of(pair: Pair) -> Meeting:
    """Find it from the pose zero if the bodies just touch there, else by dropping the moving body onto the fixed one
    along each axis, both ways. Raises ValueError where they meet nowhere, and where an open fixed surface is
    inside out."""
    if (here := _as_placed(pair)) is not None:
        return here
    if pair.is_open and _near_as_placed(pair, backs=True) is not None:
        raise ValueError(
            "where the files place them the bodies nearly touch, but the fixed surface faces away from the moving one, "
            "expected its outside towards it: turn its triangles round"
        )
    found = _dropped(pair)
    if found is None:
        raise ValueError("the bodies meet along no axis: are both surfaces' outsides turned to each other?")
    return found


def check_moving_outside(pair: Pair, meeting: Meeting) -> None:
    """Raise ValueError for an open moving surface that is inside out: turned round it would meet the fixed one over a
    far larger area. A hollow one, as a cup on a ball, meets it over more as it is."""
    if not len(pair.moving.boundary_edges):
        return
    turned = pair.turned_round()
    other = _as_placed(turned) or _dropped(turned)
    if other is None:
        return
    area, turned_area = _area_mm2(pair, meeting), _area_mm2(turned, other)
    if turned_area > _INSIDE_OUT * area:
        raise ValueError(
            f"the moving surface {pair.moving.name} comes near the fixed one over {area:.3g} mm², and over "
            f"{turned_area:.3g} mm² with its inside out, expected its outside towards it: turn its triangles round"
        )


def _as_placed(pair: Pair) -> Meeting | None:
    """How they meet where the files place them, if they just touch there."""
    near = _near_as_placed(pair)
    if near is None:
        return None
    pressing, concentration = _pressing(pair, near)
    return Meeting(True, pressing, pair.touching(np.eye(3), np.zeros(3), pressing), concentration)


def _near_as_placed(pair: Pair, *, backs: bool = False) -> np.ndarray | None:
    """What of the fixed surface (n,) is near the moving body where the files place them; None where that is too little,
    or the bodies pierce each other. backs: of what faces away from it."""
    near = pair.near(np.eye(3), np.zeros(3), pair.scale * REACH_MM, backs=backs)
    deepest = -float(pair.distances(np.eye(3), np.zeros(3))[0].min())
    touch = deepest < pair.scale * _DEEPEST_MM and pair.areas_mm2[near].sum() > _LEAST_SHARE * pair.areas_mm2.sum()
    return near if touch else None


def _dropped(pair: Pair) -> Meeting | None:
    """How they meet along the axis along which most of the fixed surface comes near. Planes that meet, such as the
    backs of two parts, count less: all of a plane comes near at once, and of a ball in its trough little does."""
    middle = 0.5 * (pair.points_mm.min(axis=0) + pair.points_mm.max(axis=0))
    ends = pair.moving.vertices_mm
    centred = middle - 0.5 * (ends.min(axis=0) + ends.max(axis=0))
    best, found = 0.0, None
    for start in (np.zeros(3), centred):
        for direction in np.vstack([-np.eye(3), np.eye(3)])[[1, 4, 0, 2, 3, 5]]:
            touched = pair.dropped(np.eye(3), start, direction)
            if touched is None:
                continue
            near = pair.near(np.eye(3), touched, pair.scale * REACH_MM) & (pair.normals @ direction < 0.0)
            size = float(pair.areas_mm2[near].sum())
            if _planes(pair, near, touched):
                size *= _PLANES_COUNT
            if size > 1.2 * best:  # an earlier one, along y and as in the files, unless another is clearly better
                best, found = size, Meeting(False, direction, touched, _pressing(pair, near)[1])
    return found


def _planes(pair: Pair, near: np.ndarray, translation_mm: Array) -> bool:
    """Whether both bodies are plane where they meet: most normals of each are parallel."""
    slopes = pair.distances(np.eye(3), translation_mm)[1][near]
    area = pair.areas_mm2[near]
    if not area.sum():
        return False
    for normals in (pair.normals[near], slopes / np.linalg.norm(slopes, axis=1, keepdims=True)):
        mean = area @ normals / np.linalg.norm(area @ normals)
        if area @ (normals @ mean > _PARALLEL) < _MOST * area.sum():
            return False
    return True


def _area_mm2(pair: Pair, meeting: Meeting) -> float:
    """Of the fixed surface that is near where they touch."""
    near = pair.near(np.eye(3), meeting.translation_mm, pair.scale * REACH_MM)
    return float(pair.areas_mm2[near].sum())


def _pressing(pair: Pair, near: np.ndarray) -> tuple[Array, float]:
    area = pair.areas_mm2[near]
    mean = area @ pair.normals[near] / max(area.sum(), 1e-300)
    length = float(np.linalg.norm(mean))
    return -mean / max(length, 1e-300), length
