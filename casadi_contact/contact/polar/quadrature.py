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

from casadi_contact.contact.polar.ends import ray_ends
from casadi_contact.contact.polar.middle import middle
from casadi_contact.contact.polar.nearest import nearest
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.rays import RayPlan, Rays, ray_plan
from casadi_contact.contact.pressure import pressure_slopes
from casadi_contact.conventions import Array


@dataclass(frozen=True)
class PatchLoads:
    """A patch in n poses: wrench (n, 6) and gap (n,), with their derivatives by the twist of the moving body about t
    (n, 6, 6), (n, 6); cut (n,): the rim ends a ray.
    """

    wrench: Array
    stiffness: Array
    gap: Array
    gap_slope: Array
    cut: np.ndarray


def patch_loads(patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, R: Array, t: Array) -> PatchLoads:
    """Evaluate one patch at rotations (n, 3, 3) and translations (n, 3)."""
    R, t = patch.turn @ R, t @ patch.turn.T
    both = np.kron(np.eye(2), patch.turn)
    spot = middle(patch, R, t)
    free = ~(spot.depth > 0.0)
    plan = ray_plan(patch, R, t, spot, rays)
    u, v, weight = points_of(plan, spot.u, spot.v, rays)
    ends = ray_ends(patch, R, t, u, v)
    p, dp = pressure_slopes(*law, ends.depth)
    weight = np.where(free[:, None, None], 0.0, weight)
    V = np.concatenate([ends.N, np.cross(ends.c, ends.N)], -1)
    arm = ends.x - t[:, None, None]
    by_twist = twist(ends.G, arm) / ends.slope[..., None]  # -dd/dtwist
    wrench = -np.einsum("nmg,nmgk->nk", weight * p, V)
    stiffness = np.einsum("nmg,nmgk,nmga->nka", weight * dp, V, by_twist)
    near = nearest(patch, R, t, spot.u, spot.v)
    gap_slope = -twist(near.ends.G_start, near.ends.c - t)
    cut = plan.cut.any(axis=1) & ~free
    return PatchLoads(wrench @ both, both.T @ stiffness @ both, near.ends.g, gap_slope @ both, cut)


def points_of(plan: RayPlan, u: Array, v: Array, rays: Rays) -> tuple[Array, Array, Array]:
    """(u, v) and weights (n, rays, points) of the quadrature."""
    x, weight = np.polynomial.legendre.leggauss(rays.points)
    x, weight = 0.5 * (1.0 + x), 0.5 * weight
    inner, outer = plan.junction[..., None], (plan.edge - plan.junction)[..., None]
    r = np.concatenate([inner * x, inner + outer * x], -1)
    w = 2.0 * np.pi / rays.count * r * np.concatenate([inner * weight, outer * weight], -1)
    du, dv = np.moveaxis(plan.directions, -1, 0)[..., None]
    return u[:, None, None] + r * du, v[:, None, None] + r * dv, w


def twist(force: Array, arm: Array) -> Array:
    """(f, arm × f): the product of a force with the velocities of a twist."""
    return np.concatenate([force, np.cross(arm, force)], -1)
