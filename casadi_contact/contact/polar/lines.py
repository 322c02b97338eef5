"""The lines of polar quadrature: rays from a contact area's peak to its edge, and across caps of the body's next arcs.

Arcs meet with a common tangent and different curvatures. Rays that cross their junction would feel it at angles that no
rule of equal steps meets. So the torus of the peak's arc is integrated as if it went on; in the cap beyond each
junction, between the chord along it and the edge, that of the arc before is taken away and that of the arc behind is
added: on a fan of rays that begin on the chord, at Gauss points of its angle.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from casadi_contact.contact.polar.peak import Peak, edge_distance
from casadi_contact.contact.polar.ray_hits import LocalDepth, ray_hits, rise
from casadi_contact.contact.polar.surfaces import SmoothPatch
from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class Lines:
    """Lines (n, m) from (u, v) along directions (n, m, 2) to the edge; dr at r is an area (width + spread·r) dr.

    arc: the arc of the moving body whose torus a line is integrated on, also beyond the arc's ends.
    """

    u: Array
    v: Array
    directions: Array
    edge: Array
    arc: np.ndarray
    width: Array
    spread: Array

    def at(self, r: Array) -> tuple[Array, Array]:
        """(u, v) at distances (n, m) or (n, m, points)."""
        more = (...,) + (None,) * (r.ndim - 2)
        du, dv = np.moveaxis(self.directions, -1, 0)
        return self.u[more] + r * du[more], self.v[more] + r * dv[more]

    def points(self, count: int) -> tuple[Array, Array]:
        """Distances and weights (n, m, count) of Gauss points."""
        x, weight = np.polynomial.legendre.leggauss(count)
        r = self.edge[..., None] * (0.5 * (1.0 + x))
        return r, self.edge[..., None] * (0.5 * weight) * (self.width[..., None] + self.spread[..., None] * r)


def joined(parts: list[Lines]) -> Lines:
    """All lines of several sets."""
    return Lines(*(np.concatenate([getattr(part, field.name) for part in parts], axis=1) for field in fields(Lines)))


def to_edges(patch: SmoothPatch, R: Array, t: Array, lines: Lines) -> tuple[Lines, np.ndarray]:
    """The lines with edges, so far estimates, found by Newton's method on g = 0, and which of them the rim ends."""
    reach = _rim_distance(patch, lines.u, lines.v, lines.directions)
    edge = last = np.minimum(lines.edge, reach)
    for _ in range(patch.tuning.edge_steps):
        last, edge = edge, _stepped(patch, R, t, lines, edge, reach)
    found = edge.copy()
    for search, part in ((_stepped, patch.tuning.edge_tolerance), (_bracketed, patch.tuning.bracket_from)):
        far = np.flatnonzero((np.abs(edge - last) > part * np.maximum(last, patch.tuning.least_length)).any(axis=1))
        if len(far):
            few = Lines(*(getattr(lines, field.name)[far] for field in fields(Lines)))
            found[far] = search(patch, R[far], t[far], few, found[far], reach[far])
    return replace(lines, edge=found), (found >= reach) & ((lines.width != 0.0) | (lines.spread != 0.0))


def _stepped(patch: SmoothPatch, R: Array, t: Array, lines: Lines, edge: Array, reach: Array) -> Array:
    """Edges after a step of Newton's method, at most half or twice as far as before."""
    g, slope = _along(patch, R, t, lines, edge)
    return np.minimum(np.clip(edge - g / slope, 0.5 * edge, 2.0 * edge), reach)


def _bracketed(patch: SmoothPatch, R: Array, t: Array, lines: Lines, edge: Array, reach: Array) -> Array:
    """Edges by Newton's method between a point within the body and one beyond it, halved where a step leaves them."""
    low, high = np.zeros_like(edge), reach
    for _ in range(patch.tuning.bracket_steps):
        g, slope = _along(patch, R, t, lines, edge)
        low, high = np.where(g < 0.0, edge, low), np.where(g < 0.0, high, edge)
        moved = np.minimum(edge - g / slope, reach)
        edge = np.where((moved >= low) & (moved <= high), moved, 0.5 * (low + high))
    return edge


def _along(patch: SmoothPatch, R: Array, t: Array, lines: Lines, r: Array) -> tuple[Array, Array]:
    """g at distances (n, m) and its slope along the lines, not below a least one."""
    ends = ray_hits(patch, R, t, *lines.at(r), arc=lines.arc, at_start=True)
    return ends.g, np.maximum(rise(ends, *np.moveaxis(lines.directions, -1, 0)), patch.tuning.least_rise)


def _rim_distance(patch: SmoothPatch, u: Array, v: Array, directions: Array) -> Array:
    """Distance along every line to the rim.

    A curved side, u = ±spread·ρ(v), is an ellipse in the chart: A·r² + 2·B·r + C = 0.
    """
    du, dv = np.moveaxis(directions, -1, 0)
    distance = _box_distance(patch.rim.v, v, dv)
    if patch.torus is None or np.isinf(patch.rim.spread):
        return np.minimum(distance, _box_distance(patch.rim.u, u, du))
    f = patch.torus
    for side in (-patch.rim.spread, patch.rim.spread):
        from_centre = u - side * f.offset
        a, b = du**2 + (side * dv) ** 2, du * from_centre + side**2 * v * dv
        c = from_centre**2 - side**2 * (f.radius**2 - v * v)
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        # The patch lies outside the ellipse where the tube is bent away from the axis, else inside.
        meets = (b < 0.0) & (b * b > a * c) if f.rho_sign < 0.0 else np.full(b.shape, True)
        there = np.maximum((f.rho_sign * root - b) / a, 0.0)
        distance = np.where(meets, np.minimum(distance, there), distance)
    return distance


def _box_distance(bounds: tuple[float, float], x: Array, dx: Array) -> Array:
    """Distance at which x + r·dx, from between the bounds, reaches one of them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = ((bound - x) / dx for bound in bounds)
    return np.maximum(np.fmax(low, high), 0.0)


@dataclass(frozen=True)
class Rays:
    """Number of rays from the peak, and Gauss points on each of them."""

    count: int
    points: int

    @property
    def in_caps(self) -> int:
        """Number of lines over each of the `curvature_jump_segments`: about as many as rays, a multiple of 8."""
        return min(max(self.count // 8 * 8, 8), 24)

    @property
    def at_rim(self) -> int:
        """Number of rays of a contact area that the rim may cut: their sum converges more slowly there."""
        return max(self.count, 32)

    def __str__(self) -> str:
        return f"{self.count} rays × {self.points} points"


def rays_from(patch: SmoothPatch, peak: Peak, count: int, used: np.ndarray) -> list[Lines]:
    """Rays from the peak in the poses where they are used (n,), without area in others; none if that is nowhere.

    Through the torus of the peak's arc, also beyond its ends; where the rim may cut the contact area each ray's own.
    """
    if len(used) and not used.any():
        return []
    m = peak.local
    cosine, sine = ray_angles(count)
    directions = np.einsum("nab,jb->nja", peak.form, np.stack([cosine, sine], -1))
    one = np.ones(directions.shape[:2])
    slope = np.einsum("nr,njr->nj", m.gradient, directions)
    k = np.einsum("njr,nrs,njs->nj", directions, m.curvature, directions)
    edge = edge_distance(np.maximum(m.depth, 0.0)[:, None], slope, k, patch.tuning.least_curvature)
    u, v, arc = (np.broadcast_to(x[:, None], one.shape) for x in (m.u, m.v, np.where(peak.whole, m.ends.arc, -1)))
    spread = np.where(used[:, None], 2.0 * np.pi / count, 0.0) * one
    return [Lines(u, v, directions, np.where(used[:, None], edge, 0.0), arc, 0.0 * one, spread)]


def ray_angles(count: int) -> tuple[Array, Array]:
    """Cosines and sines of equally spaced angles."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return np.cos(angle), np.sin(angle)


@dataclass(frozen=True)
class _Junction:
    """A junction in n poses, seen from the peak of the contact area: its plane, with a point and the normal (n, 3) away
    from the peak; directions (n, 2) across and along it in the chart; the rate (n,) at which points run behind it
    across, and the peak's distance from it. before, behind (n,): the arcs.
    """

    point: Array
    normal: Array
    across: Array
    along: Array
    rate: Array
    distance: Array
    before: np.ndarray
    behind: np.ndarray

    def past(self, x: Array) -> Array:
        """How far points (n, m, 3) lie behind the plane."""
        return np.einsum("nmi,ni->nm", x - self.point[:, None], self.normal)


@dataclass(frozen=True)
class _Chord:
    """Where a junction crosses contact areas: the place (n, 2) of the largest depth on it, and half (n,) of its
    estimated length within the contact; 0 where it does not cross.
    """

    junction: _Junction
    place: Array
    half: Array

    def points(self, s: Array, r: Array) -> tuple[Array, Array]:
        """(u, v) at distances s along the chord and r across it (n, m) from the place."""
        off = s[..., None] * self.junction.along[:, None] + r[..., None] * self.junction.across[:, None]
        u, v = np.moveaxis(self.place[:, None] + off, -1, 0)
        return u, v


def curvature_jump_segments(patch: SmoothPatch, R: Array, t: Array, peak: Peak, count: int) -> list[Lines]:
    """Lines (n, count) of both arcs of each junction; without area where the junction does not cross a contact area."""
    junctions = [_junction(patch, R, t, peak.local, number) for number in range(len(patch.arcs) - 1)]
    chords = [_chord(patch, R, t, peak, junctions, number) for number in range(len(junctions))]
    return [lines for chord in chords for lines in _lines(patch, R, t, peak, chord, count)]


def _junction(patch: SmoothPatch, R: Array, t: Array, m: LocalDepth, number: int) -> _Junction:
    forward = number >= m.ends.arc
    point = t + R[:, :, :2] @ patch.arcs[number, :2]
    normal = np.where(forward, 1.0, -1.0)[:, None] * (R[:, :, :2] @ patch.arcs[number, 3:])
    rates = np.einsum("nai,ni->na", m.ends.tangents, normal)
    rate = np.maximum(np.linalg.norm(rates, axis=1), patch.tuning.least_tilt)
    across = rates / rate[:, None]
    along = np.stack([-across[:, 1], across[:, 0]], -1)
    distance = -np.sum((m.ends.x - point) * normal, -1) / rate
    before, behind = np.where(forward, number, number + 1), np.where(forward, number + 1, number)
    return _Junction(point, normal, across, along, rate, distance, before, behind)


def _chord(patch: SmoothPatch, R: Array, t: Array, peak: Peak, junctions: list[_Junction], number: int) -> _Chord:
    m, j = peak.local, junctions[number]
    # The depth on the line, from the peak's: greatest at `top`
    both = np.stack([j.across, j.along], 1)
    slope, k = np.einsum("nia,na->ni", both, m.gradient), both @ m.curvature @ np.swapaxes(both, 1, 2)
    k_along, slope_along = np.maximum(k[:, 1, 1], patch.tuning.least_curvature), slope[:, 1] - k[:, 0, 1] * j.distance
    top = slope_along / k_along
    depth = np.maximum(m.depth, 0.0) + 0.5 * slope_along * top
    depth += (slope[:, 0] - 0.5 * k[:, 0, 0] * j.distance) * j.distance
    for other, between in enumerate(junctions):  # which bend the body more, or less, on the way
        passed = (m.ends.arc <= other) & (other < number) | (number < other) & (other < m.ends.arc)
        behind, before = (_more_curved(patch, R, t, m, arc[:, None])[:, 0] for arc in (between.behind, between.before))
        way = np.maximum(j.distance - between.distance, 0.0)
        depth -= np.where(passed, 0.5 * _bend(m, j.across[:, None])[:, 0] * (behind - before) * way**2, 0.0)
    crosses = peak.whole & (depth > 0.0)
    off = np.where(crosses[:, None], j.distance[:, None] * j.across + top[:, None] * j.along, 0.0)
    return _Chord(j, np.stack([m.u, m.v], -1) + off, np.sqrt(2.0 * np.where(crosses, depth, 0.0) / k_along))


def _bend(m: LocalDepth, directions: Array) -> Array:
    """Squared component along the peak's arc of unit steps along directions (n, m, 2) in the chart."""
    return np.asarray(np.einsum("nma,nai,ni->nm", directions, m.ends.tangents, m.ends.along) ** 2)


def _lines(patch: SmoothPatch, R: Array, t: Array, peak: Peak, chord: _Chord, count: int) -> list[Lines]:
    """Rays of the fan across the cap, on the arcs before and behind the junction."""
    m, j = peak.local, chord.junction
    start, directions, r, weight = _fan(peak, _ends(patch, R, t, chord), count, patch.tuning.least_chord)
    arc, behind = (np.repeat(a[:, None], count, 1) for a in (j.before, j.behind))
    du, dv = np.moveaxis(directions, -1, 0)
    turned = np.einsum("nma,na->nm", directions, j.across)
    weight = np.where(turned > 0.0, weight, 0.0)  # too short a chord to have a direction
    rate = np.where(weight > 0.0, j.rate[:, None] * turned, np.inf)
    for _ in range(patch.tuning.chord_steps):  # Newton's, onto the junction
        ends = ray_hits(patch, R, t, start[:, :1] + r * du, start[:, 1:] + r * dv, arc=arc)
        r = r - j.past(ends.x) / rate
    u, v = start[:, :1] + r * du, start[:, 1:] + r * dv
    left, falls = np.maximum(-ends.g, 0.0), -rise(ends, du, dv)
    weight = np.where(ends.g < 0.0, weight, 0.0)  # else there is no chord
    crosses = weight > 0.0
    k = np.einsum("nma,nab,nmb->nm", directions, m.curvature, directions)
    bend = _bend(m, directions)
    found = []
    for number, sign in ((arc, -1.0), (behind, 1.0)):
        edge = edge_distance(left, falls, k + bend * _more_curved(patch, R, t, m, number), patch.tuning.least_curvature)
        found.append(Lines(u, v, directions, np.where(crosses, edge, 0.0), number, sign * weight * r, sign * weight))
    return found


def _ends(patch: SmoothPatch, R: Array, t: Array, chord: _Chord) -> Array:
    """(u, v) of the chord's ends (n, 2, 2), by Newton's method on g = 0 and on the junction's plane."""
    j, half, outwards = chord.junction, chord.half[:, None], np.array([-1.0, 1.0])
    s, r, arc = half * outwards, np.zeros((len(half), 2)), np.repeat(j.before[:, None], 2, 1)
    for _ in range(patch.tuning.chord_steps):
        u, v = chord.points(s, r)
        ends = ray_hits(patch, R, t, u, v, arc=arc)
        step = np.clip(-j.past(ends.x) / j.rate[:, None], -0.5 * half, 0.5 * half)
        g = ends.g + rise(ends, *j.across.T[..., None]) * step
        out = g / np.maximum(outwards * rise(ends, *j.along.T[..., None]), patch.tuning.least_rise)
        s, r = s - np.clip(out, -0.5 * half, 0.5 * half) * outwards, r + step
    return np.stack(chord.points(s, r), -1)


def _fan(peak: Peak, ends: Array, count: int, least_chord: float) -> tuple[Array, Array, Array, Array]:
    """Start (n, 2) of a fan of rays, their directions (n, m, 2), distances (n, m) to the chord, weights of the angle.

    Where `form` makes the contact area a circle it is a right angle: caps up to a half circle are smooth in its rays.
    """
    x = np.einsum("nab,neb->nea", np.linalg.inv(peak.form), ends)
    half = 0.5 * (x[:, 1] - x[:, 0])
    across = np.stack([half[:, 1], -half[:, 0]], -1)
    cosine, sine, share = fan_angles(count)
    directions = cosine[:, None] * across[:, None] + sine[:, None] * half[:, None]
    size = np.linalg.norm(half, axis=1)[:, None]
    directions = np.einsum("nab,nmb->nma", peak.form, directions / np.maximum(size, least_chord)[..., None])
    start = np.einsum("nab,nb->na", peak.form, 0.5 * (x[:, 0] + x[:, 1]) - across)
    return start, directions, size / cosine, np.where(size > least_chord, share, 0.0)


def fan_angles(count: int) -> tuple[Array, Array, Array]:
    """Cosine and sine of the rays' angles with the peak of the fan, and weights."""
    place, share = np.polynomial.legendre.leggauss(count)
    angle = 0.25 * np.pi * place
    return np.cos(angle), np.sin(angle), 0.25 * np.pi * share


def _more_curved(patch: SmoothPatch, R: Array, t: Array, m: LocalDepth, arc: np.ndarray) -> Array:
    """Curvature along the arc (n, m) of another arc's torus at the peak, less that of the peak's own."""
    own = patch.arcs[m.ends.arc]
    end = np.einsum("nji,nj->ni", R, m.ends.x - t)[:, :2] - own[:, :2]
    rho = np.hypot(*end.T)
    other = rho[:, None] + patch.arcs[arc, 2] - own[:, 2:3]
    return np.asarray(m.ends.kappa_2[:, None] * (rho[:, None] / np.maximum(other, patch.tuning.least_length) - 1.0))
