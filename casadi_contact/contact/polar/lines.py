"""The lines in the chart along which polar quadrature integrates: rays from the peak of a contact area to its edge."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from casadi_contact.contact.polar.peak import Peak, edge_distance
from casadi_contact.contact.polar.ray_hits import ray_hits, rise
from casadi_contact.contact.polar.surfaces import SmoothPatch
from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class Lines:
    """Lines (n, m) from (u, v) along directions (n, m, 2) as far as the edge; a piece dr at a distance r stands for an
    area (width + spread·r) dr.

    arc: the arc of the moving body whose torus a line is integrated on, also beyond the arc's ends.
    """

    u: Array
    v: Array
    directions: Array
    edge: Array
    arc: np.ndarray
    width: Array
    spread: Array

    def at(self, r: Array) -> tuple[Array, Array]:
        """(u, v) at distances (n, m) or (n, m, points)."""
        more = (...,) + (None,) * (r.ndim - 2)
        du, dv = np.moveaxis(self.directions, -1, 0)
        return self.u[more] + r * du[more], self.v[more] + r * dv[more]

    def points(self, count: int) -> tuple[Array, Array]:
        """Distances and weights (n, m, count) of Gauss points."""
        x, weight = np.polynomial.legendre.leggauss(count)
        r = self.edge[..., None] * (0.5 * (1.0 + x))
        return r, self.edge[..., None] * (0.5 * weight) * (self.width[..., None] + self.spread[..., None] * r)


def joined(parts: list[Lines]) -> Lines:
    """All lines of several sets."""
    return Lines(*(np.concatenate([getattr(part, field.name) for part in parts], axis=1) for field in fields(Lines)))


def to_edges(patch: SmoothPatch, R: Array, t: Array, lines: Lines) -> tuple[Lines, np.ndarray]:
    """The lines with edges, so far estimates, found by Newton's method on g = 0, and which of them the rim ends."""
    reach = _rim_distance(patch, lines.u, lines.v, lines.directions)
    edge = last = np.minimum(lines.edge, reach)
    for _ in range(patch.tuning.edge_steps):
        last, edge = edge, _stepped(patch, R, t, lines, edge, reach)
    found = edge.copy()
    for search, part in ((_stepped, patch.tuning.edge_tolerance), (_bracketed, patch.tuning.bracket_from)):
        far = np.flatnonzero((np.abs(edge - last) > part * np.maximum(last, patch.tuning.least_length)).any(axis=1))
        if len(far):
            few = Lines(*(getattr(lines, field.name)[far] for field in fields(Lines)))
            found[far] = search(patch, R[far], t[far], few, found[far], reach[far])
    return replace(lines, edge=found), (found >= reach) & ((lines.width != 0.0) | (lines.spread != 0.0))


def _stepped(patch: SmoothPatch, R: Array, t: Array, lines: Lines, edge: Array, reach: Array) -> Array:
    """Edges after a step of Newton's method, at most half or twice as far as before."""
    g, slope = _along(patch, R, t, lines, edge)
    return np.minimum(np.clip(edge - g / slope, 0.5 * edge, 2.0 * edge), reach)


def _bracketed(patch: SmoothPatch, R: Array, t: Array, lines: Lines, edge: Array, reach: Array) -> Array:
    """Edges by Newton's method between a point within the body and one beyond it, halved where a step leaves them."""
    low, high = np.zeros_like(edge), reach
    for _ in range(patch.tuning.bracket_steps):
        g, slope = _along(patch, R, t, lines, edge)
        low, high = np.where(g < 0.0, edge, low), np.where(g < 0.0, high, edge)
        moved = np.minimum(edge - g / slope, reach)
        edge = np.where((moved >= low) & (moved <= high), moved, 0.5 * (low + high))
    return edge


def _along(patch: SmoothPatch, R: Array, t: Array, lines: Lines, r: Array) -> tuple[Array, Array]:
    """g at distances (n, m) and its slope along the lines, not below a least one."""
    ends = ray_hits(patch, R, t, *lines.at(r), arc=lines.arc, at_start=True)
    return ends.g, np.maximum(rise(ends, *np.moveaxis(lines.directions, -1, 0)), patch.tuning.least_rise)


def _rim_distance(patch: SmoothPatch, u: Array, v: Array, directions: Array) -> Array:
    """Distance along every line to the rim.

    A curved side, u = ±spread·ρ(v), is an ellipse in the chart: A·r² + 2·B·r + C = 0.
    """
    du, dv = np.moveaxis(directions, -1, 0)
    distance = _box_distance(patch.rim.v, v, dv)
    if patch.torus is None or np.isinf(patch.rim.spread):
        return np.minimum(distance, _box_distance(patch.rim.u, u, du))
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


def _box_distance(bounds: tuple[float, float], x: Array, dx: Array) -> Array:
    """Distance at which x + r·dx, from between the bounds, reaches one of them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = ((bound - x) / dx for bound in bounds)
    return np.maximum(np.fmax(low, high), 0.0)


@dataclass(frozen=True)
class Rays:
    """Number of rays from the peak, and Gauss points on each of them."""

    count: int
    points: int

    @property
    def in_caps(self) -> int:
        """Number of lines over each of the `curvature_jump_segments`: about as many as rays, a multiple of 8."""
        return min(max(self.count // 8 * 8, 8), 24)

    @property
    def at_rim(self) -> int:
        """Number of rays of a contact area that the rim may cut: their sum converges more slowly there."""
        return max(self.count, 32)

    def __str__(self) -> str:
        return f"{self.count} rays × {self.points} points"


def rays_from(patch: SmoothPatch, peak: Peak, rays: Rays) -> list[Lines]:
    """Rays from the peak through the torus of its arc, which goes on beyond the arc's ends; where the rim may cut the
    contact area through each ray's own. A set of rays has no area in the poses that it is not for."""
    return [_fan_out(patch, peak, rays.count, peak.whole[:, None]), *rays_at_rim(patch, peak, rays, ~peak.whole)]


def rays_at_rim(patch: SmoothPatch, peak: Peak, rays: Rays, used: np.ndarray) -> list[Lines]:
    """Rays from the peak where used (n,) through each ray's own torus; none if that is nowhere."""
    return [_fan_out(patch, peak, rays.at_rim, used[:, None])] if used.any() else []


def _fan_out(patch: SmoothPatch, peak: Peak, count: int, used: np.ndarray) -> Lines:
    m = peak.local
    cosine, sine = ray_angles(count)
    directions = np.einsum("nab,jb->nja", peak.form, np.stack([cosine, sine], -1))
    one = np.ones(directions.shape[:2])
    slope = np.einsum("nr,njr->nj", m.gradient, directions)
    k = np.einsum("njr,nrs,njs->nj", directions, m.curvature, directions)
    edge = edge_distance(np.maximum(m.depth, 0.0)[:, None], slope, k, patch.tuning.least_curvature)
    u, v, arc = (np.broadcast_to(x[:, None], one.shape) for x in (m.u, m.v, np.where(peak.whole, m.ends.arc, -1)))
    spread = np.where(used, 2.0 * np.pi / count, 0.0) * one
    return Lines(u, v, directions, np.where(used, edge, 0.0), arc, 0.0 * one, spread)


def ray_angles(count: int) -> tuple[Array, Array]:
    """Cosines and sines of equally spaced angles."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return np.cos(angle), np.sin(angle)
