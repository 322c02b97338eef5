"""Bodies joined by coordinates, as OpenSim has them: where each lies in any other, as CasADi SX expressions.

A joint places its child's frame in its parent's frame by turns about axes, one after the other, and a shift:

    R = R(a1, θ1)·R(a2, θ2)·...,   t = Σ s_i·b_i

where every θ [rad] and s [mm] is a function of one coordinate [mm, rad]: a line, or cubic between knots (x, y, dy/dx)
and straight beyond them, as OpenSim's SimmSpline. Bodies are related through their nearest common ancestor, so that an
expression holds the coordinates between them alone, and its Jacobian is as sparse as it can be.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import LEVER_MM, POSE_NAMES, Array
from casadi_contact.networks.frames import rotation

Place = tuple[Any, Any]  # origin (3) [mm] and rotation (3 x 3) of a frame in another


@dataclass(frozen=True)
class Coordinate:
    """kind: "rotation" [rad] or "translation" [mm]; its value at rest and the range that it may take."""

    kind: str
    default: float
    low: float
    high: float

    @property
    def scale(self) -> float:
        """mm or rad in one of OpenSim's units, m or rad."""
        return 1000.0 if self.kind == "translation" else 1.0

    @property
    def in_mm(self) -> float:
        """mm in one of OpenSim's units, a turn at 25 mm."""
        return 1000.0 if self.kind == "translation" else LEVER_MM


@dataclass(frozen=True)
class Body:
    """Mass [kg], its centre (3,) [mm], and inertia about it [kg·mm²]: xx, yy, zz, xy, xz, yz."""

    mass_kg: float = 0.0
    centre_mm: Sequence[float] = (0.0,) * 3
    inertia_kgmm2: Sequence[float] = (0.0,) * 6

    @property
    def second_moments(self) -> Array:
        """J (4, 4) = Σ m·[x; 1]·[x; 1]ᵀ over the body's points x [m], so that kinetic energy is ½·tr(Ẋ·J·Ẋᵀ) for its
        transform X (3 x 4)."""
        xx, yy, zz, xy, xz, yz = 1e-6 * np.asarray(self.inertia_kgmm2)
        inertia, c = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), 1e-3 * np.asarray(self.centre_mm)
        about = 0.5 * np.trace(inertia) * np.eye(3) - inertia + self.mass_kg * np.outer(c, c)
        return np.block([[about, self.mass_kg * c[:, None]], [self.mass_kg * c[None], np.array([[self.mass_kg]])]])


@dataclass(frozen=True)
class Axis:
    """A direction (3,), and how far to go along or about it: offset + slope·coordinate, or by knots (3·k)."""

    axis: Array
    of: str = ""
    offset: float = 0.0
    slope: float = 0.0
    knots: Sequence[float] = ()

    def value(self, coordinates: Mapping[str, Any]) -> Any:
        """How far [mm or rad], at coordinates by name [mm, rad]."""
        if not self.of:
            return self.offset
        x = coordinates[self.of]
        return piecewise_cubic(x, np.reshape(self.knots, (-1, 3))) if len(self.knots) else self.offset + self.slope * x


def piecewise_cubic(x: Any, knots: Array) -> Any:
    """The function through knots (k, 3) of x, y and dy/dx: cubic between them, straight beyond."""
    value = knots[0, 1] + knots[0, 2] * (x - knots[0, 0])
    for (a, ya, sa), (b, yb, sb) in itertools.pairwise(knots):
        h, t = b - a, (x - a) / (b - a)
        cubic = ya + t * (h * sa + t * (3.0 * (yb - ya) - h * (2.0 * sa + sb) + t * (2.0 * (ya - yb) + h * (sa + sb))))
        value = ca.if_else(x > a, cubic, value)
    return ca.if_else(x > knots[-1, 0], knots[-1, 1] + knots[-1, 2] * (x - knots[-1, 0]), value)


@dataclass(frozen=True)
class Joint:
    """parent_frame and child_frame (6,) [mm, rad] lie in the bodies parent and child; rotations are body-fixed, one
    after another, translations along axes of the parent's frame."""

    name: str
    parent: str
    child: str
    parent_frame: Array
    child_frame: Array
    rotations: Sequence[Axis] = ()
    translations: Sequence[Axis] = ()

    @property
    def coordinates(self) -> list[str]:
        """Names of those that move it, in the order of its axes."""
        return list(dict.fromkeys(axis.of for axis in (*self.rotations, *self.translations) if axis.of))

    def place(self, coordinates: Mapping[str, Any]) -> Place:
        """The child in the parent, at coordinates by name [mm, rad]."""
        R, t = ca.SX.eye(3), ca.SX.zeros(3)
        for turn in self.rotations:
            R = ca.mtimes(R, about_axis(np.asarray(turn.axis), turn.value(coordinates)))
        for shift in self.translations:
            t += ca.DM(shift.axis) * shift.value(coordinates)
        return compose(compose(frame(self.parent_frame), (t, R)), inverse(frame(self.child_frame)))


def free_joint(body: str, ground: str, pose: Sequence[float]) -> tuple[dict[str, Coordinate], Joint]:
    """Six coordinates, BODY_tx to BODY_rz, that are the pose (6,) [mm, rad] of a free body in the ground, and the joint
    that they move."""
    kinds = ["translation"] * 3 + ["rotation"] * 3
    names = [f"{body}_{name}" for name in POSE_NAMES]
    axes = [Axis(np.eye(3)[k % 3], name, slope=1.0) for k, name in enumerate(names)]
    table = {n: Coordinate(kind, at, -np.inf, np.inf) for n, kind, at in zip(names, kinds, pose, strict=True)}
    return table, Joint(f"{body}_free", ground, body, np.zeros(6), np.zeros(6), axes[3:], axes[:3])


def about_axis(axis: Array, angle: Any) -> Any:
    """Rotation (3 x 3) by an angle [rad] about an axis (3,), by Rodrigues' formula."""
    K = ca.sparsify(ca.skew(ca.DM(axis / np.linalg.norm(axis))))
    return ca.SX.eye(3) + ca.sin(angle) * K + (1.0 - ca.cos(angle)) * ca.mtimes(K, K)


def frame(pose: Array) -> Place:
    """Of a pose (6,) [mm, rad]; exact zeros and ones where it does not turn."""
    return ca.DM(pose[:3]), ca.sparsify(ca.DM(rotation(ca.DM(pose[3:]))))


def compose(first: Place, second: Place) -> Place:
    """The second frame, given in the first, as given where the first one is."""
    return first[0] + ca.mtimes(first[1], second[0]), ca.mtimes(first[1], second[1])


def inverse(place: Place) -> Place:
    """The other frame in this one."""
    return -ca.mtimes(place[1].T, place[0]), place[1].T


def point_at(place: Place, point_mm: Any) -> Any:
    """A point of a frame where that lies."""
    return place[0] + ca.mtimes(place[1], ca.DM(point_mm))


class Chain:
    """Where bodies lie at coordinates by name [mm, rad], in each other or in the ground; above: the joint that carries
    each. Raises ValueError for a body that two joints carry or none, and for joints in a circle."""

    def __init__(self, ground: str, bodies: Sequence[str], joints: Sequence[Joint], coordinates: Mapping[str, Any]):
        self.above = {joint.child: joint for joint in joints}
        if len(self.above) != len(joints) or set(self.above) != set(bodies):
            carried = ", ".join(joint.child for joint in joints)
            raise ValueError(f"joints carry {carried}, expected each of {', '.join(bodies)} once")
        self._known: dict[tuple[str, str], Place] = {}
        self._ground, self._places = ground, {joint.child: joint.place(coordinates) for joint in joints}
        for body in bodies:
            self.ancestors(body)

    def ancestors(self, body: str) -> list[str]:
        """The body, its parent, and so on to the ground."""
        found = [body]
        while found[-1] != self._ground:
            joint = self.above.get(found[-1])
            if joint is None or joint.parent in found:
                raise ValueError(f"{found[-1]} is no body joined to {self._ground}: expected {', '.join(self.above)}")
            found.append(joint.parent)
        return found

    def place(self, body: str, within: str) -> Place:
        """A body in another one; expressions are made once, so that all that lies on the body shares them."""
        if (body, within) not in self._known:
            up, down = self.ancestors(within), self.ancestors(body)
            common = next(each for each in down if each in up)
            self._known[body, within] = compose(inverse(self._down(up, common)), self._down(down, common))
        return self._known[body, within]

    def _down(self, line: Sequence[str], common: str) -> Place:
        """The first body of a line of ancestors, in one of them."""
        place = (ca.SX.zeros(3), ca.SX.eye(3))
        for body in line[: line.index(common)]:
            place = compose(self._places[body], place)
        return place
