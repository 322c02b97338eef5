"""Derivatives of a dish's loads by its two radii, by polar quadrature.

A dish with the sagittal radius S and the frontal radius F is, over its chart (u, v) (see `patches`),

    tube = √(F² - v²),  ρ = S - F + tube,  w = √(ρ² - u²),  c = (u, S - w, z_0 + v),  N = (-u/w, 1, -ρv/(tube·w))

and for either radius, with subscripts for derivatives at a fixed (u, v) and n = N/|N|, the depth's end on the moving
surface gives d_S = G·(c_S - d·n_S)/σ. The pressure is zero at the edge of contact, so that only the integrand changes:

    W_S = -∫ [p'·d_S·V + p·V_S] du dv,   V = (N, c × N),   V_S = (N_S, c_S × N + c × N_S)
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.polar.peak import deepest_within, peak
from casadi_contact.contact.polar.quadrature import integration
from casadi_contact.contact.polar.ray_hits import LocalDepth, RayHits
from casadi_contact.contact.polar.surfaces import SmoothPatch, Torus
from casadi_contact.contact.pressure_law import pressure_derivatives
from casadi_contact.core.conventions import Array

RADII = ("dish_sagittal_radius", "dish_frontal_radius")


def dish_derivatives(
    patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, R: Array, t: Array
) -> tuple[Array, LocalDepth, Array]:
    """d wrench/d radii (n, 6, 2) [N/mm, N], the deepest point, and d its depth/d radii (n, 2), radii as in `RADII`, in
    n poses.

    Slopes are zero without contact. Where the rim cuts the contact, the change of the rim with the radii is left out.
    Raises ValueError for a patch that is no dish.
    """
    if patch.torus is None or patch.torus.w_sign > 0.0:
        raise ValueError("a patch has no dish, expected a scene of the shape knee")
    m = peak(patch, R, t)
    found = integration(patch, R, t, m, rays)
    local, ends, u, v = m.local, found.ends, found.u, found.v
    p, dp = pressure_derivatives(*law, ends.depth)
    weight = np.where((local.depth > 0.0)[:, None, None], found.weight, 0.0)
    there = deepest_within(patch, R, t, local.u, local.v)
    V = np.concatenate([ends.N, np.cross(ends.c, ends.N)], -1)
    by_radius, deepest_by_radius = [], []
    for sagittal in (True, False):
        c, N = _surface_derivatives(patch.torus, u, v, sagittal=sagittal)
        by_depth = np.einsum("nmg,nmgk->nk", weight * dp * _depth_derivative(ends, c, N), V)
        turned = np.concatenate([N, np.cross(c, ends.N) + np.cross(ends.c, N)], -1)
        by_radius.append(-by_depth - np.einsum("nmg,nmgk->nk", weight * p, turned))
        at_deepest = _depth_derivative(
            there.ends, *_surface_derivatives(patch.torus, there.u, there.v, sagittal=sagittal)
        )
        deepest_by_radius.append(np.where(local.depth > 0.0, at_deepest, 0.0))
    return np.stack(by_radius, -1), there, np.stack(deepest_by_radius, -1)


def _surface_derivatives(torus: Torus, u: Array, v: Array, *, sagittal: bool) -> tuple[Array, Array]:
    """c and N (..., 3) by one radius at a fixed (u, v)."""
    tube = np.sqrt(torus.radius**2 - v * v)
    rho = torus.offset + tube
    w = np.sqrt(rho * rho - u * u)
    by_tube = np.zeros_like(u) if sagittal else torus.radius / tube
    by_rho = np.ones_like(u) if sagittal else by_tube - 1.0
    by_w = rho * by_rho / w
    zero = np.zeros_like(u)
    lean_u = -u * by_w / w**2
    lean_v = v / (tube * w) * (by_rho - rho * by_tube / tube - rho * by_w / w)
    return np.stack([zero, float(sagittal) - by_w, zero], -1), np.stack([-lean_u, zero, -lean_v], -1)


def _depth_derivative(ends: RayHits, c: Array, N: Array) -> Array:
    """Depth by a radius (...) where the fixed point and its normal change by c and N (..., 3)."""
    n = ends.N / ends.length[..., None]
    turned = (N - n * np.sum(n * N, -1)[..., None]) / ends.length[..., None]
    return np.asarray(np.sum(ends.G * (c - ends.depth[..., None] * turned), -1) / ends.cosine)
