"""The peak of a contact area, from which its rays run, and the point nearest to the body, wherever that lies.

The nearest point is the minimum of the distance g over the patch, by Newton's method with a trust region (Nocedal and
Wright, Numerical Optimization, Alg. 4.1) in coordinates that make the rim a box: each step minimises the quadratic
model of g within box and trust region, by coordinates in turn. A few starts are spread over the patch.
"""

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.ray_hits import LocalDepth, local_depth, ray_hits, tube_frame
from casadi_contact.contact.polar.surfaces import SmoothPatch, rim_box, stretch, within
from casadi_contact.core.conventions import Array

ACROSS = np.linspace(0.0, 1.0, 4)  # starts, as parts of the rim's box in w and v, on the rim too


def nearest(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> LocalDepth:
    """The point of the patch nearest to the body (`local_depth` with at_start).

    From the lowest of (u, v) and the starts; where the body lies nearly as flat as the patch, from each row of starts.
    """
    low, high = rim_box(patch)
    w, across = np.meshgrid(*(low[:, None] + (high - low)[:, None] * ACROSS))
    shape = (len(u), *w.shape)
    starts = np.stack([np.broadcast_to(w * stretch(patch, across)[0], shape), np.broadcast_to(across, shape)])
    g = ray_hits(patch, R, t, *starts, at_start=True).g
    row, column = np.divmod(np.argmin(g.reshape(len(u), w.size), axis=1), len(ACROSS))
    n = np.arange(len(u))
    given = ray_hits(patch, R, t, u, v, at_start=True).g <= g[n, row, column]
    found = highest(patch, R, t, *np.where(given, [u, v], starts[:, n, row, column]), at_start=True)
    k, ends = found.curvature, found.ends
    single = (k[:, 0, 0] > 0.0) & (np.linalg.det(k) > patch.tuning.least_convexity * ends.kappa_1 * ends.kappa_2)
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
    return local_depth(patch, R, t, best_u, best_v, at_start=True)


def deepest_within(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> LocalDepth:
    """The deepest point along the rays: at the rim it is not the nearest one, from which the search for it runs."""
    near = nearest(patch, R, t, u, v)
    return highest(patch, R, t, near.u, near.v, at_start=False)


def highest(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array, *, at_start: bool) -> LocalDepth:
    """The point of the patch where the depth (at_start: -g) has the maximum that is uphill from (u, v)."""
    low, high = rim_box(patch)
    x = np.stack([u / stretch(patch, v)[0], v], -1)
    value, slope, k = _model(patch, R, t, x, at_start)
    trust, going = np.ones(len(u)), np.arange(len(u))
    for _ in range(patch.tuning.search_steps):
        if not len(going):
            break
        here, reach = x[going], trust[going, None] * (high - low)
        box = np.maximum(low - here, -reach), np.minimum(high - here, reach)
        step = _model_step(slope[going], k[going], *box, patch.tuning.sweeps)
        part = np.max(np.abs(step) / (high - low), axis=1)
        tried = _model(patch, R[going], t[going], here + step, at_start)
        last = part < patch.tuning.least_step
        taken = last | (tried[0] > value[going])
        rows = going[taken]
        x[rows] += step[taken]
        for kept, new in zip((value, slope, k), tried, strict=True):
            kept[rows] = new[taken]
        trust[going] = np.where(taken, 2.0 * trust[going], 0.25 * part)
        going = going[~last]
    return local_depth(patch, R, t, x[:, 0] * stretch(patch, x[:, 1])[0], x[:, 1], at_start=at_start)


def _model(patch: SmoothPatch, R: Array, t: Array, x: Array, at_start: bool) -> tuple[Array, Array, Array]:
    """Depth at (w, v), its slopes (n, 2), and minus its second derivatives ww, wv, vv (n, 3), ww and vv bounded."""
    w, v = x.T
    s, rate, bend = stretch(patch, v)
    local = local_depth(patch, R, t, w * s, v, at_start=at_start)
    k, (b_u, b_v), lean = local.curvature, local.gradient.T, w * rate
    k_uv = k[:, 0, 1] + lean * k[:, 0, 0]
    k_ww, k_wv = s * s * k[:, 0, 0], s * k_uv - rate * b_u
    k_vv = k[:, 1, 1] + lean * (k[:, 0, 1] + k_uv) - w * bend * b_u
    least = patch.tuning.least_curvature
    k = np.stack([np.maximum(k_ww, least * s * s), k_wv, np.maximum(k_vv, least)], -1)
    return local.depth, np.stack([s * b_u, b_v + lean * b_u], -1), k


def _model_step(slope: Array, k: Array, low: Array, high: Array, sweeps: int) -> Array:
    """The step within a box that raises the quadratic model, by its coordinates in turn."""
    step = np.zeros_like(slope)
    for _ in range(sweeps):
        for i, k_ii in ((0, k[:, 0]), (1, k[:, 2])):
            step[:, i] = np.clip((slope[:, i] - k[:, 1] * step[:, 1 - i]) / k_ii, low[:, i], high[:, i])
    return step


def deepest(patch: SmoothPatch, R: Array, t: Array) -> tuple[Array, Array]:
    """(u, v) at which the surfaces face each other with parallel normals, whether within the rim or not.

    The moving tube's centre C is where the body reaches farthest along the direction, which points from the fixed
    tube's centre to C: a fixed point, from a start that is exact where the body is not tilted sideways.
    """
    direction = np.tile([0.0, -1.0, 0.0], (len(t), 1))
    if (f := patch.torus) is None:
        C = _reaching(patch, R, t, direction)
        return C[:, 0], C[:, 2] - patch.z_0
    arc = np.full(len(t), min(1, len(patch.arcs) - 1))
    for _ in patch.arcs:
        axis = _carried(patch, R, t, patch.arcs[arc, :2])
        flat = -f.w_sign * (axis[:, :2] - [0.0, f.height])
        size = np.linalg.norm(flat, axis=1, keepdims=True)
        np.divide(flat, size, out=direction[:, :2], where=size > 0.0)
        arc = _arc_along(patch, np.einsum("nji,nj->ni", R, direction))
    for _ in range(patch.tuning.centre_steps):
        C = _reaching(patch, R, t, direction)
        z = C[:, 2] - patch.z_0
        _, ex, ey, out, distance = tube_frame(C[:, 0], C[:, 1] - f.height, z, f.offset, patch.tuning.least_length)
        direction = np.stack([out * ex, out * ey, z], -1) / distance[:, None]
    return (f.offset + f.radius * out / distance) * ex, f.radius * z / distance


def _reaching(patch: SmoothPatch, R: Array, t: Array, direction: Array) -> Array:
    """Centre of the moving tube (n, 3) where the body reaches farthest along directions (n, 3)."""
    seen = np.einsum("nji,nj->ni", R, direction)[:, :2]
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    arc = patch.arcs[_arc_along(patch, seen)]
    return _carried(patch, R, t, arc[:, :2] + arc[:, 2:3] * seen)


def _carried(patch: SmoothPatch, R: Array, t: Array, xy: Array) -> Array:
    """Points (n, 3) of the plane of the moving tube's centres, from x and y (n, 2) in the moving frame."""
    return np.asarray(t + np.einsum("nij,nj->ni", R[..., :2], xy) + R[..., 2] * patch.centre_z)


def _arc_along(patch: SmoothPatch, direction: Array) -> np.ndarray:
    """The arc on which the body reaches farthest along a direction of its own frame."""
    arc = np.full(len(direction), len(patch.arcs) - 1)
    for k in range(len(patch.arcs) - 2, -1, -1):
        arc = np.where(direction[:, :2] @ patch.arcs[k, 3:] > 0.0, arc, k)
    return arc


@dataclass(frozen=True)
class Peak:
    """The depth at the peak of a contact area; form (n, 2, 2): of determinant 1, turns a circle into a curve like the
    edge of contact; whole (n,): the rim does not cut the contact area.
    """

    local: LocalDepth
    form: Array
    whole: np.ndarray


def peak(patch: SmoothPatch, R: Array, t: Array) -> Peak:
    """The deepest point and the ellipse of the curvatures there, K^(-1/2). Where the rim cuts the contact area: the
    peak of chords through the point nearest to the body, and a form as long and wide as they are.

    Its depth is above zero exactly where some of the patch lies inside the body.
    """
    found = np.stack(deepest(patch, R, t))
    local = local_depth(patch, R, t, *within(patch, *found))
    u, v, k, depth, (b_u, b_v) = local.u, local.v, local.curvature, np.maximum(local.depth, 0.0), local.gradient.T
    k_uu, k_uv, k_vv = k[:, 0, 0], k[:, 0, 1], k[:, 1, 1]
    determinant = np.maximum(k_uu * k_vv - k_uv**2, patch.tuning.least_curvature**2)
    convex = (k_uu > 0.0) & (determinant > patch.tuning.least_curvature**2)
    reach_u, reach_v = np.sqrt(2.0 * depth * np.where(convex, np.stack([k_vv, k_uu]), 0.0) / determinant)
    needed = [tuple(found), (u - reach_u, v), (u + reach_u, v), (u, v - reach_v), (u, v + reach_v)]
    whole = np.all([np.all(np.stack(within(patch, *point)) == np.stack(point), axis=0) for point in needed], axis=0)
    whole &= convex & (
        k_vv * b_u**2 - 2.0 * k_uv * b_u * b_v + k_uu * b_v**2 < patch.tuning.most_rise * depth * determinant
    )
    if not whole.all():
        u, v, cut = u.copy(), v.copy(), ~whole
        near = nearest(patch, R[cut], t[cut], u[cut], v[cut])
        u[cut], v[cut] = chord_middles(patch, R[cut], t[cut], near.u, near.v)
        local = local_depth(patch, R, t, u, v)
    w = whole[:, None, None]
    return Peak(local, np.where(w, _ellipse(np.where(w, local.curvature, np.eye(2))), chord_form(patch, local)), whole)


def _ellipse(curvature: Array) -> Array:
    """K^(-1/2) of curvatures (n, 2, 2), scaled to a determinant of 1: (adj K + s·1)/√(s·(tr K + 2 s)), s = √det K."""
    k_uu, k_uv, k_vv = curvature[:, 0, 0], curvature[:, 0, 1], curvature[:, 1, 1]
    s = np.sqrt(k_uu * k_vv - k_uv**2)
    form = np.stack([np.stack([k_vv + s, -k_uv], -1), np.stack([-k_uv, k_uu + s], -1)], 1)
    return np.asarray(form / np.sqrt(s * (k_uu + k_vv + 2.0 * s))[:, None, None])


def chord_form(patch: SmoothPatch, local: LocalDepth) -> Array:
    """The form (n, 2, 2) as long and wide as the chords through a contact area."""
    begin, end = np.stack([_chord_ends(patch, local, axis)[:, axis] for axis in (0, 1)], axis=1)
    length = np.maximum(end - begin, patch.tuning.least_chord)
    ratio = np.sqrt(length[0] / length[1])
    return np.stack([ratio, 1.0 / ratio], -1)[:, :, None] * np.eye(2)


def _chord_ends(patch: SmoothPatch, local: LocalDepth, axis: int) -> Array:
    """Estimated (u, v) (2, 2, n), within the rim, of the ends of a chord along u (0) or v (1) through contact."""
    depth, slope, k = np.maximum(local.depth, 0.0), local.gradient[:, axis], local.curvature[:, axis, axis]
    ends = np.tile(np.stack([local.u, local.v]), (2, 1, 1))
    for end, sign in zip(ends, (-1.0, 1.0), strict=True):
        end[axis] += sign * edge_distance(depth, sign * slope, k, patch.tuning.least_curvature)
        end[:] = within(patch, *end)
    return ends


def chord_middles(patch: SmoothPatch, R: Array, t: Array, u: Array, v: Array) -> tuple[Array, Array]:
    """Peak of the chord along u through (u, v), then of that along v through this peak.

    Nowhere more shallow than half the depth at (u, v): there a chord's estimated ends missed the contact area.
    """
    for axis in (0, 1):
        local = local_depth(patch, R, t, u, v)
        tried = np.stack(within(patch, *_chord_ends(patch, local, axis).mean(axis=0)))
        deep = local_depth(patch, R, t, *tried).depth >= 0.5 * np.maximum(local.depth, 0.0)
        u, v = np.where((local.depth > 0.0) & deep, tried, [u, v])
    return u, v


def edge_distance(depth: Array, slope: Array, curvature: Array, least_curvature: float) -> Array:
    """r > 0 at which D + b·r - k·r²/2 = 0, for D >= 0 and k not below the least curvature."""
    k = np.maximum(curvature, least_curvature)
    return np.asarray((slope + np.sqrt(slope * slope + 2.0 * k * depth)) / k)
