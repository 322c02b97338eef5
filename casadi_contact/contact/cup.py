"""The elastic foundation of a ball in a spherical cup: quadrature over one angle, the rest in closed form.

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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.approach import press_until
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.convergence import cheapest, forces_tried
from casadi_contact.contact.foundation_source import C_FOLDER, definitions
from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.pressure_law import law_of, pressure_derivatives
from casadi_contact.contact.pressures import MOMENTS
from casadi_contact.core.conventions import Array
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.scenes.scene import Scene

CUP_SHAPE = "ball_in_cup"


@dataclass(frozen=True)
class Cup:
    """Radii [mm], centre (3,) [mm], unit vector (3,) to the deepest point, half_angle [rad] from there to the rim."""

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
    cap = cap_of(cup, points, centres)
    force, stiffness = _force(cup, cap, *pressure_derivatives(*law, cap.s + cap.w - cup.radius))
    torque_stiffness = np.swapaxes(np.cross(cup.centre, np.swapaxes(stiffness, 1, 2)), 1, 2)
    by_translation = np.concatenate([stiffness, torque_stiffness], 1)
    way = cap.b - cup.radius * nearest_direction(cup, cap)
    distance = np.linalg.norm(way, axis=1)
    return PatchLoads(
        np.concatenate([force, np.cross(cup.centre, force)], 1),
        np.concatenate([by_translation, np.zeros_like(by_translation)], 2),
        distance - cup.ball_radius,
        np.pad(way / distance[:, None], ((0, 0), (0, 3))),
        (cap.edge < 1.0) & (cap.edge < _rims(cup, cap.cos_tilt, cap.sin_tilt)[0]),
    )


def _force(cup: Cup, cap: Cap, p: Array, dp: Array) -> tuple[Array, Array]:
    """F (n, 3) and ∂F/∂b (n, 3, 3) of pressures and their slopes (n, m)."""
    x, arc, square = cap.x, cap.arc, np.maximum(1.0 - cap.x**2, 0.0)
    first, second = _first_moment(x, arc), np.zeros((*x.shape, 3, 3))
    second[..., 0, :] = x[..., None] * first
    second[..., 1, 0] = second[..., 0, 1]
    second[..., 1, 1] = square * (arc + np.sin(arc) * np.cos(arc))
    second[..., 2, 2] = square * (arc - np.sin(arc) * np.cos(arc))
    rate = (1.0 + cap.s / cap.w)[..., None, None] * second  # ∫e⊗∂d/∂b dφ
    rate[..., 0] -= (cap.length[:, None] / cap.w)[..., None] * first
    force = np.einsum("nm,nmi,nij->nj", cap.weight * p, first, cap.frame)
    stiffness = np.einsum("nki,nm,nmkl,nlj->nij", cap.frame, cap.weight * dp, rate, cap.frame, optimize=True)
    return cup.radius**2 * force, cup.radius**2 * stiffness


def _first_moment(x: Array, arc: Array) -> Array:
    """E1 (..., 3) over half arcs, in the axes of b."""
    across = np.sqrt(np.maximum(1.0 - x * x, 0.0))
    return np.stack([2.0 * x * arc, 2.0 * across * np.sin(arc), np.zeros_like(x)], -1)


def nodes(points: int) -> tuple[Array, Array, Array, Array]:
    """Gauss points (n,) on -1..1 and their weights, for circles; cos θ and weights, for arcs."""
    x, weight = np.polynomial.legendre.leggauss(points)
    theta = 0.5 * np.pi * (1.0 + x)
    return x, weight, np.cos(theta), 0.5 * np.pi * weight * np.sin(theta)


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
    on_circle, circle_weight, on_arc, arc_weight = nodes(points)
    begin, end = _rims(cup, cos_tilt, sin_tilt)
    inside = cos_tilt > np.cos(cup.half_angle)
    low = np.maximum(edge, np.where(inside, begin, 1.0))[:, None]
    whole = 0.5 * (1.0 + low) + 0.5 * (1.0 - low) * on_circle
    upper = np.maximum(edge, begin)[:, None]
    lower = np.maximum(edge, end)[:, None]
    half = 0.5 * (upper - lower)
    cut = upper - half * (1.0 + on_arc)
    arc = arcs_at(cup, cos_tilt[:, None], sin_tilt[:, None], cut)
    x = np.concatenate([whole, cut], 1)
    weights = np.concatenate([0.5 * (1.0 - low) * circle_weight, half * arc_weight], 1)
    return x, weights, np.concatenate([np.full_like(whole, np.pi), arc], 1)


def nearest_direction(cup: Cup, cap: Cap) -> Array:
    """Unit vectors (n, 3) to the cup's nearest point: along b (the pole where b is 0), or to the rim on b's side."""
    flat = cap.b - np.outer(cap.b @ cup.pole, cup.pole)
    size = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = np.where(size > cup.least_mm, flat / np.maximum(size, cup.least_mm), any_across(cup))
    on_rim = np.cos(cup.half_angle) * cup.pole + np.sin(cup.half_angle) * flat
    return np.where((cap.cos_tilt < np.cos(cup.half_angle))[:, None], on_rim, cap.frame[:, 0])


def cup_moments(cup: Cup, law: tuple[int, float, float], points: int, centres: Array) -> tuple[Array, Array]:
    """Moments (n, 6) of balls with their centres (n, 3), and their derivatives by the centre (n, 6, 3)."""
    cap, radius_2 = cap_of(cup, points, centres), cup.radius**2
    p, dp = pressure_derivatives(*law, cap.s + cap.w - cup.radius)
    force, stiffness = _force(cup, cap, p, dp)
    value, slope = np.zeros((len(centres), MOMENTS)), np.zeros((len(centres), MOMENTS, 3))
    value[:, 0] = 2.0 * radius_2 * np.sum(cap.weight * cap.arc, axis=1)
    value[:, 1] = 2.0 * radius_2 * np.sum(cap.weight * p * cap.arc, axis=1)
    value[:, 2:5] = value[:, 1:2] * cup.centre + cup.radius * force
    # The area by d_b over the edge of contact: R²/|d_x| ∫d_b dφ
    w = np.maximum(cup.radius - cap.length * cap.edge, cup.least_sine)
    edge_arc = arcs_at(cup, cap.cos_tilt, cap.sin_tilt, cap.edge)
    at_edge = _along_b(cap.edge, edge_arc, cup.radius / w, cap.length / w)
    slope[:, 0] = np.einsum("ni,nij->nj", cup.radius * w[:, None] / cap.length[:, None] * at_edge, cap.frame)
    along = _along_b(cap.x, cap.arc, 1.0 + cap.s / cap.w, cap.length[:, None] / cap.w)
    slope[:, 1] = radius_2 * np.einsum("nm,nmi,nij->nj", cap.weight * dp, along, cap.frame)
    slope[:, 2:5] = cup.centre[:, None] * slope[:, 1:2] + cup.radius * stiffness
    value[:, 5], slope[:, 5] = _largest_depth(cup, cap)
    loaded = value[:, 1] > 0.0
    return np.where(loaded[:, None], value, 0.0), np.where(loaded[:, None, None], slope, 0.0)


def _along_b(x: Array, arc: Array, rise: Array, lean: Array) -> Array:
    """∫∂d/∂b dφ (..., 3) = rise·E1 - lean·∫dφ·b/|b| over half arcs, in the axes of b."""
    along = rise[..., None] * _first_moment(x, arc)
    along[..., 0] -= 2.0 * lean * arc
    return along


def _largest_depth(cup: Cup, cap: Cap) -> tuple[Array, Array]:
    """s + w - R in the nearest direction (n,), and its derivatives by b (n, 3)."""
    e = nearest_direction(cup, cap)
    s = np.sum(e * cap.b, axis=1)
    w = np.sqrt(np.maximum(cup.ball_radius**2 - cap.length**2 + s * s, cup.least_sine))
    return s + w - cup.radius, (1.0 + s / w)[:, None] * e - cap.b / w[:, None]


def cup_source(cup: Cup, points: int) -> str:
    """Tables of the cup and `patch_loads`."""
    numbers = {
        "POINTS": points,
        "BALL_RADIUS": cup.ball_radius,
        "CUP_RADIUS": cup.radius,
        "RIM_COS": float(np.cos(cup.half_angle)),
        "RIM_SIN": float(np.sin(cup.half_angle)),
        "LEAST_MM": cup.least_mm,
        "LEAST_SINE": cup.least_sine,
    }
    on_circle, circle_weight, on_arc, arc_weight = nodes(points)
    tables = {
        "cup_pole[3]": cup.pole,
        "cup_centre[3]": cup.centre,
        "cup_beside[3]": any_across(cup),
        "whole_node[POINTS]": on_circle,
        "whole_weight[POINTS]": circle_weight,
        "arc_node[POINTS]": on_arc,
        "arc_weight[POINTS]": arc_weight,
    }
    return "\n".join([*definitions(numbers, tables), c_text("cup.h", C_FOLDER)])


class CupFoundation(CompiledFoundation):
    """Elastic foundation of a ball in a cup with its rim, integrated over one angle: nothing of it is a grid.

    points: on whole circles about the deepest point and on those that the rim cuts, a multiple of 4 (else ValueError).
    """

    moments_header = "cup_pressures.h"

    def __init__(self, scene: Scene, points: int = 12, *, compiled: bool = True) -> None:
        super().__init__(scene, compiled=compiled)
        if points < 4 or points % 4:
            raise ValueError(f"points = {points}, expected a multiple of 4")
        self.points, self.resolution = points, f"{points} points"
        self.cup = cup_of(scene)
        self.law = law_of(scene.material)

    @property
    def _code(self) -> tuple[str, bytes]:
        return cup_source(self.cup, self.points), b""

    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        value, by_centre = cup_moments(self.cup, self.law, self.points, t)
        return value[:, None], np.concatenate([by_centre, np.zeros_like(by_centre)], -1)[:, None]

    def _patch_loads(self, R: Array, t: Array) -> list[PatchLoads]:
        return [cup_loads(self.cup, self.law, self.points, t)]


def cup_foundation(
    scene: Scene, *, compiled: bool = True, candidates: Sequence[int] = (12, 16, 24, 32, 48), converged_points: int = 96
) -> CupFoundation:
    """The fewest points that agree with converged ones within the scene's tolerances (`convergence.cheapest`), over
    poses that press the cup from its deepest point to its rim, which cuts contact then.

    With fewer than 12 points derivatives differ from differences of loads where the rim cuts contact.
    """
    converged = CupFoundation(scene, converged_points, compiled=False)
    poses = _pressed_poses(converged, forces_tried(scene))
    truth = converged(poses)
    models = (CupFoundation(scene, points, compiled=compiled) for points in candidates)

    def errors(model: CupFoundation) -> Array:
        plain = CupFoundation(scene, model.points, compiled=False)
        return np.asarray(plain(poses) - truth)

    model = cheapest(scene, models, errors, model="quadrature of a cup", against=f"{converged_points} points")
    model.record["points"] = model.points
    return model


def _pressed_poses(model: CupFoundation, range_n: tuple[float, float], count: int = 256) -> Array:
    """Poses (m, 6) at all angles of the cup, whose forces spread evenly on a logarithmic scale [N]."""
    cup, random = model.cup, np.random.default_rng(0)
    tilt, around = cup.half_angle * random.random(count), random.uniform(0.0, 2.0 * np.pi, count)
    first = any_across(cup)
    beside = np.cos(around)[:, None] * first + np.sin(around)[:, None] * np.cross(cup.pole, first)
    along = np.cos(tilt)[:, None] * cup.pole + np.sin(tilt)[:, None] * beside

    touching = np.pad(cup.centre + (cup.radius - cup.ball_radius) * along, ((0, 0), (0, 3)))

    def force_of(poses: Array) -> Array:
        return np.linalg.norm(model.wrenches(poses)[:, 0, :3], axis=1)

    return press_until(force_of, touching, along, np.geomspace(*range_n, count), 0.01, most_change=30.0)[0]
