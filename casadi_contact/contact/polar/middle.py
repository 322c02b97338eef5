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
class Middle:
    """Middle (u, v) of the spot of n poses; depth D there, its slopes (n, 2) and relative curvatures (n, 2, 2).

    nearest: (u, v) of the point of the patch deepest in the body, or nearest to it. ends: the ray from the middle.
    """

    u: Array
    v: Array
    slope: Array
    curvature: Array
    nearest: tuple[Array, Array]
    ends: Ends


def deepest(patch: SmoothPatch, R: Array, t: Array) -> tuple[Array, Array]:
    """(u, v) at which the surfaces face each other with parallel normals, whether within the rim or not.

    The moving tube's centre C is where the body reaches farthest along the direction, which points from the fixed
    tube's centre to C: a fixed point, from a start that is exact where the body is not tilted sideways.
    """
    count, f = len(t), patch.torus
    direction = np.tile([0.0, -1.0, 0.0], (count, 1))
    arc = np.full(count, min(1, len(patch.arcs) - 1))
    for _ in range(len(patch.arcs) if f else 0):
        axis = t + np.einsum("nij,nj->ni", R, _at_centre(patch, patch.arcs[arc, :2]))
        flat = -f.w_sign * (axis[:, :2] - [0.0, f.height])
        direction[:, :2] = flat / np.linalg.norm(flat, axis=1, keepdims=True)
        arc = _arc_along(patch, np.einsum("nji,nj->ni", R, direction))
    for _ in range(MIDDLE_STEPS):
        seen = np.einsum("nji,nj->ni", R, direction)[:, :2]
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        arc = patch.arcs[_arc_along(patch, seen)]
        C = t + np.einsum("nij,nj->ni", R, _at_centre(patch, arc[:, :2] + arc[:, 2:3] * seen))
        if f is None:
            return C[:, 0], C[:, 2] - patch.z_0
        z = C[:, 2] - patch.z_0
        _, ex, ey, out, distance = tube_frame(C[:, 0], C[:, 1] - f.height, z, f.offset)
        direction = np.stack([out * ex, out * ey, z], -1) / distance[:, None]
    return (f.offset + f.radius * out / distance) * ex, f.radius * z / distance


def _at_centre(patch: SmoothPatch, xy: Array) -> Array:
    return np.column_stack([xy, np.full(len(xy), patch.centre_z)])


def _arc_along(patch: SmoothPatch, direction: Array) -> np.ndarray:
    """The arc on which the body reaches farthest along a direction of its own frame."""
    arc = np.full(len(direction), len(patch.arcs) - 1)
    for k in range(len(patch.arcs) - 2, -1, -1):
        arc = np.where(direction[:, :2] @ patch.arcs[k, 3:] > 0.0, arc, k)
    return arc


def local_depth(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> tuple[Array, Array, Ends]:
    """Slopes of the depth at (u, v) (n, 2), its curvatures relative to the fixed surface (n, 2, 2), the ray there.

    With the fixed surface the zero of F, its tangents τ_u, τ_v and n_u = -∇²F τ_u: d_u = G·(τ_u + d ∇²F τ_u)/σ,
    k_uv = τ_u·(∇²g - ∇²F)τ_v.
    """
    ends = ray_ends(patch, R, t, u, v)
    zero, one = np.zeros_like(u), np.ones_like(u)
    tangents = np.stack([np.stack([one, -ends.N[:, 0], zero], -1), np.stack([zero, -ends.N[:, 2], one], -1)], 1)
    fixed = np.zeros((len(u), 3, 3))
    if (f := patch.torus) is not None:
        rho, ex, ey, out, distance = tube_frame(u, ends.c[:, 1] - f.height, v, f.offset)
        across = np.stack([-v * ex, -v * ey, out], -1) / distance[:, None]
        along = np.stack([-ey, ex, zero], -1)
        fixed = _rank_one(1.0 / distance, across) + _rank_one(out / (distance * rho), along)
    moving = _rank_one(one / patch.tube_radius, ends.across) + _rank_one(ends.kappa_2, ends.along)
    bent = tangents + ends.depth[:, None, None] * (tangents @ fixed)
    slope = np.einsum("nai,ni->na", bent, ends.G) / ends.slope[:, None]
    return slope, tangents @ (moving - fixed) @ np.swapaxes(tangents, 1, 2), ends


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


def middle(patch: SmoothPatch, R: Array, t: Array) -> Middle:
    """The deepest point; where the rim cuts the spot, the middle of chords through the deepest point within it."""
    found = np.nan_to_num(np.stack(deepest(patch, R, t)))
    u, v = within(patch, *found)
    slope, k, ends = local_depth(patch, R, t, u, v)
    determinant = np.maximum(k[:, 0, 0] * k[:, 1, 1] - k[:, 0, 1] ** 2, _LEAST_CURVATURE**2)
    reach_u, reach_v = np.sqrt(2.0 * np.maximum(ends.depth, 0.0) * np.stack([k[:, 1, 1], k[:, 0, 0]]) / determinant)
    corners = [(u - reach_u, v), (u + reach_u, v), (u, v - reach_v), (u, v + reach_v), tuple(found)]
    cut = np.any([np.any(np.stack(within(patch, *p)) != np.stack(p), axis=0) for p in corners], axis=0)
    nearest = (u, v)
    if cut.any():
        nearest, centre = _within_rim(patch, R[cut], t[cut], u[cut], v[cut])
        nearest = tuple(_replaced(a, cut, b) for a, b in zip((u, v), nearest, strict=True))
        u, v = (_replaced(a, cut, b) for a, b in zip((u, v), centre, strict=True))
        slope, k, ends = local_depth(patch, R, t, u, v)
    return Middle(u, v, slope, k, nearest, ends)


def _replaced(values: Array, rows: np.ndarray, by: Array) -> Array:
    values = values.copy()
    values[rows] = by
    return values


def _within_rim(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> tuple[tuple[Array, Array], ...]:
    """The deepest point within the rim, by Newton steps cut at the rim; and the middle of chords through it."""
    for _ in range(RIM_STEPS):
        slope, k, _ = local_depth(patch, R, t, u, v)
        at_u, at_v = u, v
        for _ in range(RIM_STEPS):
            u = within(patch, at_u + (slope[:, 0] - k[:, 0, 1] * (v - at_v)) / bounded(k[:, 0, 0]), v)[0]
            u, v = within(patch, u, at_v + (slope[:, 1] - k[:, 0, 1] * (u - at_u)) / bounded(k[:, 1, 1]))
    slope, k, ends = local_depth(patch, R, t, u, v)
    depth = np.maximum(ends.depth, 0.0)
    low, high = (within(patch, u + s * edge_distance(depth, s * slope[:, 0], k[:, 0, 0]), v)[0] for s in (-1.0, 1.0))
    u_middle = np.where(depth > 0.0, 0.5 * (low + high), u)
    slope, k, ends = local_depth(patch, R, t, u_middle, v)
    depth = np.maximum(ends.depth, 0.0)
    low, high = (
        within(patch, u_middle, v + s * edge_distance(depth, s * slope[:, 1], k[:, 1, 1]))[1] for s in (-1.0, 1.0)
    )
    return (u, v), (u_middle, np.where(depth > 0.0, 0.5 * (low + high), v))


def bounded(curvature: Array) -> Array:
    return np.maximum(curvature, _LEAST_CURVATURE)


def edge_distance(depth: Array, slope: Array, curvature: Array) -> Array:
    """r > 0 at which D + b·r - k·r²/2 = 0, for D >= 0."""
    k = bounded(curvature)
    return np.asarray((slope + np.sqrt(slope * slope + 2.0 * k * depth)) / k)


