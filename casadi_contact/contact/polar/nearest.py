"""The point of a patch that is nearest to the body, and the deepest one along the rays, wherever the body lies.

Minimum of the distance g over the patch, by Newton's method with a trust region (Nocedal and Wright, Numerical
Optimization, Alg. 4.1) in coordinates that make the rim a box (`rim`): each step minimises the quadratic model of g
within the box and the trust region, by coordinates in turn. Of a strongly tilted body g may have several minima: a few
starts are spread over the patch.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.polar.ends import ray_ends
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.rim import rim_box, stretch
from casadi_contact.contact.polar.spot import LEAST_CURVATURE, Spot, spot_at
from casadi_contact.core.conventions import Array

SEARCH_STEPS = 40  # at most: the usual search ends after one to three
SWEEPS = 3  # over the coordinates of a step
LAST_STEP = 1e-6  # part of the patch: a step so short is the last one
SINGLE = 0.05  # curvature relative to the fixed surface over the body's own, below which there may be more minima
ACROSS = np.linspace(0.0, 1.0, 4)  # starts, as parts of the rim's box in w and v, on the rim too


def nearest(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> Spot:
    """The point of the patch nearest to the body (`spot_at` with at_start).

    From the lowest of (u, v) and the starts; where the body lies nearly as flat as the patch, from each row of starts.
    """
    low, high = rim_box(patch)
    w, across = np.meshgrid(*(low[:, None] + (high - low)[:, None] * ACROSS))
    shape = (len(u), *w.shape)
    starts = np.stack([np.broadcast_to(w * stretch(patch, across)[0], shape), np.broadcast_to(across, shape)])
    g = ray_ends(patch, R, t, *starts, at_start=True).g
    row, column = np.divmod(np.argmin(g.reshape(len(u), w.size), axis=1), len(ACROSS))
    n = np.arange(len(u))
    given = ray_ends(patch, R, t, u, v, at_start=True).g <= g[n, row, column]
    found = highest(patch, R, t, *np.where(given, [u, v], starts[:, n, row, column]), at_start=True)
    k, ends = found.curvature, found.ends
    single = (k[:, 0, 0] > 0.0) & (np.linalg.det(k) > SINGLE * ends.kappa_1 * ends.kappa_2)
    several = np.flatnonzero(~single)
    if not len(several):
        return found
    best_u, best_v, depth = found.u.copy(), found.v.copy(), found.depth.copy()
    for row, along in enumerate(np.argmin(g[several], axis=2).T):
        there = starts[:, several, row, along]
        other = highest(patch, R[several], t[several], *there, at_start=True)
        deeper = other.depth > depth[several]
        rows = several[deeper]
        best_u[rows], best_v[rows], depth[rows] = other.u[deeper], other.v[deeper], other.depth[deeper]
    return spot_at(patch, R, t, best_u, best_v, at_start=True)


def deepest_within(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> Spot:
    """The deepest point along the rays: at the rim it is not the nearest one, from which the search for it runs."""
    near = nearest(patch, R, t, u, v)
    return highest(patch, R, t, near.u, near.v, at_start=False)


def highest(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, *, at_start: bool) -> Spot:
    """The point of the patch where the depth (at_start: -g) has the maximum that is uphill from (u, v)."""
    low, high = rim_box(patch)
    x = np.stack([u / stretch(patch, v)[0], v], -1)
    value, slope, k = _model(patch, R, t, x, at_start)
    trust, going = np.ones(len(u)), np.arange(len(u))
    for _ in range(SEARCH_STEPS):
        if not len(going):
            break
        here, reach = x[going], trust[going, None] * (high - low)
        step = _model_step(slope[going], k[going], np.maximum(low - here, -reach), np.minimum(high - here, reach))
        part = np.max(np.abs(step) / (high - low), axis=1)
        tried = _model(patch, R[going], t[going], here + step, at_start)
        last = part < LAST_STEP
        taken = last | (tried[0] > value[going])
        rows = going[taken]
        x[rows] += step[taken]
        for kept, new in zip((value, slope, k), tried, strict=True):
            kept[rows] = new[taken]
        trust[going] = np.where(taken, 2.0 * trust[going], 0.25 * part)
        going = going[~last]
    return spot_at(patch, R, t, x[:, 0] * stretch(patch, x[:, 1])[0], x[:, 1], at_start=at_start)


def _model(patch: SmoothPatch, R: Array, t: Array, x: Array, at_start: bool) -> tuple[Array, Array, Array]:
    """Depth at (w, v), its slopes (n, 2), and minus its second derivatives ww, wv, vv (n, 3), ww and vv bounded."""
    w, v = x.T
    s, rate, bend = stretch(patch, v)
    spot = spot_at(patch, R, t, w * s, v, at_start=at_start)
    k, (b_u, b_v), lean = spot.curvature, spot.slope.T, w * rate
    k_uv = k[:, 0, 1] + lean * k[:, 0, 0]
    k_ww, k_wv = s * s * k[:, 0, 0], s * k_uv - rate * b_u
    k_vv = k[:, 1, 1] + lean * (k[:, 0, 1] + k_uv) - w * bend * b_u
    bounded = np.maximum(k_ww, LEAST_CURVATURE * s * s), k_wv, np.maximum(k_vv, LEAST_CURVATURE)
    return spot.depth, np.stack([s * b_u, b_v + lean * b_u], -1), np.stack(bounded, -1)


def _model_step(slope: Array, k: Array, low: Array, high: Array) -> Array:
    """The step within a box that raises the quadratic model, by its coordinates in turn."""
    step = np.zeros_like(slope)
    for _ in range(SWEEPS):
        for i, k_ii in ((0, k[:, 0]), (1, k[:, 2])):
            step[:, i] = np.clip((slope[:, i] - k[:, 1] * step[:, 1 - i]) / k_ii, low[:, i], high[:, i])
    return step
