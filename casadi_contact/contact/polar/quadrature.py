"""Polar quadrature of an elastic foundation between smooth surfaces with one spot of contact, in NumPy.

In the chart (u, v) of the fixed surface the patch's wrench

    W = -∫ p(d)·V du dv,   V = (N, c × N),   N = τ_v × τ_u (not a unit vector), d the depth along it

is a sum over Gauss points on rays from the spot's middle (the trapezoidal rule of a periodic function), as if the
moving arc there went on, and on lines across the caps that other arcs press: the depth is smooth on each of them, no
element jumps in or out. A second spot on the rim has rays of its own. Derivatives are those of the integral. The kernel
in C (``c/polar.h``) follows the same formulas; each is the other's check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.caps import caps
from casadi_contact.contact.polar.ends import Ends, ray_ends
from casadi_contact.contact.polar.lines import Lines, joined, to_edges
from casadi_contact.contact.polar.middle import Middle, middle
from casadi_contact.contact.polar.nearest import nearest
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.rays import Rays, rays_at_rim, rays_from
from casadi_contact.contact.polar.second import second_middle
from casadi_contact.contact.pressure.law import pressure_slopes
from casadi_contact.contact.twist import twist
from casadi_contact.core.conventions import Array


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
    m = middle(patch, R, t)
    free = ~(m.spot.depth > 0.0)
    found = integration(patch, R, t, m, rays)
    ends, weight = found.ends, found.weight
    p, dp = pressure_slopes(*law, ends.depth)
    weight = np.where(free[:, None, None], 0.0, weight)
    V = np.concatenate([ends.N, np.cross(ends.c, ends.N)], -1)
    arm = ends.x - t[:, None, None]
    by_twist = twist(ends.G, arm) / ends.slope[..., None]  # -dd/dtwist
    wrench = -np.einsum("nmg,nmgk->nk", weight * p, V)
    stiffness = np.einsum("nmg,nmgk,nmga->nka", weight * dp, V, by_twist)
    near = nearest(patch, R, t, m.spot.u, m.spot.v)
    gap_slope = -twist(near.ends.G_start, near.ends.c - t)
    cut = found.cut.any(axis=1) & ~free
    return PatchLoads(wrench @ both, both.T @ stiffness @ both, near.ends.g, gap_slope @ both, cut)


@dataclass(frozen=True)
class Integration:
    """What spots are integrated on: lines, which of them the rim ends, and points (n, lines, points) on them in the
    chart, with weights (areas in the chart) and the ends of rays from there.
    """

    lines: Lines
    cut: np.ndarray
    u: Array
    v: Array
    weight: Array
    ends: Ends


def integration(patch: SmoothPatch, R: Array, t: Array, m: Middle, rays: Rays) -> Integration:
    """Rays from the middle of each spot, the lines of its caps, and rays of a second spot on the rim."""
    beside, there = second_middle(patch, R, t, m)
    sets = [*rays_from(m, rays), *rays_at_rim(beside, rays, there), *caps(patch, R, t, m, rays.in_caps)]
    lines, cut = to_edges(patch, R, t, joined(sets))
    r, weight = lines.points(rays.points)
    u, v = lines.at(r)
    return Integration(lines, cut, u, v, weight, ray_ends(patch, R, t, u, v, arc=lines.arc[..., None]))
