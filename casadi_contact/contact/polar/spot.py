"""Depth at one point of a patch, with its slopes and curvatures along the chart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.ends import Ends, ray_ends, tube_frame
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.core.conventions import Array

LEAST_CURVATURE = 1e-4  # [1/mm]


@dataclass(frozen=True)
class Spot:
    """One ray from (u, v) in each of n poses: depth, its slopes (n, 2), relative curvatures (n, 2, 2), the end."""

    u: Array
    v: Array
    depth: Array
    slope: Array
    curvature: Array
    ends: Ends


def spot_at(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, *, at_start: bool = False) -> Spot:
    """Depth at (u, v) with its slopes and its curvatures relative to the fixed surface; at_start: all of -g instead.

    With the fixed surface the zero of F, its tangents τ_u, τ_v and n_u = -∇²F τ_u: d_u = G·(τ_u + d ∇²F τ_u)/σ,
    k_uv = τ_u·(∇²g - ∇²F)τ_v.
    """
    ends = ray_ends(patch, R, t, u, v, at_start=at_start)
    tangents = ends.tangents
    fixed = np.zeros((len(u), 3, 3))
    if (f := patch.torus) is not None:
        rho, ex, ey, out, distance = tube_frame(u, ends.c[:, 1] - f.height, v, f.offset)
        across = np.stack([-v * ex, -v * ey, out], -1) / distance[:, None]
        along = np.stack([-ey, ex, np.zeros_like(u)], -1)
        fixed = _rank_one(1.0 / distance, across) + _rank_one(out / (distance * rho), along)
    moving = _rank_one(ends.kappa_1, ends.across) + _rank_one(ends.kappa_2, ends.along)
    if at_start:
        slope = -np.einsum("nai,ni->na", tangents, ends.G)
        fixed = -(ends.length * ends.G[:, 1])[:, None, None] * fixed
    else:
        bent = tangents + ends.depth[:, None, None] * (tangents @ fixed)
        slope = np.einsum("nai,ni->na", bent, ends.G) / ends.slope[:, None]
    curvature = tangents @ (moving - fixed) @ np.swapaxes(tangents, 1, 2)
    return Spot(u, v, -ends.g if at_start else ends.depth, slope, curvature, ends)


def _rank_one(weight: Array, vector: Array) -> Array:
    return weight[:, None, None] * vector[:, :, None] * vector[:, None, :]


def bounded(curvature: Array) -> Array:
    """The curvature, not below a least one."""
    return np.maximum(curvature, LEAST_CURVATURE)
