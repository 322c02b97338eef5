"""Cubic cells in NumPy: the formulas of an elastic foundation whose gap is interpolated by cubics over a chart.

At a node c of the fixed surface with unit normal n, q = Rᵀ(c - t) lies in the frame of the moving body, whose signed
distance is g; G = R∇g. The depth is d = -g/m with m the smooth floor of σ = -G·n, corrected by a second evaluation at
c - d·n; its slopes along the chart are d_u = (-G·c_u + d·G·n_u)/m. In a cell, d at the sub-points follows from d, d_u,
d_v at its corners by cubic Hermite functions; the pressure of each is p(ψ(d)) with ψ the smoothed max(d, 0)
(`basis.ramp`), and its force is shared out bilinearly among the corners, whose (N, c × N) make the wrench.

A patch whose pressures sum up to less than nothing, at the very brink of contact where ψ dips, carries nothing: its
wrench is multiplied by a smooth step of ∫p dA from 0 to ``fade_n``. The kernel in C (``c/cells.h``) follows the same
formulas; each is the other's check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.cells.basis import Cells, corner_shares, hermite_functions, positive_ramp, ramp, smooth_step
from casadi_contact.contact.cells.patches import CellPatch
from casadi_contact.contact.kernels import point_distances
from casadi_contact.contact.pressure import pressure, pressure_slopes
from casadi_contact.conventions import Array
from casadi_contact.geometry import MovingSurface
from casadi_contact.geometry.field_derivatives import distance_derivatives

WIDTH_MM = 0.02  # of the smoothed max(d, 0)
FLATTEST, FLATTEST_WIDTH = 0.3, 0.1  # cos of the angle between ray and surface that flatter rays count as
DEEPEST_START_MM = 1.0  # second evaluations start within these depths
HIGHEST_START_MM = 0.3
FAR_MM, FAR_WIDTH_MM = 1.0, 0.5  # depths below minus the first are all alike, within the second
TOUCH_MM = 0.06  # distance from the body up to which a cell is looked at: more than what interpolation is wrong by
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
    """A patch in cubic cells against a moving body: `law` is number, modulus and thickness (`contact.pressure`)."""

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
        gap_slope = -_twist(R @ slope[0], p.c[nearest] - t)
        near = (distance[p.corners] < self._reach_mm()).any(axis=1)
        wrench, stiffness, cut = self._contact(R, t, np.flatnonzero(near))
        return PatchLoads(wrench, stiffness, float(gap[0]), gap_slope, cut)

    def _reach_mm(self) -> float:
        """Distance of a corner within which a cell may touch: its diagonal, at the field's steepest."""
        return TOUCH_MM + 1.1 * float(np.linalg.norm(self.patch.tangents, axis=2).sum(axis=1).max())

    def _contact(self, R: Array, t: Array, cells: np.ndarray) -> tuple[Array, Array, bool]:
        p = self.patch
        used, corners = np.unique(p.corners[cells], return_inverse=True)
        corners = corners.reshape(-1, 4)
        depths, slopes = self._nodes(R, t, used)
        functions, shares = hermite_functions(self.cells), corner_shares(self.cells)
        at_corners = depths[corners].reshape(-1, 12)
        depth, by_depth = ramp(at_corners @ functions, WIDTH_MM)
        cut = bool(((depth > 0.0) & (p.present[cells] > 0.0) & p.rim[cells, None]).any())
        force, stiff = _pressures(self.law, depth)
        force, stiff = force * p.present[cells], stiff * by_depth * p.present[cells]
        weights = np.zeros((len(used), 1))
        np.add.at(weights, corners.ravel(), (force @ shares.T).reshape(-1, 1))
        by_twist = np.zeros((len(used), 6))
        rates = np.einsum("kr,jr,kja->kra", stiff, functions, slopes[corners].reshape(-1, 12, 6))
        np.add.at(by_twist, corners.ravel(), np.einsum("cr,kra->kca", shares, rates).reshape(-1, 6))
        total, by_total = -p.loads[used].T @ weights[:, 0], -p.loads[used].T @ by_twist
        fade, fade_slope = smooth_step(-total[6] / self.fade_n)
        wrench, stiffness = total[:6], by_total[:6]
        return fade * wrench, fade * stiffness - np.outer(wrench, by_total[6]) * fade_slope / self.fade_n, cut

    def _nodes(self, R: Array, t: Array, used: np.ndarray) -> tuple[Array, Array]:
        """d, d_u, d_v (m, 3) of the nodes and their derivatives by twist (m, 3, 6)."""
        p = self.patch
        c, n = p.c[used], p.n[used]

        g, G, _ = self._body_at(R, t, c)
        sigma = -np.einsum("ij,ij->i", G, n)
        first = np.where(sigma > FLATTEST + FLATTEST_WIDTH, -g / positive_floor(sigma)[0], 0.0)
        start = np.clip(first, -HIGHEST_START_MM, DEEPEST_START_MM)
        moves = (start == first) & (first != 0.0)  # the second evaluation's point goes along with the depth
        x = c - start[:, None] * n
        g, G, H = self._body_at(R, t, x)
        m, m_slope = positive_floor(-np.einsum("ij,ij->i", G, n))
        d, rho, bent_n = start - g / m, x - t, np.einsum("nij,nj->ni", H, n)

        def along(w: Array) -> tuple[Array, Array]:
            """G·w and its derivatives by twist where x stays."""
            bent = np.einsum("nij,nj->ni", H, w)
            return np.einsum("ij,ij->i", G, w), np.concatenate([-bent, np.cross(G, w) - np.cross(rho, bent)], 1)

        def moving(by: Array, w: Array) -> Array:
            """Derivatives of G·w where x goes along."""
            return np.asarray(by - (moves * np.einsum("ij,ij->i", w, bent_n))[:, None] * by_d)

        _, by_n = along(n)
        by_d = (_twist(G, rho) + ((d - start) * m_slope)[:, None] * by_n) / m[:, None]
        by_m = -m_slope[:, None] * moving(by_n, n)
        near, near_slope = positive_ramp(d + FAR_MM, FAR_WIDTH_MM)
        near_bend = np.maximum(1.0 - ((d + FAR_MM) / FAR_WIDTH_MM) ** 2, 0.0) * 0.75 / FAR_WIDTH_MM
        values, slopes = [near - FAR_MM], [near_slope[:, None] * by_d]
        for axis in (0, 1):
            a, by_a = along(p.tangents[used, axis])
            b, by_b = along(p.bends[used, axis])
            by_a, by_b = moving(by_a, p.tangents[used, axis]), moving(by_b, p.bends[used, axis])
            slope = (d * b - a) / m
            by_slope = (b[:, None] * by_d + d[:, None] * by_b - by_a - slope[:, None] * by_m) / m[:, None]
            values.append(near_slope * slope)
            slopes.append(near_slope[:, None] * by_slope + (near_bend * slope)[:, None] * by_d)
        return np.stack(values, 1), np.stack(slopes, 1)

    def _body_at(self, R: Array, t: Array, points: Array) -> tuple[Array, Array, Array]:
        """g (m,), its gradient (m, 3) and second derivatives (m, 3, 3), fixed frame."""
        g, slope, bend = distance_derivatives(self.body, (points - t) @ R)
        return g, slope @ R.T, R @ bend @ R.T

    def depths(self, R: Array, t: Array) -> Array:
        """Smoothed depth of every sub-point (cells, sub-points) [mm], for pictures."""
        values, _ = self._nodes(R, t, np.arange(len(self.patch.c)))
        return np.maximum(
            ramp(values[self.patch.corners].reshape(-1, 12) @ hermite_functions(self.cells), WIDTH_MM)[0], 0.0
        )


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


def _twist(force: Array, arm: Array) -> Array:
    """(f, arm × f): the product of a force with the velocities of a twist."""
    return np.concatenate([force, np.cross(arm, force)], -1)
