"""A second spot of contact, where one of the two lies on the rim.

A body that fits its dish closely, turned or leant in it, bears on the rim as well as in the middle, or on two corners.
Where it does, the distance g from the body falls towards the rim. Of some starts along both sides of the rim at which g
does so, and is small, the one with the least g is followed to the least around. About a single spot g rises towards the
rim.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.polar.ends import ray_ends, rise
from casadi_contact.contact.polar.middle import Middle, as_long, chord_middles
from casadi_contact.contact.polar.nearest import ACROSS, highest
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.rim import rim_box, stretch
from casadi_contact.contact.polar.spot import spot_at
from casadi_contact.core.conventions import Array

CLOSE_FIT = 0.8  # in 6,900 pressed poses of six knees that fit less closely no second spot was found
HOVERING_MM = 1.0  # more than g falls between two starts
FACING = -0.9  # cos of the angle between a ray and the surface that it meets: a body's back faces away
ON_RIM = 1e-9  # part of the patch
RIM_STARTS = np.array([(w, v) for v in (0.0, 1.0) for w in ACROSS]).T  # (2, k): parts of the rim's box in w and v
OUTWARDS = np.rint(2.0 * RIM_STARTS - 1.0) * np.isin(RIM_STARTS, (0.0, 1.0))  # (2, k): -1, 0, 1


def fits_closely(patch: SmoothPatch) -> bool:
    """Whether the largest radius of the body, along its arcs or across, comes near to the dish's: only then is a second
    spot looked for, which takes a twentieth of the time of all."""
    if (f := patch.torus) is None:
        return False
    along = (float(patch.arcs[:, 2].max()) + patch.tube_radius) / (f.offset + f.radius) if f.w_sign < 0.0 else 0.0
    return max(along, patch.tube_radius / f.radius) > CLOSE_FIT


def second_middle(patch: SmoothPatch, R: Array, t: Array, m: Middle) -> tuple[Middle, np.ndarray]:
    """The middle of the second spot in n poses, and (n,) where there is one.

    Beside a whole spot it lies on the rim; beside one that the rim may cut half the patch away, and between the two is
    a gap.
    """
    u, v, found = m.spot.u.copy(), m.spot.v.copy(), np.zeros(len(t), dtype=bool)
    if fits_closely(patch):
        rows, near_u, near_v = _lowest_starts(patch, R, t, m)
        near = highest(patch, R[rows], t[rows], near_u, near_v, at_start=True)
        between = 0.5 * (near.u + u[rows]), 0.5 * (near.v + v[rows])
        gap = ray_ends(patch, R[rows], t[rows], *between, at_start=True).g > 0.0
        apart = np.where(m.whole[rows], _on_rim(patch, near.u, near.v), gap)
        apart &= (near.depth > 0.0) & (near.ends.slope < FACING)
        rows = rows[apart]
        u[rows], v[rows] = chord_middles(patch, R[rows], t[rows], near.u[apart], near.v[apart])
        found[rows] = True
    spot = spot_at(patch, R, t, u, v) if found.any() else m.spot
    return Middle(spot, as_long(patch, spot), np.zeros_like(m.whole)), found


def _lowest_starts(patch: SmoothPatch, R: Array, t: Array, m: Middle) -> tuple[np.ndarray, Array, Array]:
    """Poses in contact in which g is below `HOVERING_MM` at a start and falls outwards, and (u, v) of the lowest."""
    low, high = rim_box(patch)
    side = (high - low)[:, None]
    w, v = low[:, None] + side * RIM_STARTS
    u, v = (np.broadcast_to(x, (len(t), w.size)) for x in (w * stretch(patch, v)[0], v))
    ends = ray_ends(patch, R, t, u, v, at_start=True)
    out_u, out_v = OUTWARDS
    falls = np.minimum(rise(ends, out_u, 0.0 * out_u), rise(ends, 0.0 * out_v, out_v)) < 0.0
    here = np.stack([m.spot.u / stretch(patch, m.spot.v)[0], m.spot.v])[..., None]
    far = (np.abs(np.stack([np.broadcast_to(w, u.shape), v]) - here) > 0.5 * side[..., None]).any(axis=0)
    g = np.where(falls & (far | m.whole[:, None]) & (m.spot.depth > 0.0)[:, None], ends.g, np.inf)
    lowest = np.argmin(g, axis=1)
    rows = np.flatnonzero(g.min(axis=1) < HOVERING_MM)
    return rows, u[rows, lowest[rows]], v[rows, lowest[rows]]


def _on_rim(patch: SmoothPatch, u: Array, v: Array) -> np.ndarray:
    low, high = rim_box(patch)
    x = np.stack([u / stretch(patch, v)[0], v], -1)
    return np.asarray((np.minimum(x - low, high - x) <= ON_RIM * (high - low)).any(axis=1))
