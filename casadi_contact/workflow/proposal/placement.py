"""How two bodies come into contact: whether their files share a frame, and which way the moving one presses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.workflow.proposal.pair import Pair, unit_rows

REACH_MM = 2.0  # surfaces nearer than this count as near contact


@dataclass(frozen=True, eq=False)
class ContactPlacement:
    """Where the moving body touches the fixed one.

    together: the files place both bodies in one frame, so that the pose zero is as scanned. pressing (3,): unit vector
    along which the moving body presses. translation_mm (3,): where it touches, unrotated. concentration: length of the
    mean outward normal of the fixed surface nearby, 1 for a plane, 1/2 for a half-sphere.
    """

    together: bool
    pressing: Array
    translation_mm: Array
    concentration: float


def contact_placement(pair: Pair) -> ContactPlacement:
    """The placement of the files if the bodies just touch there, else that of a drop along one of the axes.

    Raises ValueError for bodies that do not touch, and for surfaces that are inside out.
    """
    placement = _as_placed(pair)
    if placement is None and pair.is_open and _near_as_placed(pair, backs=True) is not None:
        raise ValueError(
            "where the files place them the bodies nearly touch, but the fixed surface faces away from the moving one, "
            "expected its outside towards it: turn its triangles round"
        )
    placement = placement or _after_drop(pair)
    if placement is None:
        raise ValueError("the bodies meet along no axis: are both surfaces' outsides turned to each other?")
    _check_moving_outside(pair, placement)
    return placement


def _check_moving_outside(pair: Pair, placement: ContactPlacement, most_gain: float = 2.0) -> None:
    """Raise ValueError for an open moving surface whose reverse would be near the fixed one over a far larger area."""
    if not len(pair.moving.boundary_edges):
        return
    turned = pair.turned_inside_out()
    other = _as_placed(turned) or _after_drop(turned)
    if other is None:
        return
    area, turned_area = _near_area_mm2(pair, placement), _near_area_mm2(turned, other)
    if turned_area > most_gain * area:
        raise ValueError(
            f"the moving surface {pair.moving.name} comes near the fixed one over {area:.3g} mm², and over "
            f"{turned_area:.3g} mm² with its inside out, expected its outside towards it: turn its triangles round"
        )


def _as_placed(pair: Pair) -> ContactPlacement | None:
    """The placement of the files if the bodies just touch there."""
    near = _near_as_placed(pair)
    if near is None:
        return None
    pressing, concentration = _pressing(pair, near)
    return ContactPlacement(True, pressing, pair.touching(np.eye(3), np.zeros(3), pressing), concentration)


def _near_as_placed(
    pair: Pair, *, backs: bool = False, deepest_mm: float = 4.0, least_share: float = 0.03
) -> np.ndarray | None:
    """Mask (n,) of the fixed surface near the moving body where the files place them (backs: facing away from it).

    None if the bodies overlap too deeply, or less than `least_share` of the fixed surface is near.
    """
    near = pair.near(np.eye(3), np.zeros(3), pair.scale * REACH_MM, backs=backs)
    depth = -float(pair.distances(np.eye(3), np.zeros(3))[0].min())
    touch = depth < pair.scale * deepest_mm and pair.areas_mm2[near].sum() > least_share * pair.areas_mm2.sum()
    return near if touch else None


def _after_drop(pair: Pair, plane_weight: float = 0.2) -> ContactPlacement | None:
    """The drop along an axis after which most of the fixed surface is near.

    Two planes that meet, such as the backs of two parts, count less: a plane comes near as a whole, a ball does not.
    """
    middle = 0.5 * (pair.points_mm.min(axis=0) + pair.points_mm.max(axis=0))
    vertices = pair.moving.vertices_mm
    centred = middle - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    largest, placement = 0.0, None
    for start in (np.zeros(3), centred):
        for direction in np.vstack([-np.eye(3), np.eye(3)])[[1, 4, 0, 2, 3, 5]]:
            touched = pair.dropped(np.eye(3), start, direction)
            if touched is None:
                continue
            near = pair.near(np.eye(3), touched, pair.scale * REACH_MM) & (pair.normals @ direction < 0.0)
            area = float(pair.areas_mm2[near].sum())
            if _are_planes(pair, near, touched):
                area *= plane_weight
            if area > 1.2 * largest:  # prefer earlier directions: y first, and the files' own translation
                largest, placement = area, ContactPlacement(False, direction, touched, _pressing(pair, near)[1])
    return placement


def _are_planes(pair: Pair, near: np.ndarray, translation_mm: Array) -> bool:
    """Whether more than 60 % of either surface near contact is parallel to its mean."""
    area = pair.areas_mm2[near]
    if not area.sum():
        return False
    gradients = pair.distances(np.eye(3), translation_mm)[1][near]
    for normals in (pair.normals[near], unit_rows(gradients)):
        mean = area @ normals / np.linalg.norm(area @ normals)
        if area @ (normals @ mean > 0.998) < 0.6 * area.sum():
            return False
    return True


def _near_area_mm2(pair: Pair, placement: ContactPlacement) -> float:
    near = pair.near(np.eye(3), placement.translation_mm, pair.scale * REACH_MM)
    return float(pair.areas_mm2[near].sum())


def _pressing(pair: Pair, near: np.ndarray) -> tuple[Array, float]:
    """Minus the mean normal (3,) of the near surface, and the length of the mean before normalisation."""
    area = pair.areas_mm2[near]
    mean = area @ pair.normals[near] / max(area.sum(), 1e-300)
    length = float(np.linalg.norm(mean))
    return -mean / max(length, 1e-300), length
