"""The middle of a contact spot, from which the rays of polar quadrature run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.ends import tube_frame
from casadi_contact.contact.polar.nearest import nearest
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.rim import within
from casadi_contact.contact.polar.spot import LEAST_CURVATURE, Spot, bounded, spot_at
from casadi_contact.core.conventions import Array

MIDDLE_STEPS = 3
LEAST_CHORD_MM = 1e-3
OFF_TOP = 0.25  # part of the depth: a rise by more shows that the surfaces' normals are not parallel yet


def deepest(patch: SmoothPatch, R: Array, t: Array) -> tuple[Array, Array]:
    """(u, v) at which the surfaces face each other with parallel normals, whether within the rim or not.

    The moving tube's centre C is where the body reaches farthest along the direction, which points from the fixed
    tube's centre to C: a fixed point, from a start that is exact where the body is not tilted sideways.
    """
    direction = np.tile([0.0, -1.0, 0.0], (len(t), 1))
    if (f := patch.torus) is None:
        C = _reaching(patch, R, t, direction)
        return C[:, 0], C[:, 2] - patch.z_0
    arc = np.full(len(t), min(1, len(patch.arcs) - 1))
    for _ in patch.arcs:
        axis = t + np.einsum("nij,nj->ni", R, _at_centre(patch, patch.arcs[arc, :2]))
        flat = -f.w_sign * (axis[:, :2] - [0.0, f.height])
        size = np.linalg.norm(flat, axis=1, keepdims=True)
        np.divide(flat, size, out=direction[:, :2], where=size > 0.0)
        arc = _arc_along(patch, np.einsum("nji,nj->ni", R, direction))
    for _ in range(MIDDLE_STEPS):
        C = _reaching(patch, R, t, direction)
        z = C[:, 2] - patch.z_0
        _, ex, ey, out, distance = tube_frame(C[:, 0], C[:, 1] - f.height, z, f.offset)
        direction = np.stack([out * ex, out * ey, z], -1) / distance[:, None]
    return (f.offset + f.radius * out / distance) * ex, f.radius * z / distance


def _reaching(patch: SmoothPatch, R: Array, t: Array, direction: Array) -> Array:
    """Centre of the moving tube (n, 3) where the body reaches farthest along directions (n, 3)."""
    seen = np.einsum("nji,nj->ni", R, direction)[:, :2]
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    arc = patch.arcs[_arc_along(patch, seen)]
    return np.asarray(t + np.einsum("nij,nj->ni", R, _at_centre(patch, arc[:, :2] + arc[:, 2:3] * seen)))


def _at_centre(patch: SmoothPatch, xy: Array) -> Array:
    return np.column_stack([xy, np.full(len(xy), patch.centre_z)])


def _arc_along(patch: SmoothPatch, direction: Array) -> np.ndarray:
    """The arc on which the body reaches farthest along a direction of its own frame."""
    arc = np.full(len(direction), len(patch.arcs) - 1)
    for k in range(len(patch.arcs) - 2, -1, -1):
        arc = np.where(direction[:, :2] @ patch.arcs[k, 3:] > 0.0, arc, k)
    return arc


@dataclass(frozen=True)
class Middle:
    """The spot at the middle; form (n, 2, 2): of determinant 1, makes of a circle a curve like the edge of contact;
    whole (n,): the rim does not cut the spot.
    """

    spot: Spot
    form: Array
    whole: np.ndarray


def middle(patch: SmoothPatch, R: Array, t: Array) -> Middle:
    """The deepest point and the ellipse of the curvatures there, K^(-1/2); where the rim cuts the spot, the middle of
    chords through the point nearest to the body, and a form as long and wide as they are.

    Its depth is above zero exactly where some of the patch lies inside the body.
    """
    found = np.stack(deepest(patch, R, t))
    spot = spot_at(patch, R, t, *within(patch, *found))
    u, v, k, depth, (b_u, b_v) = spot.u, spot.v, spot.curvature, np.maximum(spot.depth, 0.0), spot.slope.T
    k_uu, k_uv, k_vv = k[:, 0, 0], k[:, 0, 1], k[:, 1, 1]
    determinant = np.maximum(k_uu * k_vv - k_uv**2, LEAST_CURVATURE**2)
    convex = (k_uu > 0.0) & (determinant > LEAST_CURVATURE**2)
    reach_u, reach_v = np.sqrt(2.0 * depth * np.where(convex, np.stack([k_vv, k_uu]), 0.0) / determinant)
    needed = [tuple(found), (u - reach_u, v), (u + reach_u, v), (u, v - reach_v), (u, v + reach_v)]
    whole = np.all([np.all(np.stack(within(patch, *point)) == np.stack(point), axis=0) for point in needed], axis=0)
    whole &= convex & (k_vv * b_u**2 - 2.0 * k_uv * b_u * b_v + k_uu * b_v**2 < OFF_TOP * depth * determinant)
    if not whole.all():
        u, v, cut = u.copy(), v.copy(), ~whole
        near = nearest(patch, R[cut], t[cut], u[cut], v[cut])
        u[cut], v[cut] = chord_middles(patch, R[cut], t[cut], near.u, near.v)
        spot = spot_at(patch, R, t, u, v)
    w = whole[:, None, None]
    return Middle(spot, np.where(w, _ellipse(np.where(w, spot.curvature, np.eye(2))), as_long(patch, spot)), whole)


def _ellipse(curvature: Array) -> Array:
    """K^(-1/2) of curvatures (n, 2, 2), scaled to a determinant of 1: (adj K + s·1)/√(s·(tr K + 2 s)), s = √det K."""
    k_uu, k_uv, k_vv = curvature[:, 0, 0], curvature[:, 0, 1], curvature[:, 1, 1]
    s = np.sqrt(k_uu * k_vv - k_uv**2)
    form = np.stack([np.stack([k_vv + s, -k_uv], -1), np.stack([-k_uv, k_uu + s], -1)], 1)
    return np.asarray(form / np.sqrt(s * (k_uu + k_vv + 2.0 * s))[:, None, None])


def as_long(patch: SmoothPatch, spot: Spot) -> Array:
    """The form (n, 2, 2) as long and wide as the chords through a spot."""
    begin, end = np.stack([_chord_ends(patch, spot, axis)[:, axis] for axis in (0, 1)], axis=1)
    length = np.maximum(end - begin, LEAST_CHORD_MM)
    ratio = np.sqrt(length[0] / length[1])
    return np.stack([ratio, 1.0 / ratio], -1)[:, :, None] * np.eye(2)


def _chord_ends(patch: SmoothPatch, spot: Spot, axis: int) -> Array:
    """(u, v) where a chord along u (0) or v (1) through a spot begins and ends (2, 2, n), estimated, within the rim."""
    depth, slope, k = np.maximum(spot.depth, 0.0), spot.slope[:, axis], spot.curvature[:, axis, axis]
    ends = np.tile(np.stack([spot.u, spot.v]), (2, 1, 1))
    for end, sign in zip(ends, (-1.0, 1.0), strict=True):
        end[axis] += sign * edge_distance(depth, sign * slope, k)
        end[:] = within(patch, *end)
    return ends


def chord_middles(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> tuple[Array, Array]:
    """Middle of the chord along u through (u, v), then of that along v through this middle.

    Nowhere more shallow than half the depth at (u, v): there a chord's ends, which are estimates, missed the spot.
    """
    for axis in (0, 1):
        spot = spot_at(patch, R, t, u, v)
        tried = np.stack(within(patch, *_chord_ends(patch, spot, axis).mean(axis=0)))
        deep = spot_at(patch, R, t, *tried).depth >= 0.5 * np.maximum(spot.depth, 0.0)
        u, v = np.where((spot.depth > 0.0) & deep, tried, [u, v])
    return u, v


def edge_distance(depth: Array, slope: Array, curvature: Array) -> Array:
    """r > 0 at which D + b·r - k·r²/2 = 0, for D >= 0."""
    k = bounded(curvature)
    return np.asarray((slope + np.sqrt(slope * slope + 2.0 * k * depth)) / k)
