"""Ligaments and muscles along paths: straight from point to point, with what wrapping over a surface adds.

    length = Σ |p_{i+1} - p_i| + excess(points in the frame of the body that carries the surface)

The points move with their bodies, exactly. The excess over a cylinder has a closed form. Over other surfaces it is a
small network, fitted to lengths of the opensim wheel (`workflow.opensim_import`), with three inputs where one point
moves against the surface, and exact derivatives.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array, check_above_zero
from casadi_contact.networks.graph import network_value
from casadi_contact.networks.network import Network
from casadi_contact.optimisation.assembly.joints import Chain, frame, inverse, point_at

DAMPED_STRAIN = 0.01


@dataclass(frozen=True)
class Wrap:
    """What wrapping over a surface of a body adds to a path's length [mm]: a network of some of its points, by number,
    in the body's frame [mm]."""

    body: str
    points: Sequence[int]
    network: Network

    def excess(self, x: Any) -> Any:
        """Of the points' coordinates (3·points) in the body's frame [mm]."""
        return network_value(self.network, x)


@dataclass(frozen=True)
class Roll:
    """What wrapping over a cylinder adds to the length between two points, one after the other.

    In the cylinder's frame (6,) [mm, rad] of its body, whose z is its axis, they lie at distances a and b from the
    axis, an angle φ apart. With l_a = √(a² - r²) and α = acos(r/a), likewise b, the path touches along the arc

        θ = φ - α - β,   length √((l_a + l_b + r·θ)² + Δz²),   straight where θ <= 0 or φ > 3π/2.

    side: 1 where φ runs anticlockwise about z from the first point to the second, -1 clockwise, 0 the shorter way.
    """

    body: str
    points: Sequence[int]
    frame: Array
    radius_mm: float
    side: float

    def excess(self, x: Any) -> Any:
        """Of the points' coordinates (6) in the body's frame [mm]."""
        place, r = inverse(frame(self.frame)), self.radius_mm
        first, second = (place[0] + ca.mtimes(place[1], x[i : i + 3]) for i in (0, 3))
        tangents = [ca.sqrt(ca.fmax(ca.sumsqr(p[:2]) - r**2, 1e-12)) for p in (first, second)]
        turn, along = first[0] * second[1] - first[1] * second[0], ca.dot(first[:2], second[:2])
        way = self.side if self.side else ca.if_else(turn < 0.0, -1.0, 1.0)
        apart = np.pi + ca.atan2(-way * turn, -along)
        arc = apart - sum(ca.atan2(tangent, r) for tangent in tangents)
        touching = ca.logic_and(arc > 0.0, apart < 1.5 * np.pi)
        wrapped = ca.sqrt((sum(tangents) + r * arc) ** 2 + (second[2] - first[2]) ** 2)
        return ca.if_else(touching, wrapped - ca.sqrt(ca.sumsqr(second - first) + 1e-18), 0.0)


@dataclass(frozen=True)
class Path:
    """Points (n, 3) [mm], each of a body."""

    name: str
    bodies: Sequence[str]
    points_mm: Array
    wrap: Wrap | Roll | None = None

    def __post_init__(self) -> None:
        if len(self.bodies) < 2 or np.shape(self.points_mm) != (len(self.bodies), 3):
            got = f"points of shape {np.shape(self.points_mm)} on {len(self.bodies)} bodies"
            raise ValueError(f"{self.name} has {got}, expected two points or more, and a body for each")

    def straight(self, chain: Chain) -> Any:
        """Length [mm] from point to point."""
        length: Any = 0.0
        for i, (first, second) in enumerate(zip(self.bodies[:-1], self.bodies[1:], strict=True)):
            away = point_at(chain.place(second, first), self.points_mm[i + 1]) - ca.DM(self.points_mm[i])
            length += ca.sqrt(ca.sumsqr(away) + (1e-18 if first != second else 0.0))  # 1e-9 mm where they coincide
        return length

    def inputs(self, chain: Chain, body: str, points: Sequence[int]) -> Any:
        """Some of its points in a body's frame (3·points) [mm]."""
        return ca.vertcat(*(point_at(chain.place(self.bodies[i], body), self.points_mm[i]) for i in points))

    def length(self, chain: Chain) -> Any:
        """Length [mm], as an SX expression."""
        if self.wrap is None:
            return self.straight(chain)
        return self.straight(chain) + self.wrap.excess(self.inputs(chain, self.wrap.body, self.wrap.points))


@dataclass(frozen=True)
class Bundle(Path):
    """A ligament's bundle: with the strain ε = length/slack_length - 1, its tension is (Blankevoort and Huiskes,
    J Biomech Eng 113 (1991) 263-269)

    0 below ε = 0,   k·ε²/(4·ε_l) up to 2·ε_l,   k·(ε - ε_l) beyond,    ε_l = toe_strain, k = stiffness_n [N]

    plus damping_n_s·(strain rate) while it lengthens, brought in by a smooth step from strain 0 to `DAMPED_STRAIN`, as
    OpenSim's Blankevoort1991Ligament."""

    stiffness_n: float = 0.0
    slack_length_mm: float = 1.0
    toe_strain: float = 0.03
    damping_n_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_above_zero(**{f"{self.name}: {key}": getattr(self, key) for key in ("stiffness_n", "slack_length_mm")})


def tensions(bundles: Sequence[Bundle], lengths_mm: Any, rates_mm_per_s: Any) -> Any:
    """Tensions (n) [N] of bundles, zero while slack; where a bundle turns, its rate is rounded within 1e-3/s."""
    if not bundles:
        return ca.SX(0, 1)
    k, slack, toe, damping = (
        ca.DM([getattr(bundle, name) for bundle in bundles])
        for name in ("stiffness_n", "slack_length_mm", "toe_strain", "damping_n_s")
    )
    strain, rate = lengths_mm / slack - 1.0, rates_mm_per_s / slack
    taut = ca.fmax(strain, 0.0)
    spring = ca.if_else(taut < 2.0 * toe, 0.25 * taut**2 / toe, taut - toe)
    s = ca.fmin(taut / DAMPED_STRAIN, 1.0)
    lengthening = 0.5 * (rate + ca.sqrt(rate**2 + 1e-6))
    return k * spring + damping * lengthening * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


@dataclass(frozen=True)
class MuscleCurves:
    """Curves of normalised fibre length (n,) and speed (m,), sampled at equal steps: active force-length, passive
    force-length, force-velocity. Between samples they are cubic B-splines."""

    lengths: Array
    active: Array
    passive: Array
    speeds: Array
    of_speed: Array


@dataclass(frozen=True)
class Muscle(Path):
    """A Millard2012EquilibriumMuscle with a rigid tendon: with L the musculotendon's length, w = l0·sin α0 the fibres'
    thickness, l = √((L - L_t)² + w²)/l0, cos α = (L - L_t)/(l·l0) and v = L̇·cos α/(v_max·l0),

    F = F0·(a·f_l(l)·f_v(v) + f_p(l) + damping·v)·cos α  [N],   0 where the tendon is slack, and never below.
    """

    max_force_n: float = 0.0
    optimal_fibre_mm: float = 1.0
    tendon_slack_mm: float = 0.0
    pennation_rad: float = 0.0
    max_speed_per_s: float = 10.0
    damping: float = 0.0
    curves: str = ""


def muscle_forces(
    muscles: Sequence[Muscle], curves: dict[str, MuscleCurves]
) -> Callable[[Any, Any, Any], tuple[Any, Any]]:
    """Function of lengths [mm], rates [mm/s] and activations, each (m) in MX -> active and passive force (m) [N]."""
    force, optimum, tendon, fastest, damping = (
        ca.DM([getattr(muscle, name) for muscle in muscles])
        for name in ("max_force_n", "optimal_fibre_mm", "tendon_slack_mm", "max_speed_per_s", "damping")
    )
    width = optimum * ca.sin(ca.DM([muscle.pennation_rad for muscle in muscles]))
    rows = {name: [i for i, muscle in enumerate(muscles) if muscle.curves == name] for name in curves}

    def evaluated(part: str, over: str, x: Any) -> Any:
        """A curve of every muscle, by groups that share it."""
        order, parts = [i for own in rows.values() for i in own], []
        for name, own in rows.items():
            places, values = (getattr(curves[name], key).tolist() for key in (over, part))
            parts += [ca.interpolant(part, "bspline", [places], values)(x[own].T).T] if own else []
        return ca.vertcat(*parts)[np.argsort(order).tolist()]

    def forces(length: Any, rate: Any, activation: Any) -> tuple[Any, Any]:
        along = ca.fmax(length - tendon, 0.0)
        fibre = ca.sqrt(along**2 + width**2 + 1e-12)
        cosine, stretch = along / fibre, fibre / optimum
        v = rate * cosine / (fastest * optimum)
        active = activation * evaluated("active", "lengths", stretch) * ca.fmax(evaluated("of_speed", "speeds", v), 0.0)
        return force * cosine * active, force * cosine * (evaluated("passive", "lengths", stretch) + damping * v)

    return forces
