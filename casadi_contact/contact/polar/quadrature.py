"""Polar quadrature of an elastic foundation between smooth surfaces with one spot of contact, in NumPy.

Rays run in the chart (u, v) of the fixed surface from the spot's middle to its edge. The patch's wrench

    W = -∫ p(d)·V du dv,   V = (N, c × N),   N = τ_v × τ_u (not a unit vector), d the depth along it

is a sum over equally spaced rays (the trapezoidal rule of a periodic function) and Gauss points on two pieces of each,
broken where the ray crosses from one moving arc to the next: the depth is smooth on each piece, no element jumps in or
out. Derivatives are those of the integral. The kernel in C (``c/polar.h``) follows the same formulas; each is the
other's check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.ends import Ends, ray_ends
from casadi_contact.contact.polar.middle import middle
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.rays import RayPlan, Rays, ray_plan
from casadi_contact.contact.pressure import pressure_slopes
from casadi_contact.conventions import Array


@dataclass(frozen=True)
class PatchLoads:
    """A patch in n poses: wrench (n, 6), its derivatives by the twist of the moving body about t (n, 6, 6), second
    ones of a weighted sum of its components (n, 6, 6), gap (n,) and its derivatives by twist (n, 6); cut by the rim (n,).
    """

    wrench: Array
    stiffness: Array
    curvature: Array
    gap: Array
    gap_slope: Array
    cut: np.ndarray


def patch_loads(
    patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, R: Array, t: Array, weights: Array
) -> PatchLoads:
    """Evaluate one patch at rotations (n, 3, 3) and translations (n, 3); weights (n, 6) of the wrench's components."""
    turn = patch.turn
    both = np.kron(np.eye(2), turn)
    R, t, weights = turn @ R, t @ turn.T, weights @ both.T
    with np.errstate(invalid="ignore"):
        centre = middle(patch, R, t)
        plan = ray_plan(patch, R, t, centre, rays)
    free = ~(centre.ends.depth > 0.0)
    u, v, w = _points(plan, centre.u, centre.v, rays)
    ends = ray_ends(patch, R, t, u, v)
    p, dp, ddp = pressure_slopes(*law, ends.depth)
    w = np.where(free[:, None, None], 0.0, w)
    V = _load(ends)
    wrench = -np.einsum("nmg,nmgk->nk", w * p, V)
    d = _depth_slope(ends, t)
    stiffness = -np.einsum("nmg,nmgk,nmga->nka", w * dp, V, d)
    pull = np.einsum("nmgk,nk->nmg", V, weights)
    curvature = _second(ends, t, d, -w * dp * pull) + np.einsum("nmg,nmga,nmgb->nab", -w * ddp * pull, d, d)
    curvature += _of_moving_edge(patch, law, plan, centre.u, centre.v, R, t, weights, free)
    gap_ends = ray_ends(patch, R, t, *centre.nearest)
    to_gap = -_twist(gap_ends.G_start, gap_ends.c - t)
    back = both.T
    return PatchLoads(
        wrench @ both, back @ stiffness @ both, back @ curvature @ both, gap_ends.g, to_gap @ both, plan.cut.any(axis=1)
    )


def _points(plan: RayPlan, u: Array, v: Array, rays: Rays) -> tuple[Array, Array, Array]:
    """(u, v) and weights (n, rays, points) of the quadrature."""
    x, weight = np.polynomial.legendre.leggauss(rays.points)
    x, weight = 0.5 * (1.0 + x), 0.5 * weight
    inner, outer = plan.junction[..., None], (plan.edge - plan.junction)[..., None]
    r = np.concatenate([inner * x, inner + outer * x], -1)
    w = 2.0 * np.pi / rays.count * r * np.concatenate([inner * weight, outer * weight], -1)
    du, dv = plan.directions.T[..., None]
    return u[:, None, None] + r * du, v[:, None, None] + r * dv, w


def _load(ends: Ends) -> Array:
    """V = (N, c × N)."""
    return np.concatenate([ends.N, np.cross(ends.c, ends.N)], -1)


def _twist(force: Array, arm: Array) -> Array:
    """(f, arm × f): the product of a force with the velocities of a twist."""
    return np.concatenate([force, np.cross(arm, force)], -1)


def _arm(ends: Ends, t: Array) -> Array:
    return ends.x - t.reshape(len(t), *(1,) * (ends.x.ndim - 2), 3)


def _depth_slope(ends: Ends, t: Array) -> Array:
    """dd/dtwist = -(G, ρ × G)/σ with ρ = x - t."""
    return -_twist(ends.G, _arm(ends, t)) / ends.slope[..., None]


def _second(ends: Ends, t: Array, d: Array, weight: Array) -> Array:
    """Σ weight·D_b(dd/da) over all points, a, b the components of a twist, b acting last.

    From g = 0 at the ray's end, differentiated twice: with b_a = -n·d_a - (velocity of the body at x),
    σ·d_ab = b_a·∇²g·b_b + m_a·d_b + d_a·m_b + S_ab, m = (0, n × G), S_ab = e_a·(G × e_b)-like terms of the turning arm.
    """
    n = ends.N / ends.length[..., None]
    arm = _arm(ends, t)
    weight = weight / ends.slope
    total = np.zeros((len(t), 6, 6))
    kappa_1 = 1.0 / ends.tube_radius
    for kappa, axis in ((kappa_1 + 0.0 * ends.kappa_2, ends.across), (ends.kappa_2, ends.along)):
        y = np.sum(n * axis, -1)[..., None] * d + _twist(axis, arm)
        total += np.einsum("nmg,nmga,nmgb->nab", weight * kappa, y, y)
    m = np.concatenate([np.zeros_like(n), np.cross(n, ends.G)], -1)
    mixed = np.einsum("nmg,nmga,nmgb->nab", weight, m, d)
    total += mixed + np.swapaxes(mixed, 1, 2)
    force = np.einsum("nmg,nmgi->ni", weight, ends.G)
    arms = np.einsum("nmg,nmga,nmgb->nab", weight, ends.G, arm)
    skew = np.cross(np.eye(3)[None], force[:, None, :])  # row a: e_a × force
    total[:, :3, 3:] += skew
    total[:, 3:, :3] += np.swapaxes(skew, 1, 2)
    total[:, 3:, 3:] += arms - np.einsum("nii->n", arms)[:, None, None] * np.eye(3)
    return total


def _of_moving_edge(
    patch: SmoothPatch,
    law: tuple[int, float, float],
    plan: RayPlan,
    u: Array,
    v: Array,
    R: Array,
    t: Array,
    weights: Array,
    free: np.ndarray,
) -> Array:
    """-Σ Δθ·r·p'(0)·(λ·V)·d_a·d_b/|d_r| over the rays' edges: there the derivative of the pressure jumps to zero."""
    du, dv = plan.directions.T
    ends = ray_ends(patch, R, t, u[:, None] + plan.edge * du, v[:, None] + plan.edge * dv)
    tangent = np.stack([du + 0.0 * u[:, None], -ends.N[..., 0] * du - ends.N[..., 2] * dv, dv + 0.0 * u[:, None]], -1)
    d_r = np.minimum(np.sum(tangent * ends.G, -1) / ends.slope, -1e-9)
    d = _depth_slope(ends, t)
    pull = np.einsum("nmk,nk->nm", _load(ends), weights)
    jump = pressure_slopes(*law, np.full(1, 1e-300))[1][0]
    weight = 2.0 * np.pi / len(du) * plan.edge * jump * pull / d_r
    weight = np.where(plan.cut | free[:, None], 0.0, weight)
    return np.asarray(np.einsum("nm,nma,nmb->nab", weight, d, d))
