"""Where the bodies come near each other over a sweep of poses, and the patches that this parts into."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from casadi_contact.core.conventions import Array, rotation
from casadi_contact.geometry.projection import LEAST_UPWARD
from casadi_contact.workflow.proposal.meeting import REACH_MM, Meeting
from casadi_contact.workflow.proposal.pair import Pair, axis_of_normals, centre_of_normals

_SPOT_MM = 1.0  # as near as two bodies that touch side by side; farther, the middle of a groove would count
_TURNS_DEG = (-15.0, 0.0, 15.0)  # about each axis
_BIN_MM = 1.0
_SMOOTH_BINS = 2.0
_VALLEY = 0.5  # of the lower of two peaks: a shallower valley parts nothing
_HOLLOW = 0.95  # of what comes near, seen from the middle of a cup
_STRAIGHT = 0.85  # cos of the angle at which most of it is seen there: of a saddle little is
_ABOUT_COS, _ABOUT = 0.985, 0.9  # of a ball's socket most is seen within 10 degrees, of a groove half within 10 to 16
_WALLS, _LEFT = 0.02, 0.2  # of what comes near, for a notch's axis to be needed; of that, what may be unseen from there
_ROUND = 0.95  # of what touches, for the moving body to bulge there: a ball all of it, a saddle some half
_LEAST_SHARE = 0.1  # of all that comes near, for a patch
SMALL_SHARE = 0.03  # for one that is asked for: beside a socket that fits closely the other condyle touches little
_EMPTY = 0.1  # of the lower of two peaks: where so little comes near, even a small place is one of its own


@dataclass(frozen=True, eq=False)
class Regions:
    """weight (n,): how often each fixed point was near, times its area and that of all that was near with it. axis: of
    the files, along which patches lie beside each other (None for one patch); cuts_mm: between neighbouring patches,
    rising. centre_mm (3,): of the fixed body's curvature where the bodies meet. anchors_mm (patches, 3): that of each
    patch, on the moving body's file. round: whether the moving body bulges all over where it touches, away from its
    anchors. hollow: whether the fixed body is a cup about the centre. cup_mm (3,): from where all of a cup or of a
    notch with steep walls is seen: the centre, or the nearest point on the notch's axis; None for other bodies.
    centred: whether most of the moving normals there run through the anchors, as all of a ball's do and few of a
    spool's, which turns about an axis. passed_over: whether a small place beside, clearly parted, counts as part of the
    one patch."""

    weight: Array
    axis: int | None
    cuts_mm: tuple[float, ...]
    centre_mm: Array
    anchors_mm: Array
    round: bool
    hollow: bool
    cup_mm: Array | None
    centred: bool
    passed_over: bool

    def patch_of(self, points_mm: Array) -> np.ndarray:
        """Number of the patch (n,) that each point belongs to, by rising coordinate."""
        if self.axis is None:
            return np.zeros(len(points_mm), dtype=int)
        return np.searchsorted(self.cuts_mm, points_mm[:, self.axis], side="right")


def regions_of(pair: Pair, meeting: Meeting, *, parted: bool = True, least_share: float = _LEAST_SHARE) -> Regions:
    """Turn the moving body a little about every axis, let it touch, and note what comes near; parted: in patches, where
    there are valleys between places, to each side at least this share of all that comes near. What lies about one
    centre, as a ball's socket, is one patch whatever pit or notch it has: no turn shifts load within it."""
    centre, pivot = _centre_and_pivot(pair, meeting)
    touched = []
    for angles in itertools.product(np.radians(_TURNS_DEG), repeat=3):
        R = rotation(angles)
        t = pair.touching(R, pivot - R @ (pivot - meeting.translation_mm), meeting.pressing)
        near = np.flatnonzero(pair.near(R, t, pair.scale * _SPOT_MM))
        touched.append((near, (pair.points_mm[near] - t) @ R, pair.distances(R, t)[1][near] @ R))
    weight = np.zeros(len(pair.points_mm))
    for near, _, _ in touched:
        weight[near] += pair.areas_mm2[near] * pair.areas_mm2[near].sum()  # what a corner touches tells little
    facing = np.einsum("nk,nk->n", _unit(centre - pair.points_mm), pair.normals)
    parted = parted and float(weight @ (np.abs(facing) > _ABOUT_COS)) < _ABOUT * float(weight.sum())
    across = [axis for axis in range(3) if parted and axis != int(np.abs(meeting.pressing).argmax())]
    best: tuple[float, int | None, tuple[float, ...]] = (1.0, None, ())
    there, emptiest = pair.areas_mm2 * (pair.normals @ meeting.pressing < 0), 1.0
    for axis in across:
        along = _along(pair.points_mm[:, axis], weight, there, pair.scale * _BIN_MM)
        depth, cuts = _valleys(*along, least_share)
        if cuts and depth < best[0]:
            best = (depth, axis, cuts)
        emptiest = min(emptiest, _valleys(*along, SMALL_SHARE)[0])
    seen, straight = (float(weight @ (facing > least)) for least in (LEAST_UPWARD, _STRAIGHT))
    hollow = seen > _HOLLOW * float(weight.sum()) and straight > 0.5 * float(weight.sum())
    found = Regions(
        weight,
        best[1],
        best[2],
        centre,
        np.zeros((0, 3)),
        round=True,
        hollow=hollow,
        cup_mm=centre if hollow else _within_notch(pair, weight, centre, meeting.pressing),
        centred=True,
        passed_over=best[1] is None and emptiest < _EMPTY,
    )
    patches = found.patch_of(pair.points_mm)
    rows, on_moving, slopes = (np.concatenate([each[k] for each in touched]) for k in range(3))
    anchors = [
        centre_of_normals(on_moving[which], _unit(slopes[which]), pair.areas_mm2[rows[which]])
        for which in (patches[rows] == number for number in range(len(best[2]) + 1))
    ]
    away = on_moving - np.array(anchors)[patches[rows]]
    areas = pair.areas_mm2[rows]
    outwards = np.einsum("nk,nk->n", _unit(away), _unit(slopes))
    bulging, straight = (float(areas @ seen) for seen in (outwards > 0.0, np.abs(outwards) > _STRAIGHT))
    return replace(
        found,
        anchors_mm=np.array(anchors),
        round=bulging > _ROUND * float(areas.sum()),
        centred=straight > 0.5 * float(areas.sum()),
    )


def _centre_and_pivot(pair: Pair, meeting: Meeting) -> tuple[Array, Array]:
    """The middle (3,) of the fixed body's curvature where the bodies touch, and what the moving body turns about: that,
    or a point towards the middle of its own from which it rolls no farther than it is near. About the middle of a
    shallow dish a condyle would roll from place to place, as if these were patches."""
    near, spot = (pair.near(np.eye(3), meeting.translation_mm, pair.scale * mm) for mm in (REACH_MM, _SPOT_MM))
    points, areas = pair.points_mm[near], pair.areas_mm2[near]
    slopes = _unit(pair.distances(np.eye(3), meeting.translation_mm)[1][near])
    fixed, moving = (centre_of_normals(points, normals, areas) for normals in (pair.normals[near], slopes))
    middle = areas @ points / areas.sum()
    if np.linalg.norm(fixed - middle) <= np.linalg.norm(moving - middle):
        return fixed, fixed
    rolled_mm = np.sin(np.radians(max(_TURNS_DEG))) * float(np.linalg.norm(fixed - moving))
    share = min(1.0, float(np.sqrt(pair.areas_mm2[spot].sum() / np.pi)) / rolled_mm)
    return fixed, moving + share * (fixed - moving)


def _within_notch(pair: Pair, weight: Array, centre: Array, pressing: Array) -> Array | None:
    """The point (3,) on a notch's axis nearest to the centre; None where nothing of what comes near is too steep to be
    seen along the direction of pressing, or much of it is not seen from that point either."""
    near = weight > 0.0
    on_axis, way = axis_of_normals(pair.points_mm[near], pair.normals[near], weight[near])
    point = on_axis + ((centre - on_axis) @ way) * way
    from_point = np.einsum("nk,nk->n", _unit(point - pair.points_mm), pair.normals)
    unseen, left = (float(weight @ (cos <= LEAST_UPWARD)) for cos in (-pair.normals @ pressing, from_point))
    return point if unseen > _WALLS * float(weight.sum()) and left < _LEFT * unseen else None


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _along(coordinate: Array, weight: Array, there: Array, bin_mm: float) -> tuple[Array, Array, Array]:
    """Middles (m,) of bins along a coordinate [mm], what comes near there, and which share of the surface it is. Where
    there is no surface, nothing comes near."""
    low, high = coordinate[weight > 0.0].min(), coordinate[weight > 0.0].max()
    edges = np.arange(low, max(high, low + bin_mm) + bin_mm, bin_mm)
    near, whole = (
        ndimage.gaussian_filter1d(np.histogram(coordinate, edges, weights=w)[0], _SMOOTH_BINS) for w in (weight, there)
    )
    return 0.5 * (edges[1:] + edges[:-1]), near, near / np.maximum(whole, 0.1 * whole.max())


def _valleys(middles: Array, near: Array, share: Array, least_share: float) -> tuple[float, tuple[float, ...]]:
    """How deep the deepest valley is (share of its lower peak) and where the valleys lie [mm], of what `_along` tells;
    least_share: of all that comes near, to each side of a valley."""
    cuts, depth, start = list[float](), 1.0, 0
    for k in range(1, len(share) - 1):
        if share[k] != share[max(start, 0) :].min() and not (share[k] <= share[k - 1] and share[k] < share[k + 1]):
            continue
        peak = min(share[start:k].max(initial=0.0), share[k + 1 :].max(initial=0.0))
        left, right = near[start:k].sum(), near[k + 1 :].sum()
        if share[k] < _VALLEY * peak and min(left, right) > least_share * near.sum():
            cuts.append(float(middles[k]))
            depth, start = min(depth, share[k] / peak), k
    return depth, tuple(cuts)
