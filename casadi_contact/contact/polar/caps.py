"""What the moving body's next arc changes of a spot: the caps of the spot beyond the junctions of arcs.

Arcs meet with a common tangent and different curvatures. Rays that cross their junction would feel it at angles that no
rule of equal steps meets. So the torus of the middle's arc is integrated as if it went on; in the cap beyond each
junction, between the chord along it and the edge, that of the arc before is taken away and that of the arc behind is
added: on a fan of rays that begin on the chord, at Gauss points of its angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.ends import LEAST_LENGTH, LEAST_RISE, ray_ends, rise
from casadi_contact.contact.polar.lines import Lines
from casadi_contact.contact.polar.middle import LEAST_CHORD_MM, Middle, edge_distance
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.spot import Spot, bounded
from casadi_contact.conventions import Array

CHORD_STEPS = 2
LEAST_TILT = 1e-9  # between the junction's plane and the patch


@dataclass(frozen=True)
class _Chord:
    """The line in the chart on which a junction lies, in n poses as the middle of the spot sees it.

    place (n, 2) of the largest depth on it, and unit vectors (n, 2) along it and across it, away from the middle; half
    (n,): of its length within the contact, estimated, 0 where it does not cross a spot. plane, axis (n, 3): the
    junction's normal and a point of it; rate (n,): at which points run behind it. before, behind (n,): the arcs.
    """

    place: Array
    along: Array
    across: Array
    half: Array
    plane: Array
    axis: Array
    rate: Array
    before: np.ndarray
    behind: np.ndarray

    def points(self, s: Array, r: Array) -> tuple[Array, Array]:
        """(u, v) at distances s along the chord and r across it (n, m) from the place."""
        off = s[..., None] * self.along[:, None] + r[..., None] * self.across[:, None]
        u, v = np.moveaxis(self.place[:, None] + off, -1, 0)
        return u, v


def caps(patch: SmoothPatch, R: Array, t: Array, middle: Middle, count: int) -> list[Lines]:
    """Lines (n, count) of both arcs of each junction; without area where the junction does not cross a spot."""
    junctions = range(len(patch.arcs) - 1)
    distances = np.array([_distance(patch, R, t, middle.spot, number) for number in junctions])
    chords = [_chord(patch, R, t, middle, number, distances) for number in junctions]
    return [lines for chord in chords for lines in _lines(patch, R, t, middle, chord, count)]


@dataclass(frozen=True)
class _Plane:
    """The plane of a junction in n poses, its normal away from the middle: point and normal (n, 3), rates along the
    chart (n, 2) at which points run behind it, whether the arcs behind it have higher numbers."""

    point: Array
    normal: Array
    rates: Array
    forward: np.ndarray


def _plane(patch: SmoothPatch, R: Array, t: Array, m: Spot, junction: int) -> _Plane:
    forward = junction >= m.ends.arc
    normal = np.where(forward, 1.0, -1.0)[:, None] * (R[:, :, :2] @ patch.arcs[junction, 3:])
    rates = np.einsum("nai,ni->na", m.ends.tangents, normal)
    return _Plane(t + R[:, :, :2] @ patch.arcs[junction, :2], normal, rates, forward)


def _distance(patch: SmoothPatch, R: Array, t: Array, m: Spot, junction: int) -> Array:
    """Of the middle from a junction, along the chart (n,)."""
    plane = _plane(patch, R, t, m, junction)
    rate = np.maximum(np.linalg.norm(plane.rates, axis=1), LEAST_TILT)
    return np.asarray(-np.sum((m.ends.x - plane.point) * plane.normal, -1) / rate)


def _chord(patch: SmoothPatch, R: Array, t: Array, middle: Middle, junction: int, distances: Array) -> _Chord:
    m, plane = middle.spot, _plane(patch, R, t, middle.spot, junction)
    rate = np.maximum(np.linalg.norm(plane.rates, axis=1), LEAST_TILT)
    across = plane.rates / rate[:, None]
    along = np.stack([-across[:, 1], across[:, 0]], -1)
    distance = distances[junction]
    # The depth on the line, from the middle's: greatest at `top`
    both = np.stack([across, along], 1)
    slope, k = np.einsum("nia,na->ni", both, m.slope), both @ m.curvature @ np.swapaxes(both, 1, 2)
    k_along, slope_along = bounded(k[:, 1, 1]), slope[:, 1] - k[:, 0, 1] * distance
    top = slope_along / k_along
    depth = np.maximum(m.depth, 0.0) + (slope[:, 0] - 0.5 * k[:, 0, 0] * distance) * distance + 0.5 * slope_along * top
    depth = depth - 0.5 * _bend(m, across) * _more_depth(patch, R, t, m, junction, distances)
    crosses = middle.whole & (depth > 0.0)
    off = np.where(crosses[:, None], distance[:, None] * across + top[:, None] * along, 0.0)
    half = np.sqrt(2.0 * np.where(crosses, depth, 0.0) / k_along)
    before = np.where(plane.forward, junction, junction + 1)
    behind = np.where(plane.forward, junction + 1, junction)
    return _Chord(np.stack([m.u, m.v], -1) + off, along, across, half, plane.normal, plane.point, rate, before, behind)


def _bend(m: Spot, across: Array) -> Array:
    """(n,): squared component along the middle's arc of a unit step along directions (n, 2) in the chart."""
    return np.einsum("na,nai,ni->n", across, m.ends.tangents, m.ends.along) ** 2


def _more_depth(patch: SmoothPatch, R: Array, t: Array, m: Spot, junction: int, distances: Array) -> Array:
    """Sum over the junctions before this one, seen from the middle, of how much more curved the body is behind each,
    times the square of the way from there."""
    more = np.zeros_like(m.u)
    for number in range(len(patch.arcs) - 1):
        between = (m.ends.arc <= number) & (number < junction) | (junction < number) & (number < m.ends.arc)
        forward = number >= m.ends.arc
        step = (
            np.where(forward, 1.0, -1.0)
            * (
                _more_curved(patch, R, t, m, np.full((len(m.u), 1), number + 1))
                - _more_curved(patch, R, t, m, np.full((len(m.u), 1), number))
            )[:, 0]
        )
        way = np.maximum(distances[junction] - distances[number], 0.0)
        more += np.where(between, step * way**2, 0.0)
    return more


def _lines(patch: SmoothPatch, R: Array, t: Array, middle: Middle, chord: _Chord, count: int) -> list[Lines]:
    """Rays of the fan across the cap, on the arcs before and behind the junction."""
    m = middle.spot
    start, directions, r, weight = _fan(middle, _ends(patch, R, t, chord), count)
    arc, behind = (np.repeat(a[:, None], count, 1) for a in (chord.before, chord.behind))
    du, dv = np.moveaxis(directions, -1, 0)
    turned = np.einsum("nma,na->nm", directions, chord.across)
    weight = np.where(turned > 0.0, weight, 0.0)  # too short a chord to have a direction
    crosses = weight > 0.0
    rate = np.where(crosses, chord.rate[:, None] * turned, np.inf)
    for _ in range(CHORD_STEPS):  # Newton's, onto the junction
        ends = ray_ends(patch, R, t, start[:, :1] + r * du, start[:, 1:] + r * dv, arc=arc)
        r = r - np.einsum("nmi,ni->nm", ends.x - chord.axis[:, None], chord.plane) / rate
    u, v = start[:, :1] + r * du, start[:, 1:] + r * dv
    left, falls = np.maximum(-ends.g, 0.0), -rise(ends, du, dv)
    weight = np.where(ends.g < 0.0, weight, 0.0)  # else there is no chord
    crosses = weight > 0.0
    k = np.einsum("nma,nab,nmb->nm", directions, m.curvature, directions)
    bend = np.einsum("nma,nai,ni->nm", directions, m.ends.tangents, m.ends.along) ** 2
    found = []
    for number, sign in ((arc, -1.0), (behind, 1.0)):
        edge = edge_distance(left, falls, k + bend * _more_curved(patch, R, t, m, number))
        found.append(Lines(u, v, directions, np.where(crosses, edge, 0.0), number, sign * weight * r, sign * weight))
    return found


def _ends(patch: SmoothPatch, R: Array, t: Array, chord: _Chord) -> Array:
    """(u, v) of the chord's ends (n, 2, 2), by Newton's method on g = 0 and on the junction's plane."""
    half, outwards = chord.half[:, None], np.array([-1.0, 1.0])
    s, r, arc = half * outwards, np.zeros((len(half), 2)), np.repeat(chord.before[:, None], 2, 1)
    for _ in range(CHORD_STEPS):
        u, v = chord.points(s, r)
        ends = ray_ends(patch, R, t, u, v, arc=arc)
        step = -np.einsum("nmi,ni->nm", ends.x - chord.axis[:, None], chord.plane) / chord.rate[:, None]
        step = np.clip(step, -0.5 * half, 0.5 * half)
        g = ends.g + rise(ends, *chord.across.T[..., None]) * step
        out = g / np.maximum(outwards * rise(ends, *chord.along.T[..., None]), LEAST_RISE)
        s, r = s - np.clip(out, -0.5 * half, 0.5 * half) * outwards, r + step
    return np.stack(chord.points(s, r), -1)


def _fan(middle: Middle, ends: Array, count: int) -> tuple[Array, Array, Array, Array]:
    """Start (n, 2) of a fan of rays, their directions (n, m, 2), distances (n, m) to the chord, weights of the angle.

    Where `form` makes the spot a circle the fan is a right angle over the chord: caps up to a half circle are smooth
    functions of its rays.
    """
    x = np.einsum("nab,neb->nea", np.linalg.inv(middle.form), ends)
    half = 0.5 * (x[:, 1] - x[:, 0])
    across = np.stack([half[:, 1], -half[:, 0]], -1)
    cosine, sine, share = fan_angles(count)
    directions = cosine[:, None] * across[:, None] + sine[:, None] * half[:, None]
    size = np.linalg.norm(half, axis=1)[:, None]
    directions = np.einsum("nab,nmb->nma", middle.form, directions / np.maximum(size, LEAST_CHORD_MM)[..., None])
    start = np.einsum("nab,nb->na", middle.form, 0.5 * (x[:, 0] + x[:, 1]) - across)
    return start, directions, size / cosine, np.where(size > LEAST_CHORD_MM, share, 0.0)


def fan_angles(count: int) -> tuple[Array, Array, Array]:
    """Cosine and sine of the rays' angles with the middle of the fan, and weights."""
    place, share = np.polynomial.legendre.leggauss(count)
    angle = 0.25 * np.pi * place
    return np.cos(angle), np.sin(angle), 0.25 * np.pi * share


def _more_curved(patch: SmoothPatch, R: Array, t: Array, m: Spot, arc: np.ndarray) -> Array:
    """Curvature along the arc (n, m) of another arc's torus at the middle, less that of the middle's own."""
    own = patch.arcs[m.ends.arc]
    end = np.einsum("nji,nj->ni", R, m.ends.x - t)[:, :2] - own[:, :2]
    rho = np.hypot(*end.T)
    other = rho[:, None] + patch.arcs[arc, 2] - own[:, 2:3]
    return np.asarray(m.ends.kappa_2[:, None] * (rho[:, None] / np.maximum(other, LEAST_LENGTH) - 1.0))
