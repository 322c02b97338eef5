"""Where polar quadrature puts its points: along each ray from the middle, its edge and its break."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.ends import LEAST_RISE, ray_ends, rise
from casadi_contact.contact.polar.middle import edge_distance
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.spot import Spot, bounded
from casadi_contact.conventions import Array

EDGE_STEPS = 2
BRACKET_STEPS = 12  # where the last of those moved an edge by more than a part of it
SETTLED = 0.1
_FAR_MM = 1e3


@dataclass(frozen=True)
class Rays:
    """Number of rays from the middle, and Gauss points on each of their two pieces."""

    count: int
    points: int

    def __str__(self) -> str:
        return f"{self.count} rays × {self.points} points"


@dataclass(frozen=True)
class RayPlan:
    """Directions (n, m, 2) of the rays; distances (n, m) to edge and break; cut: the rim ends the ray."""

    directions: Array
    edge: Array
    junction: Array
    cut: np.ndarray


def ray_plan(patch: SmoothPatch, R: Array, t: Array, m: Spot, rays: Rays) -> RayPlan:
    """Edge and break of every ray from the middle."""
    angle = 2.0 * np.pi * (np.arange(rays.count) + 0.5) / rays.count
    directions = m.scale[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    u, v = m.u[:, None], m.v[:, None]
    depth = np.maximum(m.depth, 0.0)[:, None]
    slope = np.einsum("nr,njr->nj", m.slope, directions)
    k = bounded(np.einsum("njr,nrs,njs->nj", directions, m.curvature, directions))
    junction, beyond = _junctions(patch, R, t, m, directions)
    reach = _rim_distance(patch, u, v, directions)
    # Beyond the junction the depth goes on with the next arc's curvature.
    k_next = bounded(k + beyond)
    left = np.maximum(depth + slope * junction - 0.5 * k * junction**2, 0.0)
    extended = junction + edge_distance(left, slope - k * junction, k_next)
    plain = edge_distance(depth, slope, k)
    edge = np.minimum(np.where(junction < plain, extended, plain), reach)
    du, dv = np.moveaxis(directions, -1, 0)
    for _ in range(EDGE_STEPS):  # Newton's, of g = 0 along the ray
        g, slope_along = _along(patch, R, t, u + edge * du, v + edge * dv, directions)
        last, moved = edge, edge - g / slope_along
        edge = np.minimum(np.clip(moved, 0.5 * edge, 2.0 * edge), reach)
    far = np.flatnonzero((np.abs(edge - last) > SETTLED * last).any(axis=1))
    if len(far):
        edge[far] = _bracketed(patch, R[far], t[far], u[far], v[far], directions[far], edge[far], reach[far])
    return RayPlan(directions, edge, np.minimum(junction, edge), edge >= reach)


def _bracketed(
    patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, directions: Array, edge: Array, reach: Array
) -> Array:
    """Edges by Newton's method between a point within the body and one beyond it, halved where a step leaves them."""
    du, dv = np.moveaxis(directions, -1, 0)
    low, high = np.zeros_like(edge), reach
    for _ in range(BRACKET_STEPS):
        g, slope_along = _along(patch, R, t, u + edge * du, v + edge * dv, directions)
        low, high = np.where(g < 0.0, edge, low), np.where(g < 0.0, high, edge)
        moved = np.minimum(edge - g / slope_along, reach)
        edge = np.where((moved >= low) & (moved <= high), moved, 0.5 * (low + high))
    return edge


def _along(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, directions: Array) -> tuple[Array, Array]:
    """g at points of the rays and its slope along them, not below a least one."""
    ends = ray_ends(patch, R, t, u, v, at_start=True)
    return ends.g, np.maximum(rise(ends, *np.moveaxis(directions, -1, 0)), LEAST_RISE)


def _junctions(patch: SmoothPatch, R: Array, t: Array, m: Spot, directions: Array) -> tuple[Array, Array]:
    """Distance along every ray to the nearest junction of arcs, and how much its curvature is more beyond it."""
    nearest = np.full(directions.shape[:2], _FAR_MM)
    change = np.zeros_like(nearest)
    if len(patch.arcs) == 1:
        return nearest, change
    ends, arcs = m.ends, patch.arcs
    end = np.einsum("nji,nj->ni", R, ends.x - t)[:, :2]
    one, zero = np.ones_like(m.u), np.zeros_like(m.u)
    tangents = np.stack([np.stack([one, -ends.N[:, 0], zero], -1), np.stack([zero, -ends.N[:, 2], one], -1)], 1)
    tangent = directions @ tangents
    rho = np.hypot(*(end - arcs[ends.arc, :2]).T)
    lean = ends.kappa_2 * rho
    bend = np.einsum("nmi,ni->nm", tangent, ends.along) ** 2
    for step in (0, 1):
        here = np.clip(ends.arc + step - 1, 0, len(arcs) - 2)
        exists = (ends.arc + step - 1 == here)[:, None]
        last = arcs[here]
        normal = np.einsum("nij,nj->ni", R[:, :, :2], last[:, 3:])
        at = np.sum((end - last[:, :2]) * last[:, 3:], axis=1)[:, None]
        rate = np.einsum("nmi,ni->nm", tangent, normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -at / rate
        other = arcs[np.clip(ends.arc + 2 * step - 1, 0, len(arcs) - 1)]
        kappa_next = lean / np.maximum(rho + other[:, 2] - arcs[ends.arc, 2], 1e-12)
        closer = exists & (distance > 0.0) & (distance < nearest)
        nearest = np.where(closer, distance, nearest)
        change = np.where(closer, (kappa_next - ends.kappa_2)[:, None] * bend, change)
    return nearest, change


def _rim_distance(patch: SmoothPatch, u: Array, v: Array, directions: Array) -> Array:
    """Distance along every ray to the rim.

    A curved side, u = ±spread·ρ(v), is an ellipse in the chart: A·r² + 2·B·r + C = 0.
    """
    du, dv = np.moveaxis(directions, -1, 0)
    distance = np.maximum((np.where(dv > 0.0, patch.rim.v[1], patch.rim.v[0]) - v) / dv, 0.0)
    if patch.torus is None or np.isinf(patch.rim.spread):
        return np.minimum(distance, np.maximum((np.where(du > 0.0, patch.rim.u[1], patch.rim.u[0]) - u) / du, 0.0))
    f = patch.torus
    for side in (-patch.rim.spread, patch.rim.spread):
        from_centre = u - side * f.offset
        a, b = du**2 + (side * dv) ** 2, du * from_centre + side**2 * v * dv
        c = from_centre**2 - side**2 * (f.radius**2 - v * v)
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        # The patch lies outside the ellipse where the tube is bent away from the axis, else inside.
        meets = (b < 0.0) & (b * b > a * c) if f.rho_sign < 0.0 else np.full(b.shape, True)
        there = np.maximum((f.rho_sign * root - b) / a, 0.0)
        distance = np.where(meets, np.minimum(distance, there), distance)
    return distance
