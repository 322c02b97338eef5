"""Rays along the normals of the fixed surface, and where they end on the moving surface."""

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.surfaces import SmoothPatch
from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class RayHits:
    """Ray ends x = c - d·n on the moving surface, all arrays (n, ...), chart axes.

    N (..., 3), its length, distance g of c from the body, depth d; G the surface's unit normal (G_start: the gradient
    of g at c); its curvatures κ1 and κ2 along the unit vectors `across` and `along` its arcs; the arc's number.
    """

    c: Array
    N: Array
    length: Array
    g: Array
    depth: Array
    x: Array
    G: Array
    G_start: Array
    across: Array
    along: Array
    kappa_1: Array
    kappa_2: Array
    arc: np.ndarray

    @property
    def tangents(self) -> Array:
        """τ_u, τ_v (..., 2, 3) of the fixed surface."""
        one, zero = np.ones_like(self.length), np.zeros_like(self.length)
        along_u, along_v = (one, -self.N[..., 0], zero), (zero, -self.N[..., 2], one)
        return np.stack([np.stack(along_u, -1), np.stack(along_v, -1)], -2)

    @property
    def cosine(self) -> Array:
        """σ = G·n, the cosine between surface and ray."""
        return np.asarray(np.sum(self.G * self.N, -1) / self.length)


def rise(ends: RayHits, du: Array, dv: Array) -> Array:
    """Slope G·(τ_u du + τ_v dv) of the distance from the body along (du, dv) in the chart."""
    G, N = ends.G, ends.N
    return np.asarray(du * (G[..., 0] - N[..., 0] * G[..., 1]) + dv * (G[..., 2] - N[..., 2] * G[..., 1]))


def fixed_point(patch: SmoothPatch, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """c and N (..., 3) of the fixed surface, and |N|."""
    if patch.torus is None:
        zero = np.zeros_like(u)
        return np.stack([u, zero, v + patch.z_0], -1), np.stack([zero, zero + 1.0, zero], -1), zero + 1.0
    f = patch.torus
    tube = np.sqrt(np.maximum(f.radius**2 - v * v, (patch.tuning.least_upright * f.radius) ** 2))
    rho = f.offset + f.rho_sign * tube
    w = np.sqrt(np.maximum(rho * rho - u * u, (patch.tuning.least_upright * rho) ** 2))
    slope_u, slope_v = -f.w_sign * u / w, -f.w_sign * f.rho_sign * rho * v / (tube * w)
    c = np.stack([u, f.height + f.w_sign * w, v + patch.z_0], -1)
    return c, np.stack([-slope_u, np.ones_like(u), -slope_v], -1), f.radius * rho / (tube * w)


def tube_frame(
    x: Array, y: Array, z: Array, offset: Array | float, least: float
) -> tuple[Array, Array, Array, Array, Array]:
    """For a point relative to a torus's axis (z): distance ρ from the axis, unit radius (x, y), ρ - offset, and the
    distance from the tube's centre; neither distance is below the least one [mm]."""
    rho = np.maximum(np.hypot(x, y), least)
    out = rho - offset
    return rho, x / rho, y / rho, out, np.maximum(np.hypot(out, z), least)


def arc_of(patch: SmoothPatch, qx: Array, qy: Array) -> np.ndarray:
    """Numbers (...) of the arcs in whose sectors points (qx, qy) (...) of the moving frame lie."""
    arc = np.full(qx.shape, len(patch.arcs) - 1)
    for k in range(len(patch.arcs) - 2, -1, -1):
        x, y, _, tx, ty = patch.arcs[k]
        arc = np.where((qx - x) * tx + (qy - y) * ty > 0.0, arc, k)
    return arc


def ray_hits(
    patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, *, arc: np.ndarray | None = None, at_start: bool = False
) -> RayHits:
    """Depths along the normals at (u, v) (n, ...) of the body at (R, t) (n, 3, 3), (n, 3), and the ends there.

    One Newton step of g(c - d·n) = 0, and what the curvature of g along the ray adds to it. arc (n, ...): the arcs on
    whose tori, also beyond their ends, rays end; each ray's own where it is below 0 or left out. at_start: nothing of
    the step, so that each ray ends at its fixed point.
    """
    c, N, length = fixed_point(patch, u, v)
    wide = (slice(None),) + (None,) * (u.ndim - 1)
    R, t = R[wide], t[wide]
    q = np.einsum("...ji,...j->...i", R, c - t)
    m = np.einsum("...ji,...j->...i", R, N)
    number = arc_of(patch, q[..., 0], q[..., 1])
    if arc is not None:
        number = np.where(arc < 0, number, arc)
    torus = patch.arcs[number]

    def field(q: Array) -> tuple[Array, ...]:
        """Distance from the body, and in its frame the gradient, the unit vectors across and along, κ1, κ2."""
        z = q[..., 2] - patch.centre_z
        x, y, offset = q[..., 0] - torus[..., 0], q[..., 1] - torus[..., 1], torus[..., 2]
        rho, ex, ey, out, distance = tube_frame(x, y, z, offset, patch.tuning.least_length)
        a, b = out / distance, z / distance
        gradient, across = np.stack([a * ex, a * ey, b], -1), np.stack([-b * ex, -b * ey, a], -1)
        along = np.stack([-ey, ex, np.zeros_like(ex)], -1)
        return distance - patch.tube_radius, gradient, across, along, 1.0 / distance, a / rho

    g, gradient, across, along, kappa_1, kappa_2 = field(q)
    slope = np.minimum(np.sum(gradient * m, -1), patch.tuning.steepest * length)
    bend = kappa_1 * np.sum(across * m, -1) ** 2 + kappa_2 * np.sum(along * m, -1) ** 2
    step = g / slope
    step = step + np.maximum(0.5 * step * bend / slope, patch.tuning.most_shorter) * step  # d in units of |N|
    start = gradient
    if at_start:
        step = np.zeros_like(step)
    _, gradient, across, along, _, kappa_2 = field(q - step[..., None] * m)
    kappa_1 = kappa_1 if at_start else np.full_like(kappa_1, 1.0 / patch.tube_radius)

    G, G_start, across, along = (np.einsum("...ij,...j->...i", R, w) for w in (gradient, start, across, along))
    x = c - step[..., None] * N
    return RayHits(c, N, length, g, step * length, x, G, G_start, across, along, kappa_1, kappa_2, number)


@dataclass(frozen=True)
class LocalDepth:
    """One ray from (u, v) in each of n poses: depth, its slopes (n, 2), relative curvatures (n, 2, 2), the end."""

    u: Array
    v: Array
    depth: Array
    gradient: Array
    curvature: Array
    ends: RayHits


def local_depth(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, *, at_start: bool = False) -> LocalDepth:
    """Depth at (u, v) with its slopes and its curvatures relative to the fixed surface; at_start: all of -g instead.

    With the fixed surface the zero of F, its tangents τ_u, τ_v and n_u = -∇²F τ_u: d_u = G·(τ_u + d ∇²F τ_u)/σ,
    k_uv = τ_u·(∇²g - ∇²F)τ_v.
    """
    ends = ray_hits(patch, R, t, u, v, at_start=at_start)
    tangents = ends.tangents
    fixed = np.zeros((len(u), 3, 3))
    if (f := patch.torus) is not None:
        rho, ex, ey, out, distance = tube_frame(u, ends.c[:, 1] - f.height, v, f.offset, patch.tuning.least_length)
        across = np.stack([-v * ex, -v * ey, out], -1) / distance[:, None]
        along = np.stack([-ey, ex, np.zeros_like(u)], -1)
        fixed = _rank_one(1.0 / distance, across) + _rank_one(out / (distance * rho), along)
    moving = _rank_one(ends.kappa_1, ends.across) + _rank_one(ends.kappa_2, ends.along)
    if at_start:
        slope = -np.einsum("nai,ni->na", tangents, ends.G)
        fixed = -(ends.length * ends.G[:, 1])[:, None, None] * fixed
    else:
        bent = tangents + ends.depth[:, None, None] * (tangents @ fixed)
        slope = np.einsum("nai,ni->na", bent, ends.G) / ends.cosine[:, None]
    curvature = tangents @ (moving - fixed) @ np.swapaxes(tangents, 1, 2)
    return LocalDepth(u, v, -ends.g if at_start else ends.depth, slope, curvature, ends)


def _rank_one(weight: Array, vector: Array) -> Array:
    return weight[:, None, None] * vector[:, :, None] * vector[:, None, :]
