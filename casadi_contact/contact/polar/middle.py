"""The middle of a contact spot, from which the rays of polar quadrature run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.ends import Ends, ray_ends, tube_frame
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.conventions import Array

MIDDLE_STEPS = 3
RIM_STEPS = 3  # of the fixed-point iteration for a curved rim, and of the search for the deepest point within it
_LEAST_CURVATURE = 1e-4  # [1/mm]


@dataclass(frozen=True)
class Spot:
    """One ray from (u, v) in each of n poses: depth, its slopes (n, 2), relative curvatures (n, 2, 2), the end."""

    u: Array
    v: Array
    depth: Array
    slope: Array
    curvature: Array
    ends: Ends


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
        direction[:, :2] = flat / np.linalg.norm(flat, axis=1, keepdims=True)
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


def spot_at(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, *, at_start: bool = False) -> Spot:
    """Depth at (u, v) with its slopes and its curvatures relative to the fixed surface; at_start: all of -g instead.

    With the fixed surface the zero of F, its tangents τ_u, τ_v and n_u = -∇²F τ_u: d_u = G·(τ_u + d ∇²F τ_u)/σ,
    k_uv = τ_u·(∇²g - ∇²F)τ_v.
    """
    ends = ray_ends(patch, R, t, u, v, at_start=at_start)
    zero, one = np.zeros_like(u), np.ones_like(u)
    tangents = np.stack([np.stack([one, -ends.N[:, 0], zero], -1), np.stack([zero, -ends.N[:, 2], one], -1)], 1)
    fixed = np.zeros((len(u), 3, 3))
    if (f := patch.torus) is not None:
        rho, ex, ey, out, distance = tube_frame(u, ends.c[:, 1] - f.height, v, f.offset)
        across = np.stack([-v * ex, -v * ey, out], -1) / distance[:, None]
        along = np.stack([-ey, ex, zero], -1)
        fixed = _rank_one(1.0 / distance, across) + _rank_one(out / (distance * rho), along)
    moving = _rank_one(ends.kappa_1, ends.across) + _rank_one(ends.kappa_2, ends.along)
    if at_start:
        slope = -np.einsum("nai,ni->na", tangents, ends.G)
        fixed = -(ends.length * ends.G[:, 1])[:, None, None] * fixed
    else:
        bent = tangents + ends.depth[:, None, None] * (tangents @ fixed)
        slope = np.einsum("nai,ni->na", bent, ends.G) / ends.slope[:, None]
    curvature = tangents @ (moving - fixed) @ np.swapaxes(tangents, 1, 2)
    return Spot(u, v, -ends.g if at_start else ends.depth, slope, curvature, ends)


def _rank_one(weight: Array, vector: Array) -> Array:
    return weight[:, None, None] * vector[:, :, None] * vector[:, None, :]


def u_range(patch: SmoothPatch, v: Array) -> tuple[Array, Array]:
    """Least and largest u of the patch at v."""
    if np.isinf(patch.rim.spread) or patch.torus is None:
        return np.full_like(v, patch.rim.u[0]), np.full_like(v, patch.rim.u[1])
    f = patch.torus
    half = patch.rim.spread * (f.offset + f.rho_sign * np.sqrt(f.radius**2 - v * v))
    return -half, half


def within(patch: SmoothPatch, u: Array, v: Array) -> tuple[Array, Array]:
    """The point (u, v) moved onto the patch, along u and along v."""
    v = np.clip(v, *patch.rim.v)
    low, high = u_range(patch, v)
    return np.clip(u, low, high), v


def middle(patch: SmoothPatch, R: Array, t: Array) -> Spot:
    """The deepest point; where the rim cuts the spot, the middle of chords through the deepest point within it."""
    found = np.stack(deepest(patch, R, t))
    spot = spot_at(patch, R, t, *within(patch, *found))
    u, v, k, depth = spot.u, spot.v, spot.curvature, np.maximum(spot.depth, 0.0)
    determinant = np.maximum(k[:, 0, 0] * k[:, 1, 1] - k[:, 0, 1] ** 2, _LEAST_CURVATURE**2)
    reach_u, reach_v = np.sqrt(2.0 * depth * np.stack([k[:, 1, 1], k[:, 0, 0]]) / determinant)
    needed = [tuple(found), (u - reach_u, v), (u + reach_u, v), (u, v - reach_v), (u, v + reach_v)]
    cut = np.any([np.any(np.stack(within(patch, *point)) != np.stack(point), axis=0) for point in needed], axis=0)
    if not cut.any():
        return spot
    inner = deepest_within(patch, R[cut], t[cut], u[cut], v[cut])
    u, v = u.copy(), v.copy()
    u[cut], v[cut] = _chord_middles(patch, R[cut], t[cut], inner)
    return spot_at(patch, R, t, u, v)


def nearest(patch: SmoothPatch, R: Array, t: Array, spot: Spot) -> Spot:
    """The point of the patch nearest to the body, from a spot close to it."""
    return deepest_within(patch, R, t, spot.u, spot.v, at_start=True)


def deepest_within(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, *, at_start: bool = False) -> Spot:
    """The deepest point within the rim by Newton steps cut at the rim (at_start: the nearest one)."""
    for _ in range(RIM_STEPS):
        spot = spot_at(patch, R, t, u, v, at_start=at_start)
        k = spot.curvature
        for _ in range(RIM_STEPS):
            u = spot.u + (spot.slope[:, 0] - k[:, 0, 1] * (v - spot.v)) / bounded(k[:, 0, 0])
            u, v = within(patch, u, v)
            v = spot.v + (spot.slope[:, 1] - k[:, 0, 1] * (u - spot.u)) / bounded(k[:, 1, 1])
            u, v = within(patch, u, v)
    return spot_at(patch, R, t, u, v, at_start=at_start)


def _chord_middles(patch: SmoothPatch, R: Array, t: Array, spot: Spot) -> tuple[Array, Array]:
    """Middle of the chord along u through a spot, then of that along v through this middle."""
    for axis in (0, 1):
        depth, slope, k = np.maximum(spot.depth, 0.0), spot.slope[:, axis], spot.curvature[:, axis, axis]
        ends = []
        for sign in (-1.0, 1.0):
            move = np.zeros((2, len(depth)))
            move[axis] = sign * edge_distance(depth, sign * slope, k)
            ends.append(np.stack(within(patch, spot.u + move[0], spot.v + move[1])))
        u, v = np.where(spot.depth > 0.0, 0.5 * (ends[0] + ends[1]), [spot.u, spot.v])
        spot = spot_at(patch, R, t, u, v)
    return u, v


def bounded(curvature: Array) -> Array:
    """The curvature, not below a least one."""
    return np.maximum(curvature, _LEAST_CURVATURE)


def edge_distance(depth: Array, slope: Array, curvature: Array) -> Array:
    """r > 0 at which D + b·r - k·r²/2 = 0, for D >= 0."""
    k = bounded(curvature)
    return np.asarray((slope + np.sqrt(slope * slope + 2.0 * k * depth)) / k)
