"""An elastic foundation of a ball in a spherical cup by quadrature over one angle, in NumPy.

With b from the cup's centre to the ball's, directions e of the cup are written about b: e = (x, √(1-x²)·cos φ,
√(1-x²)·sin φ), x the cosine of the angle to b. A ray from the cup of radius R along e leaves the ball of radius r at

    d = s + w - R,   s = |b|·x,   w = √(r² - |b|² + s²),   ∂d/∂b = (1 + s/w)·e - b/w

so that the depth depends on x alone and the contact region is a cap about b, cut by the rim. Of a circle of constant x
the rim leaves the arc |φ| <= Φ(x), over which products of e have closed integrals E1 = ∫e dφ, E2 = ∫e⊗e dφ; what is
left is one integral over x, by Gauss points on whole circles and on arcs:

    F = R² ∫ p(d)·E1 dx,   ∂F/∂b = R² ∫ p'(d)·((1 + s/w)·E2 - E1⊗b/w) dx

F acts through the cup's centre, and turning the ball changes nothing. Φ rises like a root where arcs begin: points
there are those of x = middle - half·cos θ. The kernel in C (``c/cup.h``) follows the same formulas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.pressure_law import pressure_derivatives
from casadi_contact.contact.pressures import MOMENTS
from casadi_contact.core.conventions import Array
from casadi_contact.scenes.scene import Scene

CUP_SHAPE = "ball_in_cup"


@dataclass(frozen=True)
class Cup:
    """Radii [mm], centre (3,) [mm] and unit vector (3,) to the deepest point; half_angle [rad] from there to the rim.

    The ball's centre is the origin of the moving body.
    """

    ball_radius: float
    radius: float
    half_angle: float
    pole: Array
    centre: Array
    least_mm: float = 1e-9  # |b| and its part across the pole have no direction below this
    least_sine: float = 1e-12


def cup_of(scene: Scene) -> Cup:
    """The cup of a scene of the shape `CUP_SHAPE`; raises ValueError for another shape."""
    if scene.shape != CUP_SHAPE:
        raise ValueError(f"scene {scene.name} has the shape {scene.shape}, expected {CUP_SHAPE}")
    g, pole = scene.geometry, np.asarray(scene.geometry["cup_pole"], dtype=float)
    half_angle = float(np.deg2rad(g["cup_half_angle_deg"]))
    centre = np.asarray(g["cup_centre"], dtype=float)
    return Cup(float(g["ball_radius"]), float(g["cup_radius"]), half_angle, pole / np.linalg.norm(pole), centre)


@dataclass(frozen=True)
class Cap:
    """The contact region of n balls: b (n, 3) from the cup's centre, its length and axes (n, 3, 3), the cosine and the
    sine (n,) of its angle to the pole, x at the edge (n,); points x with weights and half arcs Φ (n, m), and s and w.
    """

    b: Array
    length: Array
    frame: Array
    cos_tilt: Array
    sin_tilt: Array
    edge: Array
    x: Array
    weight: Array
    arc: Array
    s: Array
    w: Array

    def first(self) -> Array:
        """E1 (n, m, 3) in the axes of b."""
        return first_moment(self.x, self.arc)


def first_moment(x: Array, arc: Array) -> Array:
    """E1 (..., 3) over half arcs, in the axes of b."""
    across = np.sqrt(np.maximum(1.0 - x * x, 0.0))
    return np.stack([2.0 * x * arc, 2.0 * across * np.sin(arc), np.zeros_like(x)], -1)


def cap_of(cup: Cup, points: int, centres: Array) -> Cap:
    """Contact of balls with their centres (n, 3) in the fixed frame."""
    b = centres - cup.centre
    length = np.maximum(np.linalg.norm(b, axis=1), cup.least_mm)
    frame = _frames(cup, b, length)
    cos_tilt = np.clip(frame[:, 0] @ cup.pole, -1.0, 1.0)
    sin_tilt = frame[:, 1] @ cup.pole
    edge = (cup.radius**2 + length**2 - cup.ball_radius**2) / (2.0 * cup.radius * length)
    edge = np.clip(edge, -1.0, 1.0)  # from |R e - b| = r; 1 where there is no contact
    x, weight, arc = _points(cup, cos_tilt, sin_tilt, edge, points)
    s = length[:, None] * x
    w = np.sqrt(np.maximum(cup.ball_radius**2 - length[:, None] ** 2 + s * s, cup.least_sine))
    return Cap(b, length, frame, cos_tilt, sin_tilt, edge, x, weight, arc, s, w)


def cup_loads(cup: Cup, law: tuple[int, float, float], points: int, centres: Array) -> PatchLoads:
    """Evaluate a cup for balls with their centres (n, 3) in the fixed frame."""
    cap, radius_2 = cap_of(cup, points, centres), cup.radius**2
    p, dp = pressure_derivatives(*law, cap.s + cap.w - cup.radius)
    first = cap.first()
    force = radius_2 * np.einsum("nm,nmi->ni", cap.weight * p, first)
    force = np.einsum("nki,nk->ni", cap.frame, force)
    stiffness = radius_2 * np.einsum("nm,nmij->nij", cap.weight * dp, rates(cap, first))
    stiffness = np.einsum("nki,nkl,nlj->nij", cap.frame, stiffness, cap.frame)
    torque_stiffness = np.swapaxes(np.cross(cup.centre, np.swapaxes(stiffness, 1, 2)), 1, 2)
    gap, gap_gradient = _gap(cup, cap)
    by_translation = np.concatenate([stiffness, torque_stiffness], 1)
    return PatchLoads(
        np.concatenate([force, np.cross(cup.centre, force)], 1),
        np.concatenate([by_translation, np.zeros_like(by_translation)], 2),
        gap,
        np.concatenate([gap_gradient, np.zeros_like(gap_gradient)], 1),
        (cap.edge < 1.0) & (cap.edge < _rims(cup, cap.cos_tilt, cap.sin_tilt)[0]),
    )


def rates(cap: Cap, first: Array) -> Array:
    """∫e⊗∂d/∂b dφ (n, m, 3, 3)."""
    x, arc, square = cap.x, cap.arc, np.maximum(1.0 - cap.x**2, 0.0)
    second = np.zeros((*x.shape, 3, 3))
    second[..., 0, :] = x[..., None] * first
    second[..., 1, 0] = second[..., 0, 1]
    second[..., 1, 1] = square * (arc + np.sin(arc) * np.cos(arc))
    second[..., 2, 2] = square * (arc - np.sin(arc) * np.cos(arc))
    rate = (1.0 + cap.s / cap.w)[..., None, None] * second
    rate[..., 0] -= (cap.length[:, None] / cap.w)[..., None] * first
    return rate


@dataclass(frozen=True)
class Nodes:
    """Gauss points (n,) on -1..1 and their weights: evenly treated ones for circles, cos θ for arcs."""

    whole: Array
    whole_weight: Array
    arc: Array
    arc_weight: Array


def nodes(points: int) -> Nodes:
    """Points of both kinds."""
    x, weight = np.polynomial.legendre.leggauss(points)
    theta = 0.5 * np.pi * (1.0 + x)
    return Nodes(x, weight, np.cos(theta), 0.5 * np.pi * weight * np.sin(theta))


def any_across(cup: Cup) -> Array:
    """A unit vector (3,) across the pole."""
    across = np.cross(cup.pole, np.eye(3)[np.abs(cup.pole).argmin()])
    return np.asarray(across / np.linalg.norm(across))


def _frames(cup: Cup, b: Array, length: Array) -> Array:
    """Right-handed axes in rows (n, 3, 3): along b, and towards the pole; where these are one, any."""
    along = np.where(length[:, None] > cup.least_mm, b / length[:, None], cup.pole)
    beside = any_across(cup)
    over = cup.pole - (along @ cup.pole)[:, None] * along
    tilted = np.linalg.norm(over, axis=1, keepdims=True)
    towards = np.where(tilted > cup.least_mm, over, beside - np.sum(along * beside, 1, keepdims=True) * along)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return np.stack([along, towards, np.cross(along, towards)], 1)


def _rims(cup: Cup, cos_tilt: Array, sin_tilt: Array) -> tuple[Array, Array]:
    """x at which arcs begin to be part of a circle, and at which they end."""
    c, s = np.cos(cup.half_angle), np.sin(cup.half_angle)
    return c * cos_tilt + s * sin_tilt, c * cos_tilt - s * sin_tilt


def arcs_at(cup: Cup, cos_tilt: Array, sin_tilt: Array, x: Array) -> Array:
    """Half arcs Φ that the rim leaves of the circles at x: 0 to π."""
    across = np.sqrt(np.maximum(1.0 - x * x, 0.0)) * sin_tilt
    q = (np.cos(cup.half_angle) - x * cos_tilt) / np.maximum(across, cup.least_sine)
    return np.asarray(np.arccos(np.clip(q, -1.0, 1.0)))


def _points(cup: Cup, cos_tilt: Array, sin_tilt: Array, edge: Array, points: int) -> tuple[Array, Array, Array]:
    """x, weights and half arcs Φ (n, 2·points) of the quadrature."""
    node = nodes(points)
    begin, end = _rims(cup, cos_tilt, sin_tilt)
    inside = cos_tilt > np.cos(cup.half_angle)
    low = np.maximum(edge, np.where(inside, begin, 1.0))[:, None]
    whole = 0.5 * (1.0 + low) + 0.5 * (1.0 - low) * node.whole
    upper = np.maximum(edge, begin)[:, None]
    lower = np.maximum(edge, end)[:, None]
    half = 0.5 * (upper - lower)
    cut = upper - half * (1.0 + node.arc)
    arc = arcs_at(cup, cos_tilt[:, None], sin_tilt[:, None], cut)
    x = np.concatenate([whole, cut], 1)
    weights = np.concatenate([0.5 * (1.0 - low) * node.whole_weight, half * node.arc_weight], 1)
    return x, weights, np.concatenate([np.full_like(whole, np.pi), arc], 1)


def nearest_direction(cup: Cup, cap: Cap) -> Array:
    """Unit vectors (n, 3) from the cup's centre to its point nearest to the ball: along b or, beyond the rim, to the
    rim on the side of b; of a ball in the cup's centre, the pole."""
    flat = cap.b - np.outer(cap.b @ cup.pole, cup.pole)
    size = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = np.where(size > cup.least_mm, flat / np.maximum(size, cup.least_mm), any_across(cup))
    on_rim = np.cos(cup.half_angle) * cup.pole + np.sin(cup.half_angle) * flat
    return np.where((cap.cos_tilt < np.cos(cup.half_angle))[:, None], on_rim, cap.frame[:, 0])


def _gap(cup: Cup, cap: Cap) -> tuple[Array, Array]:
    """Distance of the ball from the cup within its rim (n,), and its derivatives by b (n, 3)."""
    way = cap.b - cup.radius * nearest_direction(cup, cap)
    distance = np.linalg.norm(way, axis=1)
    return distance - cup.ball_radius, way / distance[:, None]


def cup_moments(cup: Cup, law: tuple[int, float, float], points: int, centres: Array) -> tuple[Array, Array]:
    """Moments (n, 6) of balls with their centres (n, 3), and their derivatives by the centre (n, 6, 3)."""
    cap, radius_2 = cap_of(cup, points, centres), cup.radius**2
    p, dp = pressure_derivatives(*law, cap.s + cap.w - cup.radius)
    first, zero = cap.first(), np.zeros((len(centres), MOMENTS))
    value, slope = zero, np.zeros((len(centres), MOMENTS, 3))
    to_fixed = cap.frame
    force = np.einsum("nm,nmi,nij->nj", cap.weight * p, first, to_fixed)
    stiffness = np.einsum("nki,nm,nmkl,nlj->nij", to_fixed, cap.weight * dp, rates(cap, first), to_fixed)
    value[:, 0] = 2.0 * radius_2 * np.sum(cap.weight * cap.arc, axis=1)
    value[:, 1] = 2.0 * radius_2 * np.sum(cap.weight * p * cap.arc, axis=1)
    value[:, 2:5] = value[:, 1:2] * cup.centre + cup.radius**3 * force
    slope[:, 0] = _area_gradient(cup, cap)
    rise = 1.0 + cap.s / cap.w
    along = rise[..., None] * first
    along[..., 0] -= 2.0 * cap.arc * cap.length[:, None] / cap.w
    slope[:, 1] = radius_2 * np.einsum("nm,nmi,nij->nj", cap.weight * dp, along, to_fixed)
    slope[:, 2:5] = cup.centre[:, None] * slope[:, 1:2] + cup.radius**3 * stiffness
    value[:, 5], slope[:, 5] = _largest_depth(cup, cap)
    loaded = value[:, 1] > 0.0
    return np.where(loaded[:, None], value, 0.0), np.where(loaded[:, None, None], slope, 0.0)


def _area_gradient(cup: Cup, cap: Cap) -> Array:
    """R²/|d_x| ∫d_b dφ (n, 3) over the edge of contact."""
    w = np.maximum(cup.radius - cap.length * cap.edge, cup.least_sine)
    rise, lean = cup.radius / w, cap.length / w
    arc = arcs_at(cup, cap.cos_tilt, cap.sin_tilt, cap.edge)
    along = rise[:, None] * first_moment(cap.edge, arc)
    along[:, 0] -= 2.0 * lean * arc
    return np.einsum("ni,nij->nj", cup.radius**2 / (cap.length * rise)[:, None] * along, cap.frame)


def _largest_depth(cup: Cup, cap: Cap) -> tuple[Array, Array]:
    """s + w - R in the nearest direction (n,), and its derivatives by b (n, 3)."""
    e = nearest_direction(cup, cap)
    s = np.sum(e * cap.b, axis=1)
    w = np.sqrt(np.maximum(cup.ball_radius**2 - cap.length**2 + s * s, cup.least_sine))
    return s + w - cup.radius, (1.0 + s / w)[:, None] * e - cap.b / w[:, None]
