"""Cubic cells in NumPy: the formulas of an elastic foundation whose gap is interpolated by cubics over a chart.

At a node c of the fixed surface with unit normal n, q = Rᵀ(c - t) lies in the frame of the moving body, whose signed
distance is g; G = R∇g. The depth is d = -g/m with m the smooth floor of σ = -G·n; where -g is large, d = s - g/m from a
second evaluation at c - s·n, s being -g at the node less `Tuning.small_depth`. Its slopes along the chart are
d_u = (-G·c_u + d·G·n_u)/m. In a cell, d at the sub-points follows from d, d_u, d_v at its corners by cubic Hermite
functions; the pressure of each is p(ψ(d)) with ψ the smoothed max(d, 0) (`basis.ramp`), and its force is shared out
bilinearly among the corners, whose (N, c × N) make the wrench.

A patch whose pressures sum up to less than nothing, at the very brink of contact where ψ dips, carries nothing: its
wrench is multiplied by a smooth step of ∫p dA from 0 to ``fade_n``. The C (``c/cells.h``) has the same formulas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.cells.basis import Cells, corner_shares, hermite_functions, positive_ramp, ramp, smooth_step
from casadi_contact.contact.cells.patches import CellPatch
from casadi_contact.contact.elements.loops import STEEPEST_FIELD, point_distances
from casadi_contact.contact.friction import PressedPoints
from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.pressure_law import pressure, pressure_derivatives
from casadi_contact.contact.pressures import MOMENTS
from casadi_contact.core.conventions import Array, wrench_about_origin
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.geometry.surface_distances import distance_derivatives, distance_gradients


@dataclass(frozen=True)
class Tuning:
    """Lengths [mm], cosines and widths of the smooth functions. The C has them by the same names in capitals."""

    width: float = 0.02  # of the smoothed max(d, 0)
    flattest: float = 0.3  # cosine between ray and surface; flatter rays count as this one, smoothly within the width
    flattest_width: float = 0.1
    steep_ray: float = 0.5  # cosine; flatter rays, by more than the width, count less in the largest depth
    steep_ray_width: float = 0.25
    small_depth: float = 0.1  # depths up to this, within the width, need no second evaluation
    small_depth_width: float = 0.05
    deepest_start: float = 1.0  # second evaluations start within these depths
    highest_start: float = 0.3
    far_depth: float = 1.0  # depths below minus this one are all alike, smoothly within the width
    far_width: float = 0.5
    power: int = 32  # of the mean that stands for the largest depth
    steepest: float = STEEPEST_FIELD
    least_error: float = 0.012  # bounds of what interpolation is wrong by, and the radius that it is estimated with
    most_error: float = 0.18
    error_radius: float = 15.0

    def touch_mm(self, cells: Cells) -> float:
        """Distance from the body up to which a cell is evaluated: more than the error of interpolation, which grows as
        a cell's own sagitta. On knees, cells of 1.2 mm that carry are up to 0.021 mm away, of 2.4 mm 0.1 mm."""
        sagitta = (cells.u_mm**2 + cells.v_mm**2) / (8.0 * self.error_radius)
        return self.width + min(max(sagitta, self.least_error), self.most_error)


@dataclass(frozen=True)
class Quadrature:
    """A patch in cubic cells against a moving body: `law` is number, modulus and thickness (`contact.pressure_law`)."""

    patch: CellPatch
    cells: Cells
    body: MovingSurface
    law: tuple[int, float, float]
    fade_n: float
    tuning: Tuning = Tuning()

    def loads(self, R: Array, t: Array) -> PatchLoads:
        """The patch's loads at rotation (3, 3) and translation (3,)."""
        p = self.patch
        nearest = int(np.argmin(np.where(p.known, self._distances(R, t), np.inf)))
        gap, slope, _ = distance_derivatives(self.body, ((p.c[nearest] - t) @ R)[None])
        gap_gradient = -wrench_about_origin(R @ slope[0], p.c[nearest] - t)
        touch = self.touch(R, t)
        total, by_total = touch.total, -p.loads[touch.nodes.used].T @ self.derivatives(touch)[0]
        fade, fade_slope = smooth_step(-total[6] / self.fade_n)
        wrench, stiffness = total[:6], by_total[:6]
        stiffness = fade * stiffness - np.outer(wrench, by_total[6]) * fade_slope / self.fade_n
        return PatchLoads(fade * wrench, stiffness, gap[0], gap_gradient, np.array(touch.cut))

    def pressed_points(self, R: Array, t: Array) -> PressedPoints:
        """The nodes that bear load at rotation (3, 3) and translation (3,)."""
        p, touch = self.patch, self.touch(R, t)
        used, area = touch.nodes.used, p.loads[touch.nodes.used, 6]
        by_node = self.derivatives(touch)[0] * area[:, None]
        forces = touch.weights * area
        fade, fade_slope = smooth_step(forces.sum() / self.fade_n)
        slopes = fade * by_node + np.outer(forces, by_node.sum(axis=0)) * fade_slope / self.fade_n
        return PressedPoints(p.c[used], p.n[used], p.loads[used, :6] / area[:, None], fade * forces, slopes)

    def wrench_and_cut(self, R: Array, t: Array) -> tuple[Array, bool]:
        """The patch's wrench (6,), and whether contact reaches the rim."""
        touch = self.touch(R, t)
        return smooth_step(-touch.total[6] / self.fade_n)[0] * touch.total[:6], touch.cut

    def derivatives(self, touch: Touch) -> tuple[Array, Array]:
        """Derivatives by the twist of the moving body: of the nodes' weights (m, 6), of depths (k, sub-points, 6)."""
        corners, nodes = touch.corners, touch.nodes
        by_depth = self._by_depth(self._derivatives(nodes)[0], touch)
        shared = np.einsum("cr,kra->kca", corner_shares(self.cells), touch.stiffness[..., None] * by_depth)
        by_node = np.zeros((len(nodes.used), 6))
        np.add.at(by_node, corners.ravel(), shared.reshape(-1, 6))
        return by_node, by_depth

    def facing(self, touch: Touch) -> tuple[Array, Array]:
        """Depths (k, sub-points) that the largest is taken of, and their derivatives by twist (k, sub-points, 6).

        Where depth is largest, inside the rims, the body's surface faces the fixed one, σ = 1. At nodes where σ is
        small, beside an edge of the body, the nearest surface is its side, of which -g/m makes depths and slopes that
        are no part of the contact: their values count by a share that falls from 1 to the flattest cosine. The depth
        then becomes the distance to that side.
        """
        nodes = touch.nodes
        derivatives, by_sigma = self._derivatives(nodes)
        sigma = -np.einsum("ij,ij->i", nodes.G, self.patch.n[nodes.used])
        step, rise = smooth_step((sigma - self.tuning.steep_ray) / self.tuning.steep_ray_width)
        share = self.tuning.flattest + (1.0 - self.tuning.flattest) * step
        by_share = ((1.0 - self.tuning.flattest) / self.tuning.steep_ray_width * rise)[:, None] * by_sigma
        values = (share[:, None] * nodes.values)[touch.corners].reshape(-1, 12)
        derivatives = share[:, None, None] * derivatives + nodes.values[..., None] * by_share[:, None]
        return values @ hermite_functions(self.cells), self._by_depth(derivatives, touch)

    def _start(self, overlap: Array) -> tuple[Array, Array]:
        """Where along the rays the distance is taken, no farther away than -g at the nodes; its derivative by -g."""
        tuning = self.tuning
        most = np.where(overlap > 0.0, tuning.deepest_start, tuning.highest_start)
        away, slope, _ = positive_ramp(np.abs(overlap) - tuning.small_depth, tuning.small_depth_width)
        return np.sign(overlap) * np.minimum(away, most), np.where(away < most, slope, 0.0)

    def _floor(self, sigma: Array) -> tuple[Array, Array]:
        """σ, or the flattest cosine where it is less, smoothly; its derivative."""
        rise, slope, _ = positive_ramp(sigma - self.tuning.flattest, self.tuning.flattest_width)
        return self.tuning.flattest + rise, slope

    def _by_depth(self, derivatives: Array, touch: Touch) -> Array:
        """Derivatives by twist (k, sub-points, 6) of depths interpolated between nodes' values, from theirs."""
        by_corner = derivatives[touch.corners].reshape(-1, 12, 6)
        return np.asarray(np.einsum("jr,kja->kra", hermite_functions(self.cells), by_corner, optimize=True))

    def _distances(self, R: Array, t: Array) -> Array:
        """Of the nodes (m,) from the body [mm]."""
        return np.asarray(
            point_distances(self.body.family, self.body.parameters, np.ascontiguousarray(self.patch.c.T), R, t)
        )

    def touch(self, R: Array, t: Array) -> Touch:
        """What touches in a pose."""
        p = self.patch
        diagonal = np.linalg.norm(p.tangents, axis=2).sum(axis=1).max()
        reach = self.tuning.touch_mm(self.cells) + self.tuning.steepest * diagonal
        cells = np.flatnonzero((self._distances(R, t)[p.corners] < reach).any(axis=1))
        used, corners = np.unique(p.corners[cells], return_inverse=True)
        nodes, corners = self._nodes(R, t, used), corners.reshape(-1, 4)
        found = nodes.values[corners].reshape(-1, 12) @ hermite_functions(self.cells)
        depth, by_depth = ramp(found, self.tuning.width)
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
        start, moves = self._start(-g)
        by_start = moves[:, None] * wrench_about_origin(slope @ R.T, c - t)
        x = c - start[:, None] * n
        g, slope = distance_gradients(self.body, (x - t) @ R)
        G = slope @ R.T
        m = self._floor(-np.einsum("ij,ij->i", G, n))[0]
        d = start - g / m
        near, near_slope, _ = positive_ramp(d + self.tuning.far_depth, self.tuning.far_width)
        along, bend = (np.einsum("ij,iaj->ia", G, w[used]) for w in (p.tangents, p.bends))
        along_chart = near_slope[:, None] * (d[:, None] * bend - along) / m[:, None]
        values = np.column_stack([near - self.tuning.far_depth, along_chart])
        return _Nodes(used, R, t, x, start, by_start, G, d, values)

    def _derivatives(self, nodes: _Nodes) -> tuple[Array, Array]:
        """Derivatives by twist of the nodes' values (m, 3, 6), and of σ (m, 6)."""
        p, used, d, G = self.patch, nodes.used, nodes.d, nodes.G
        n, rho = p.n[used], nodes.x - nodes.t
        H = nodes.R @ distance_derivatives(self.body, rho @ nodes.R)[2] @ nodes.R.T
        m, m_slope = self._floor(-np.einsum("ij,ij->i", G, n))
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
        _, near_slope, near_bend = positive_ramp(d + self.tuning.far_depth, self.tuning.far_width)
        derivatives = [near_slope[:, None] * by_d]
        for axis in (0, 1):
            (a, by_a), (b, by_b) = moving(p.tangents[used, axis]), moving(p.bends[used, axis])
            slope = (d * b - a) / m
            by_slope = (b[:, None] * by_d + d[:, None] * by_b - by_a - slope[:, None] * by_m) / m[:, None]
            derivatives.append(near_slope[:, None] * by_slope + (near_bend * slope)[:, None] * by_d)
        return np.stack(derivatives, 1), by_sigma


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
    sub-points (k, sub-points), weights (m,) of the nodes' loads, their total (7,), whether the rim is reached."""

    nodes: _Nodes
    cells: np.ndarray
    corners: np.ndarray
    depth: Array
    stiffness: Array
    weights: Array
    total: Array
    cut: bool


def _pressures(law: tuple[int, float, float], depths: Array) -> tuple[Array, Array]:
    """p [MPa] and its slope at depths (...), continued below zero by its first two derivatives there."""
    _, stiffness, bend = pressure(*law, 0.0)
    p, slope = pressure_derivatives(*law, depths)
    below = depths <= 0.0
    return (
        np.where(below, stiffness * depths + 0.5 * bend * depths**2, p),
        np.where(below, stiffness + bend * depths, slope),
    )


def cell_moments(quad: Quadrature, R: Array, t: Array) -> tuple[Array, Array]:
    """Moments (6,) of one patch and their derivatives by the twist of the moving body about t (6, 6)."""
    touch = quad.touch(R, t)
    if not touch.total[6] < 0.0:
        return np.zeros(MOMENTS), np.zeros((MOMENTS, 6))
    p, used = quad.patch, touch.nodes.used
    areas = p.loads[used, 6]
    pressed = np.column_stack([areas, areas[:, None] * p.c[used]])
    by_node, by_depth = quad.derivatives(touch)
    _, in_contact, in_contact_slope = positive_ramp(touch.depth, quad.tuning.width)
    area = p.present[touch.cells] * (areas[touch.corners] @ corner_shares(quad.cells))
    largest, by_largest = _largest(quad, touch, area)
    value = np.concatenate([[(area * in_contact).sum()], touch.weights @ pressed, [largest]])
    by_area = np.einsum("kr,kra->a", area * in_contact_slope, by_depth)
    slope = np.vstack([by_area, pressed.T @ by_node, by_largest])
    fade, fade_slope = smooth_step(value[1] / quad.fade_n)
    return fade * value, fade * slope + np.outer(value, slope[1]) * fade_slope / quad.fade_n


def _largest(quad: Quadrature, touch: Touch, area: Array) -> tuple[float, Array]:
    """The largest depth [mm] and its derivatives by twist (6,); 0 where none faces the fixed surface."""
    depth, by_depth = quad.facing(touch)
    s, slope, _ = positive_ramp(depth, quad.tuning.width)
    power = quad.tuning.power
    full = (power + 2.0) / (power + 1.0)
    share = s / quad.law[2]
    weight = area * share**power
    total = weight.sum()
    if not total > 0.0:
        return 0.0, np.zeros(6)
    mean = (weight * share).sum() / total
    by_s = full / total * slope * ((power + 1.0) * weight - power * area * share ** (power - 1) * mean)
    return full * quad.law[2] * mean, np.einsum("kr,kra->a", by_s, by_depth)
