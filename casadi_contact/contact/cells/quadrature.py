"""Cubic cells in NumPy: the formulas of an elastic foundation whose gap is interpolated by cubics over a chart.

At a node c of the fixed surface with unit normal n, q = Rᵀ(c - t) lies in the frame of the moving body, whose signed
distance is g; G = R∇g. The depth is d = -g/m with m the smooth floor of σ = -G·n; where -g is large, d = s - g/m from a
second evaluation at c - s·n, s being -g at the node less `SMALL_MM`. Its slopes along the chart are
d_u = (-G·c_u + d·G·n_u)/m. In a cell, d at the sub-points follows from d, d_u, d_v at its corners by cubic Hermite
functions; the pressure of each is p(ψ(d)) with ψ the smoothed max(d, 0) (`basis.ramp`), and its force is shared out
bilinearly among the corners, whose (N, c × N) make the wrench.

A patch whose pressures sum up to less than nothing, at the very brink of contact where ψ dips, carries nothing: its
wrench is multiplied by a smooth step of ∫p dA from 0 to ``fade_n``. The kernel in C (``c/cells.h``) follows the same
formulas; each is the other's check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.cells.basis import Cells, corner_shares, hermite_functions, positive_ramp, ramp, smooth_step
from casadi_contact.contact.cells.patches import CellPatch
from casadi_contact.contact.elements.loops import STEEPEST_FIELD, point_distances
from casadi_contact.contact.pressure_law import pressure, pressure_slopes
from casadi_contact.contact.pressures import MOMENTS
from casadi_contact.core.conventions import Array, wrench_about_origin
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.geometry.surface_distances import distance_derivatives, distance_gradients

WIDTH_MM = 0.02  # of the smoothed max(d, 0)
FLATTEST, FLATTEST_WIDTH = 0.3, 0.1  # cos of the angle between ray and surface that flatter rays count as
STEEP_RAY, STEEP_RAY_WIDTH = 0.5, 0.25  # likewise: flatter rays than this and its width count less in the peak
SMALL_MM, SMALL_WIDTH_MM = 0.1, 0.05  # depths up to the first, within the second, need no second evaluation
DEEPEST_START_MM = 1.0  # second evaluations start within these depths
HIGHEST_START_MM = 0.3
FAR_MM, FAR_WIDTH_MM = 1.0, 0.5  # depths below minus the first are all alike, within the second
_LEAST_MM, _MOST_MM, _RADIUS_MM = 0.012, 0.18, 15.0  # of what interpolation is wrong by: see `touch_mm`
FADE_SHARE = 0.2  # of the scene's boundary load: ∫p dA below which a patch's loads fade out


@dataclass(frozen=True)
class PatchLoads:
    """A patch in one pose: wrench (6,), its derivatives by the twist of the moving body about t (6, 6), gap and its
    derivatives (6,), and whether contact reaches the rim."""

    wrench: Array
    stiffness: Array
    gap: float
    gap_slope: Array
    cut: bool


@dataclass(frozen=True)
class Quadrature:
    """A patch in cubic cells against a moving body: `law` is number, modulus and thickness (`contact.pressure_law`)."""

    patch: CellPatch
    cells: Cells
    body: MovingSurface
    law: tuple[int, float, float]
    fade_n: float

    def loads(self, R: Array, t: Array) -> PatchLoads:
        """The patch's loads at rotation (3, 3) and translation (3,)."""
        p = self.patch
        distance = point_distances(self.body.family, self.body.parameters, p.c, R, t)
        nearest = int(np.argmin(np.where(p.known, distance, np.inf)))
        gap, slope, _ = distance_derivatives(self.body, ((p.c[nearest] - t) @ R)[None])
        gap_slope = -wrench_about_origin(R @ slope[0], p.c[nearest] - t)
        touch = self._touch(R, t, distance)
        total, by_total = touch.total, -p.loads[touch.nodes.used].T @ self.slopes(touch)[0]
        fade, fade_slope = smooth_step(-total[6] / self.fade_n)
        wrench, stiffness = total[:6], by_total[:6]
        stiffness = fade * stiffness - np.outer(wrench, by_total[6]) * fade_slope / self.fade_n
        return PatchLoads(fade * wrench, stiffness, float(gap[0]), gap_slope, touch.cut)

    def wrench_and_cut(self, R: Array, t: Array) -> tuple[Array, bool]:
        """The patch's wrench (6,), and whether contact reaches the rim."""
        touch = self.touch(R, t)
        return smooth_step(-touch.total[6] / self.fade_n)[0] * touch.total[:6], touch.cut

    def pressures(self, R: Array, t: Array) -> tuple[Array, Array, Array]:
        """Middles (k, 3) [mm], areas (k,) [mm²] and mean pressures (k,) [MPa] of the cells."""
        p = self.patch
        values = self._nodes(R, t, np.arange(len(p.c))).values[p.corners].reshape(-1, 12)
        depths = np.maximum(ramp(values @ hermite_functions(self.cells), WIDTH_MM)[0], 0.0)
        share = p.present.mean(axis=1)
        mean = (pressure_slopes(*self.law, depths)[0] * p.present).mean(axis=1) / share
        return p.c[p.corners].mean(axis=1), p.loads[p.corners, 6].mean(axis=1) * share, mean

    def touch(self, R: Array, t: Array) -> Touch:
        """What touches in a pose."""
        return self._touch(R, t, point_distances(self.body.family, self.body.parameters, self.patch.c, R, t))

    def slopes(self, touch: Touch) -> tuple[Array, Array]:
        """Derivatives by the twist of the moving body: of the nodes' weights (m, 6), of depths (k, sub-points, 6)."""
        corners, nodes = touch.corners, touch.nodes
        by_depth = self._by_depth(self._slopes(nodes)[0], touch)
        shared = np.einsum("cr,kra->kca", corner_shares(self.cells), touch.stiffness[..., None] * by_depth)
        by_node = np.zeros((len(nodes.used), 6))
        np.add.at(by_node, corners.ravel(), shared.reshape(-1, 6))
        return by_node, by_depth

    def facing(self, touch: Touch) -> tuple[Array, Array]:
        """Depths (k, sub-points) that the largest is taken of, and their derivatives by the twist of the moving body
        (k, sub-points, 6).

        Where depth is largest, inside the rims, the body's surface faces the fixed one, σ = 1. At nodes where σ is
        small, beside an edge of the body, the nearest surface is its side, of which -g/m makes depths and slopes that
        are no part of the contact: their values count by a share that falls from 1 to `FLATTEST`, so that the depth
        becomes the distance to that side.
        """
        nodes = touch.nodes
        slopes, by_sigma = self._slopes(nodes)
        sigma = -np.einsum("ij,ij->i", nodes.G, self.patch.n[nodes.used])
        step, rise = smooth_step((sigma - STEEP_RAY) / STEEP_RAY_WIDTH)
        share = FLATTEST + (1.0 - FLATTEST) * step
        by_share = ((1.0 - FLATTEST) / STEEP_RAY_WIDTH * rise)[:, None] * by_sigma
        values = (share[:, None] * nodes.values)[touch.corners].reshape(-1, 12)
        slopes = share[:, None, None] * slopes + nodes.values[..., None] * by_share[:, None]
        return values @ hermite_functions(self.cells), self._by_depth(slopes, touch)

    def _by_depth(self, slopes: Array, touch: Touch) -> Array:
        """Derivatives by twist (k, sub-points, 6) of depths interpolated between nodes' values, from theirs."""
        by_corner = slopes[touch.corners].reshape(-1, 12, 6)
        return np.asarray(np.einsum("jr,kja->kra", hermite_functions(self.cells), by_corner, optimize=True))

    def _touch(self, R: Array, t: Array, distance: Array) -> Touch:
        """With the distances (m,) of the nodes from the body."""
        p = self.patch
        diagonal = np.linalg.norm(p.tangents, axis=2).sum(axis=1).max()
        cells = np.flatnonzero((distance[p.corners] < touch_mm(self.cells) + STEEPEST_FIELD * diagonal).any(axis=1))
        used, corners = np.unique(p.corners[cells], return_inverse=True)
        nodes, corners = self._nodes(R, t, used), corners.reshape(-1, 4)
        found = nodes.values[corners].reshape(-1, 12) @ hermite_functions(self.cells)
        depth, by_depth = ramp(found, WIDTH_MM)
        cut = bool(((depth > 0.0) & (p.present[cells] > 0.0) & p.rim[cells, None]).any())
        force, stiffness = _pressures(self.law, depth)
        weights = np.zeros(len(used))
        np.add.at(weights, corners.ravel(), (force * p.present[cells] @ corner_shares(self.cells).T).ravel())
        stiffness *= by_depth * p.present[cells]
        return Touch(nodes, cells, corners, found, stiffness, weights, -p.loads[used].T @ weights, cut)

    def _nodes(self, R: Array, t: Array, used: np.ndarray) -> _Nodes:
        p = self.patch
        c, n = p.c[used], p.n[used]
        g, slope = distance_gradients(self.body, (c - t) @ R)
        start, moves = _start(-g)
        by_start = moves[:, None] * wrench_about_origin(slope @ R.T, c - t)
        x = c - start[:, None] * n
        g, slope = distance_gradients(self.body, (x - t) @ R)
        G = slope @ R.T
        m = positive_floor(-np.einsum("ij,ij->i", G, n))[0]
        d = start - g / m
        near, near_slope = positive_ramp(d + FAR_MM, FAR_WIDTH_MM)
        along, bend = (np.einsum("ij,iaj->ia", G, w[used]) for w in (p.tangents, p.bends))
        values = np.column_stack([near - FAR_MM, near_slope[:, None] * (d[:, None] * bend - along) / m[:, None]])
        return _Nodes(used, R, t, x, start, by_start, G, d, values)

    def _slopes(self, nodes: _Nodes) -> tuple[Array, Array]:
        """Derivatives by twist of the nodes' values (m, 3, 6), and of σ (m, 6)."""
        p, used, d, G = self.patch, nodes.used, nodes.d, nodes.G
        n, rho = p.n[used], nodes.x - nodes.t
        H = nodes.R @ distance_derivatives(self.body, rho @ nodes.R)[2] @ nodes.R.T
        m, m_slope = positive_floor(-np.einsum("ij,ij->i", G, n))
        bent_n = np.einsum("nij,nj->ni", H, n)

        def along(w: Array) -> tuple[Array, Array]:
            """G·w and its derivatives by twist where x stays."""
            bent = np.einsum("nij,nj->ni", H, w)
            return np.einsum("ij,ij->i", G, w), np.concatenate([-bent, np.cross(G, w) - np.cross(rho, bent)], 1)

        def moving(w: Array) -> tuple[Array, Array]:
            """The same where x goes along with the start."""
            value, by = along(w)
            return value, by - np.einsum("ij,ij->i", w, bent_n)[:, None] * nodes.by_start

        facing, by_facing = moving(n)
        by_sigma, sigma = -by_facing, -facing
        by_m = m_slope[:, None] * by_sigma
        by_d = wrench_about_origin(G, rho) + (m - sigma)[:, None] * nodes.by_start - (d - nodes.start)[:, None] * by_m
        by_d /= m[:, None]
        near_slope = positive_ramp(d + FAR_MM, FAR_WIDTH_MM)[1]
        near_bend = np.maximum(1.0 - ((d + FAR_MM) / FAR_WIDTH_MM) ** 2, 0.0) * 0.75 / FAR_WIDTH_MM
        slopes = [near_slope[:, None] * by_d]
        for axis in (0, 1):
            (a, by_a), (b, by_b) = moving(p.tangents[used, axis]), moving(p.bends[used, axis])
            slope = (d * b - a) / m
            by_slope = (b[:, None] * by_d + d[:, None] * by_b - by_a - slope[:, None] * by_m) / m[:, None]
            slopes.append(near_slope[:, None] * by_slope + (near_bend * slope)[:, None] * by_d)
        return np.stack(slopes, 1), by_sigma


@dataclass(frozen=True)
class _Nodes:
    """Nodes `used` (m,) in a pose: where the distance was taken, x = c - start·n; derivatives of the start by twist
    (m, 6); G there, the depth d, and d, d_u, d_v as cells take them: values (m, 3)."""

    used: np.ndarray
    R: Array
    t: Array
    x: Array
    start: Array
    by_start: Array
    G: Array
    d: Array
    values: Array


@dataclass(frozen=True)
class Touch:
    """Cells (k,) that touch: corners (k, 4) among the nodes, depths as interpolated and d(force)/d(depth) at their
    sub-points (k, sub-points), weights (m,) of the nodes' loads, these loads' total (7,), and whether the rim is
    reached."""

    nodes: _Nodes
    cells: np.ndarray
    corners: np.ndarray
    depth: Array
    stiffness: Array
    weights: Array
    total: Array
    cut: bool


def touch_mm(cells: Cells) -> float:
    """Distance from the body up to which a cell is evaluated: more than what interpolation is wrong by, which grows as
    a cell's own sagitta. On knees, cells of 1.2 mm that carry were up to 0.021 mm away, of 2.4 mm 0.1 mm."""
    sagitta = (cells.u_mm**2 + cells.v_mm**2) / (8.0 * _RADIUS_MM)
    return WIDTH_MM + min(max(sagitta, _LEAST_MM), _MOST_MM)


def _start(overlap: Array) -> tuple[Array, Array]:
    """Where along the rays the distance is taken, from -g at their nodes, which is no farther away; and its slope."""
    most = np.where(overlap > 0.0, DEEPEST_START_MM, HIGHEST_START_MM)
    away, slope = positive_ramp(np.abs(overlap) - SMALL_MM, SMALL_WIDTH_MM)
    return np.sign(overlap) * np.minimum(away, most), np.where(away < most, slope, 0.0)


def positive_floor(sigma: Array) -> tuple[Array, Array]:
    """σ, or FLATTEST where it is less, smoothly; and its slope."""
    rise, slope = positive_ramp(sigma - FLATTEST, FLATTEST_WIDTH)
    return FLATTEST + rise, slope


def _pressures(law: tuple[int, float, float], depths: Array) -> tuple[Array, Array]:
    """p [MPa] and its slope at depths (...), continued below zero by its first two derivatives there."""
    _, stiffness, bend = pressure(*law, 0.0)
    p, slope = pressure_slopes(*law, depths)
    below = depths <= 0.0
    return (
        np.where(below, stiffness * depths + 0.5 * bend * depths**2, p),
        np.where(below, stiffness + bend * depths, slope),
    )


POWER = 32
_FULL = (POWER + 2.0) / (POWER + 1.0)


def cell_moments(quad: Quadrature, R: Array, t: Array) -> tuple[Array, Array]:
    """Moments (6,) of one patch and their derivatives by the twist of the moving body about t (6, 6)."""
    touch = quad.touch(R, t)
    if not touch.total[6] < 0.0:
        return np.zeros(MOMENTS), np.zeros((MOMENTS, 6))
    p, used = quad.patch, touch.nodes.used
    areas = p.loads[used, 6]
    pressed = np.column_stack([areas, areas[:, None] * p.c[used]])
    by_node, by_depth = quad.slopes(touch)
    in_contact = positive_ramp(touch.depth, WIDTH_MM)[1]
    in_contact_slope = np.maximum(1.0 - (touch.depth / WIDTH_MM) ** 2, 0.0) * 0.75 / WIDTH_MM
    area = p.present[touch.cells] * (areas[touch.corners] @ corner_shares(quad.cells))
    largest, by_largest = _largest(quad, touch, area)
    value = np.concatenate([[(area * in_contact).sum()], touch.weights @ pressed, [largest]])
    slope = np.vstack([_sum(area * in_contact_slope, by_depth), pressed.T @ by_node, by_largest])
    fade, fade_slope = smooth_step(value[1] / quad.fade_n)
    return fade * value, fade * slope + np.outer(value, slope[1]) * fade_slope / quad.fade_n


def _largest(quad: Quadrature, touch: Touch, area: Array) -> tuple[float, Array]:
    """The largest depth [mm] and its derivatives by twist (6,); 0 where none faces the fixed surface."""
    depth, by_depth = quad.facing(touch)
    s, slope = positive_ramp(depth, WIDTH_MM)
    share = s / quad.law[2]
    weight = area * share**POWER
    total = weight.sum()
    if not total > 0.0:
        return 0.0, np.zeros(6)
    mean = (weight * share).sum() / total
    by_s = _FULL / total * slope * ((POWER + 1.0) * weight - POWER * area * share ** (POWER - 1) * mean)
    return _FULL * quad.law[2] * mean, _sum(by_s, by_depth)


def _sum(weight: Array, by_depth: Array) -> Array:
    return np.einsum("kr,kra->a", weight, by_depth)
