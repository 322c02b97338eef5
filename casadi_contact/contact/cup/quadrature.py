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

from casadi_contact.contact.cup.cup import Cup
from casadi_contact.contact.pressure import pressure_slopes
from casadi_contact.conventions import Array

LEAST_MM = 1e-9  # of |b| and of its part across the pole, below which they have no direction
_LEAST_SINE = 1e-12


@dataclass(frozen=True)
class CupLoads:
    """Force on the cup (n, 3) and the gap (n,), with derivatives by the ball's centre (n, 3, 3), (n, 3).

    cut (n,): contact reaches the rim.
    """

    force: Array
    stiffness: Array
    gap: Array
    gap_slope: Array
    cut: np.ndarray


def cup_loads(cup: Cup, law: tuple[int, float, float], points: int, centres: Array) -> CupLoads:
    """Evaluate a cup for balls with their centres (n, 3) in the fixed frame."""
    b = centres - cup.centre
    length = np.maximum(np.linalg.norm(b, axis=1), LEAST_MM)
    frame = frames(cup, b, length)
    cos_tilt = np.clip(frame[:, 0] @ cup.pole, -1.0, 1.0)
    sin_tilt = frame[:, 1] @ cup.pole
    edge = edge_cosine(cup, length)
    x, weight, arc = _points(cup, cos_tilt, sin_tilt, edge, points)
    s, radius_2 = length[:, None] * x, cup.radius**2
    w = np.sqrt(np.maximum(cup.ball_radius**2 - length[:, None] ** 2 + s * s, _LEAST_SINE))
    p, dp = pressure_slopes(*law, s + w - cup.radius)
    across = np.sqrt(np.maximum(1.0 - x * x, 0.0))
    sine, zero = np.sin(arc), np.zeros_like(x)
    first = np.stack([2.0 * x * arc, 2.0 * across * sine, zero], -1)
    second = np.zeros((*x.shape, 3, 3))
    second[..., 0, 0] = 2.0 * x * x * arc
    second[..., 0, 1] = second[..., 1, 0] = 2.0 * x * across * sine
    second[..., 1, 1] = across**2 * (arc + sine * np.cos(arc))
    second[..., 2, 2] = across**2 * (arc - sine * np.cos(arc))
    rate = (1.0 + s / w)[..., None, None] * second
    rate[..., 0] -= (length[:, None] / w)[..., None] * first
    force = radius_2 * np.einsum("nm,nmi->ni", weight * p, first)
    stiffness = radius_2 * np.einsum("nm,nmij->nij", weight * dp, rate)
    gap, gap_slope = _gap(cup, b, length, frame, cos_tilt)
    return CupLoads(
        np.einsum("nki,nk->ni", frame, force),
        np.einsum("nki,nkl,nlj->nij", frame, stiffness, frame),
        gap,
        gap_slope,
        (edge < 1.0) & (edge < _rims(cup, cos_tilt, sin_tilt)[0]),
    )


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


def frames(cup: Cup, b: Array, length: Array) -> Array:
    """Right-handed axes in rows (n, 3, 3): along b, and towards the pole; where these are one, any."""
    along = np.where(length[:, None] > LEAST_MM, b / length[:, None], cup.pole)
    beside = any_across(cup)
    over = cup.pole - (along @ cup.pole)[:, None] * along
    tilted = np.linalg.norm(over, axis=1, keepdims=True)
    towards = np.where(tilted > LEAST_MM, over, beside - np.sum(along * beside, 1, keepdims=True) * along)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return np.stack([along, towards, np.cross(along, towards)], 1)


def edge_cosine(cup: Cup, length: Array) -> Array:
    """x at the edge of contact, from |R e - b| = r; 1 where there is none, at least -1."""
    x = (cup.radius**2 + length**2 - cup.ball_radius**2) / (2.0 * cup.radius * length)
    return np.clip(x, -1.0, 1.0)


def _rims(cup: Cup, cos_tilt: Array, sin_tilt: Array) -> tuple[Array, Array]:
    """x at which arcs begin to be part of a circle, and at which they end."""
    c, s = np.cos(cup.half_angle), np.sin(cup.half_angle)
    return c * cos_tilt + s * sin_tilt, c * cos_tilt - s * sin_tilt


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
    q = np.cos(cup.half_angle) - cut * cos_tilt[:, None]
    q /= np.maximum(np.sqrt(np.maximum(1.0 - cut * cut, 0.0)) * sin_tilt[:, None], _LEAST_SINE)
    arc = np.arccos(np.clip(q, -1.0, 1.0))
    x = np.concatenate([whole, cut], 1)
    weights = np.concatenate([0.5 * (1.0 - low) * node.whole_weight, half * node.arc_weight], 1)
    return x, weights, np.concatenate([np.full_like(whole, np.pi), arc], 1)


def _gap(cup: Cup, b: Array, length: Array, frame: Array, cos_tilt: Array) -> tuple[Array, Array]:
    """Distance of the ball from the cup within its rim (n,), and its derivatives by b (n, 3).

    The nearest point lies along b or, beyond the rim, on the rim towards b; of a ball in the cup's centre, at the pole.
    """
    flat = b - np.outer(b @ cup.pole, cup.pole)
    size = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = np.where(size > LEAST_MM, flat / np.maximum(size, LEAST_MM), any_across(cup))
    on_rim = np.cos(cup.half_angle) * cup.pole + np.sin(cup.half_angle) * flat
    nearest = cup.radius * np.where((cos_tilt < np.cos(cup.half_angle))[:, None], on_rim, frame[:, 0])
    distance = np.linalg.norm(nearest - b, axis=1)
    return distance - cup.ball_radius, (b - nearest) / distance[:, None]
