"""Polar quadrature of an elastic foundation between smooth surfaces with one area of contact, in NumPy.

In the chart (u, v) of the fixed surface the patch's wrench

    W = -∫ p(d)·V du dv,   V = (N, c × N),   N = τ_v × τ_u (not a unit vector), d the depth along it

is a sum over Gauss points on rays from the peak of the contact area (the trapezoidal rule of a periodic function), as
if the moving arc there went on, and on lines across the caps that other arcs press: the depth is smooth on each of
them, no element jumps in or out. A second contact area on the rim has rays of its own. Derivatives are those of the
integral. The kernel in C (``c/polar.h``) follows the same formulas; each is the other's check.

A body that fits its dish closely, turned or leant in it, bears on the rim as well as in the middle, or on two corners.
Where it does, the distance g from the body falls towards the rim. Of some starts along both sides of the rim at which g
does so, and is small, that of the least g is followed to the least around. About a single area g rises to the rim.
"""

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.friction import PressedPoints
from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.polar.lines import Lines, Rays, curvature_jump_segments, joined, rays_from, to_edges
from casadi_contact.contact.polar.peak import (
    ACROSS,
    Peak,
    chord_form,
    chord_middles,
    deepest_within,
    highest,
    nearest,
    peak,
)
from casadi_contact.contact.polar.ray_hits import RayHits, local_depth, ray_hits, rise
from casadi_contact.contact.polar.surfaces import SmoothPatch, rim_box, stretch
from casadi_contact.contact.pressure_law import pressure_derivatives
from casadi_contact.contact.pressures import MOMENTS
from casadi_contact.core.conventions import Array, wrench_about_origin

RIM_STARTS = np.array([(w, v) for v in (0.0, 1.0) for w in ACROSS]).T  # (2, k): parts of the rim's box in w and v
OUTWARDS = np.rint(2.0 * RIM_STARTS - 1.0) * np.isin(RIM_STARTS, (0.0, 1.0))  # (2, k): -1, 0, 1


def fits_closely(patch: SmoothPatch) -> bool:
    """Whether the largest radius of the body, along its arcs or across, comes near to the dish's: only then is a second
    contact area looked for, which takes a twentieth of the time of all."""
    if (f := patch.torus) is None:
        return False
    along = (float(patch.arcs[:, 2].max()) + patch.tube_radius) / (f.offset + f.radius) if f.w_sign < 0.0 else 0.0
    return max(along, patch.tube_radius / f.radius) > patch.tuning.close_fit


def second_peak(patch: SmoothPatch, R: Array, t: Array, m: Peak) -> tuple[Peak, np.ndarray]:
    """The peak of the second contact area in n poses, and (n,) where there is one.

    Beside a whole contact area it lies on the rim, beside one that the rim may cut half the patch away, past a gap.
    """
    u, v, found = m.local.u.copy(), m.local.v.copy(), np.zeros(len(t), dtype=bool)
    if fits_closely(patch):
        rows, near_u, near_v = _lowest_starts(patch, R, t, m)
        near = highest(patch, R[rows], t[rows], near_u, near_v, at_start=True)
        between = 0.5 * (near.u + u[rows]), 0.5 * (near.v + v[rows])
        gap = ray_hits(patch, R[rows], t[rows], *between, at_start=True).g > 0.0
        apart = np.where(m.whole[rows], _on_rim(patch, near.u, near.v), gap)
        apart &= (near.depth > 0.0) & (near.ends.cosine < patch.tuning.facing)
        rows = rows[apart]
        u[rows], v[rows] = chord_middles(patch, R[rows], t[rows], near.u[apart], near.v[apart])
        found[rows] = True
    local = local_depth(patch, R, t, u, v) if found.any() else m.local
    return Peak(local, chord_form(patch, local), np.zeros_like(m.whole)), found


def _lowest_starts(patch: SmoothPatch, R: Array, t: Array, m: Peak) -> tuple[np.ndarray, Array, Array]:
    """Poses in contact in which g is below `HOVERING_MM` at a start and falls outwards, and (u, v) of the lowest."""
    low, high = rim_box(patch)
    side = (high - low)[:, None]
    w, v = low[:, None] + side * RIM_STARTS
    u, v = (np.broadcast_to(x, (len(t), w.size)) for x in (w * stretch(patch, v)[0], v))
    ends = ray_hits(patch, R, t, u, v, at_start=True)
    out_u, out_v = OUTWARDS
    falls = np.minimum(rise(ends, out_u, 0.0 * out_u), rise(ends, 0.0 * out_v, out_v)) < 0.0
    here = np.stack([m.local.u / stretch(patch, m.local.v)[0], m.local.v])[..., None]
    far = (np.abs(np.stack([np.broadcast_to(w, u.shape), v]) - here) > 0.5 * side[..., None]).any(axis=0)
    g = np.where(falls & (far | m.whole[:, None]) & (m.local.depth > 0.0)[:, None], ends.g, np.inf)
    lowest = np.argmin(g, axis=1)
    rows = np.flatnonzero(g.min(axis=1) < patch.tuning.rim_reach)
    return rows, u[rows, lowest[rows]], v[rows, lowest[rows]]


def _on_rim(patch: SmoothPatch, u: Array, v: Array) -> np.ndarray:
    low, high = rim_box(patch)
    x = np.stack([u / stretch(patch, v)[0], v], -1)
    return np.asarray((np.minimum(x - low, high - x) <= patch.tuning.rim_tolerance * (high - low)).any(axis=1))


def patch_loads(patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, R: Array, t: Array) -> PatchLoads:
    """Evaluate one patch at rotations (n, 3, 3) and translations (n, 3)."""
    R, t = patch.turn @ R, t @ patch.turn.T
    both = np.kron(np.eye(2), patch.turn)
    m = peak(patch, R, t)
    free = ~(m.local.depth > 0.0)
    found = integration(patch, R, t, m, rays)
    ends, weight = found.ends, np.where(free[:, None, None], 0.0, found.weight)
    p, dp = pressure_derivatives(*law, ends.depth)
    V = np.concatenate([ends.N, np.cross(ends.c, ends.N)], -1)
    wrench = -np.einsum("nmg,nmgk->nk", weight * p, V)
    stiffness = -np.einsum("nmg,nmgk,nmga->nka", weight * dp, V, _depth_gradient(ends, t))
    near = nearest(patch, R, t, m.local.u, m.local.v)
    gap_gradient = -wrench_about_origin(near.ends.G_start, near.ends.c - t)
    cut = found.cut.any(axis=1) & ~free
    return PatchLoads(wrench @ both, both.T @ stiffness @ both, near.ends.g, gap_gradient @ both, cut)


def pressed_points(patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, R: Array, t: Array) -> PressedPoints:
    """The points of one patch that bear load at one rotation (1, 3, 3) and translation (1, 3)."""
    R, t = patch.turn @ R, t @ patch.turn.T
    m = peak(patch, R, t)
    if not m.local.depth[0] > 0.0:
        return PressedPoints(*(np.zeros((0, *columns)) for columns in ((3,), (3,), (6,), (), (6,))))
    found = integration(patch, R, t, m, rays)
    ends, both = found.ends, np.kron(np.eye(2), patch.turn)
    p, dp = pressure_derivatives(*law, ends.depth)
    area = found.weight * ends.length
    n = ends.N / ends.length[..., None]
    slopes = (area * dp)[..., None] * _depth_gradient(ends, t) @ both
    places, normals, loads = ends.c @ patch.turn, n @ patch.turn, wrench_about_origin(n, ends.c) @ both
    return PressedPoints(*(x[0].reshape(-1, *x.shape[3:]) for x in (places, normals, loads, area * p, slopes)))


@dataclass(frozen=True)
class Integration:
    """What contact areas are integrated on: lines, which of them the rim ends, and points (n, lines, points) on them in
    the chart, with weights (areas in the chart) and the ends of rays from there.
    """

    lines: Lines
    cut: np.ndarray
    u: Array
    v: Array
    weight: Array
    ends: RayHits


def integration(patch: SmoothPatch, R: Array, t: Array, m: Peak, rays: Rays) -> Integration:
    """Rays from the peak of each contact area, the lines of its caps, and rays of a second contact area on the rim."""
    beside, there = second_peak(patch, R, t, m)
    sets = [
        *rays_from(patch, m, rays.count, m.whole),
        *rays_from(patch, m, rays.at_rim, ~m.whole),
        *rays_from(patch, beside, rays.at_rim, there),
        *curvature_jump_segments(patch, R, t, m, rays.in_caps),
    ]
    lines, cut = to_edges(patch, R, t, joined(sets))
    r, weight = lines.points(rays.points)
    u, v = lines.at(r)
    return Integration(lines, cut, u, v, weight, ray_hits(patch, R, t, u, v, arc=lines.arc[..., None]))


def patch_moments(
    patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, R: Array, t: Array
) -> tuple[Array, Array]:
    """Moments (n, 6) of one patch and their derivatives by the twist of the moving body about t (n, 6, 6)."""
    R, t = patch.turn @ R, t @ patch.turn.T
    m = peak(patch, R, t)
    loaded = m.local.depth > 0.0
    found = integration(patch, R, t, m, rays)
    ends = found.ends
    p, dp = pressure_derivatives(*law, ends.depth)
    area = found.weight * ends.length
    by_twist = _depth_gradient(ends, t)
    value, slope = np.zeros((len(t), MOMENTS)), np.zeros((len(t), MOMENTS, 6))
    value[:, 0], value[:, 1] = np.sum(area, (1, 2)), np.sum(area * p, (1, 2))
    value[:, 2:5] = np.einsum("nmg,nmgi->ni", area * p, ends.c) @ patch.turn
    slope[:, 0] = _area_gradient(patch, R, t, found)
    slope[:, 1] = np.einsum("nmg,nmga->na", area * dp, by_twist)
    slope[:, 2:5] = patch.turn.T @ np.einsum("nmg,nmgi,nmga->nia", area * dp, ends.c, by_twist)
    there = deepest_within(patch, R, t, m.local.u, m.local.v)
    value[:, 5], slope[:, 5] = there.depth, _depth_gradient(there.ends, t)
    slope = slope @ np.kron(np.eye(2), patch.turn)
    return np.where(loaded[:, None], value, 0.0), np.where(loaded[:, None, None], slope, 0.0)


def _depth_gradient(ends: RayHits, t: Array) -> Array:
    """dd/dtwist (n, ..., 6) = -(G, arm × G)/σ."""
    arm = ends.x - t.reshape(len(t), *([1] * (ends.x.ndim - 2)), 3)
    return -wrench_about_origin(ends.G, arm) / ends.cosine[..., None]


def _area_gradient(patch: SmoothPatch, R: Array, t: Array, found: Integration) -> Array:
    """Derivative (n, 6) of the area by the twist, in chart axes."""
    lines = found.lines
    ends = ray_hits(patch, R, t, *lines.at(lines.edge), arc=lines.arc)
    steepness = np.minimum(rise(ends, *np.moveaxis(lines.directions, -1, 0)) / ends.cosine, -patch.tuning.least_rise)
    width = (lines.width + lines.spread * lines.edge) * ends.length * ~found.cut
    return -np.einsum("nm,nma->na", width / steepness, _depth_gradient(ends, t))
