"""Friction and dissipation of a contact surface whose bodies move: the law at a point, and sums of it over points.

At a point c of the fixed surface with outward normal n the moving body's material passes at

    w = v + ω × (c - t),   v = ṫ,   ω = E(r)·ṙ   for the rates (ṫ, ṙ) of its pose,

so that it approaches at a = -n·w and slides at w_t = w + a·n. The force on the fixed body for each unit of the elastic
force p(d)·A is m = -S(1 + c·a)·(n - f·w_t): pressure grows with the rate of approach [Hunt, Crossley 1975] and falls no
lower than zero, and friction drags the surface along with the body. The rate of approach is that of the materials along
the pressure, as in OpenSim's ElasticFoundationForce: of the depth, where the surfaces are parallel. Both parts take
power from the motion whatever it is.

    f·|w_t| = μ_d·M(x) + (μ_s - μ_d)·16/9·x/(1 + x²/3)² + μ_v·|w_t|,   x = |w_t|/v_t

after Sherman, Seth, Delp (Procedia IUTAM 2, 2011, 241-261), who take min(x, 1) for M and 2·min(x, 1)/(1 + x²) for the
other. M = x(15 - 10x² + 3x⁴)/8 up to x = 1, then 1. As theirs, friction reaches μ_s at x = 1 and falls to μ_d; unlike
theirs it has two continuous derivatives. S(y) is y from 1/2 on, 0 below 0, and (6u³ - 8u⁴ + 3u⁵)/2 with u = 2y between.

All of it depends on the motion by the twist about the fixed origin alone, (v - ω × t, ω), which is the same for all
points. The C (``c/friction.h``) has the same formulas.
"""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.model import WrenchLoads
from casadi_contact.core.conventions import Array, batched, finite_numbers, twist_to_pose_gradient, wrench_about_origin
from casadi_contact.networks.frames import angular_velocity_map
from casadi_contact.scenes.material import FRICTION_NAMES, Friction


def coefficients_of(friction: Friction) -> Array:
    """Its numbers (5,), in the order of `FRICTION_NAMES`."""
    return np.array([getattr(friction, name) for name in FRICTION_NAMES])


def whole_pressure(y: Any, maths: Any = np) -> tuple[Any, Any]:
    """S(y) and its slope, of arrays or (maths: casadi) of expressions."""
    u = maths.fmin(maths.fmax(2.0 * y, 0.0), 1.0)
    whole = 0.5 * u**3 * (6.0 - 8.0 * u + 3.0 * u * u) + maths.fmax(y - 0.5, 0.0)
    return whole, u * u * (18.0 - 32.0 * u + 15.0 * u * u)


def friction_factor(coefficients: Any, square: Any, maths: Any = np) -> tuple[Any, Any, tuple[Any, ...]]:
    """f [s/mm] at squares |w_t|² [mm²/s²], its derivative by these, and by the first four coefficients, likewise."""
    static, dynamic, viscous, transition = (coefficients[k] for k in range(4))
    s = square / transition**2
    slow, by_fast = maths.fmin(s, 1.0), 1.0 / maths.sqrt(maths.fmax(s, 1.0))
    kinetic = (15.0 - 10.0 * slow + 3.0 * slow * slow) / 8.0 * by_fast
    kinetic_slope = (3.0 * slow - 5.0) / 4.0 * by_fast**3
    sticking = 16.0 / 9.0 / (1.0 + s / 3.0) ** 2
    sticking_slope = -2.0 / 3.0 * sticking / (1.0 + s / 3.0)
    dry = dynamic * kinetic + (static - dynamic) * sticking
    dry_slope = dynamic * kinetic_slope + (static - dynamic) * sticking_slope
    by_transition = -(dry + 2.0 * s * dry_slope) / transition**2
    by = sticking / transition, (kinetic - sticking) / transition, 1.0 + 0.0 * s, by_transition
    return dry / transition + viscous, dry_slope / transition**3, by


@cache
def motion_functions(inputs: int, friction: Friction, *, by_pose: bool = False) -> list[ca.Function]:
    """Of x, a pose, its rates and, of 17 inputs, coefficients: the motion (11), twist about the origin, then
    coefficients; slopes (m × inputs) of its first m = inputs - 6 numbers; what second derivatives by x have of those by
    these: gradient, mixed with the twist that displaces the body, or by_pose the pose (m × 6), second (m × m)."""
    x, m = ca.SX.sym("x", inputs), inputs - 6
    E = angular_velocity_map(x[3:6])
    turn = ca.mtimes(E, x[9:12])
    twist = ca.vertcat(x[6:9] - ca.cross(turn, x[:3]), turn)
    motion = ca.vertcat(twist, x[12:] if inputs > 12 else coefficients_of(friction))
    gradient, mixed, second = (ca.SX.sym("by", m, columns) for columns in (1, 6, m))
    turned = ca.SX.eye(6) if by_pose else ca.diagcat(ca.SX.eye(3), E)
    slopes, bend = ca.jacobian(motion[:m], x), ca.hessian(ca.dot(gradient, motion[:m]), x)[0]
    half = slopes.T @ (ca.horzcat(mixed @ turned, ca.SX(m, m)) + 0.5 * second @ slopes)
    made = {"value": ([x], motion), "slopes": ([x], slopes)}
    made["bend"] = ([x, gradient, mixed, second], half + half.T + bend)
    return [ca.Function(f"motion_{key}", given, [ca.densify(ca.cse(found))]) for key, (given, found) in made.items()]


def motions(poses: Array, velocities: Array, coefficients: Array) -> tuple[Array, Array]:
    """Motions (n, 11) of poses, their rates (n, 6) and coefficients (5,); derivatives by all three (n, 11, 17)."""
    x = np.hstack([poses, velocities, np.broadcast_to(coefficients, (len(poses), 5))])
    motion, slopes = (np.asarray(each(x.T)).T for each in motion_functions(17, Friction())[:2])
    return motion, slopes.reshape(-1, 17, 11).swapaxes(1, 2)


class PressedPoints(NamedTuple):
    """Points of one patch in one pose, fixed frame: places c [mm] and unit normals n (m, 3), the wrench (n, c × n)
    (m, 6) of a unit of force, elastic forces p·A (m,) [N], and their derivatives by the twist of the moving body about
    t (m, 6)."""

    places: Array
    normals: Array
    loads: Array
    forces: Array
    slopes: Array

    def wrench(self, motion: Array, *, derivatives: bool = True) -> tuple[Array, ...]:
        """Wrench (6,) on the fixed body in motion (11,), and if asked its derivatives: by the twist that displaces the
        body (6, 6), and by the motion (6, 11)."""
        c, n, twist, coefficients, dissipation = self.places, self.normals, motion[:6], motion[6:], motion[10]
        x, y, z = twist[3:]
        w = twist[:3] + c @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # ω × c
        approach = -np.sum(n * w, 1)
        slide = w + approach[:, None] * n
        f, f_slope, f_by = friction_factor(coefficients, np.sum(slide * slide, 1))
        whole, rise = whole_pressure(1.0 + dissipation * approach)
        if not derivatives:
            pull = self.forces * whole
            m = (c.T * (pull * f)) @ slide  # its parts that differ across the diagonal are the moment
            dragged = [*((pull * f) @ slide), m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]]
            return (np.array(dragged) - pull @ self.loads,)
        drag = wrench_about_origin(slide, c)
        steady = f[:, None] * drag - self.loads
        load = whole[:, None] * steady
        by_slide = f[:, None, None] * (np.eye(3) - n[:, :, None] * n[:, None])
        by_slide += 2.0 * f_slope[:, None, None] * slide[:, :, None] * slide[:, None]
        by_w = whole[:, None, None] * np.concatenate([by_slide, np.cross(c[:, :, None], by_slide, axis=1)], 1)
        by_w -= (dissipation * rise)[:, None, None] * steady[:, :, None] * n[:, None]
        by_whole = (rise * approach)[:, None] * steady
        by_coefficients = np.stack([*(whole[:, None] * by[:, None] * drag for by in f_by), by_whole], -1)
        by_motion = np.concatenate([wrench_about_origin(by_w, c[:, None]), by_coefficients], -1)
        return self.forces @ load, load.T @ self.slopes, np.einsum("m,mka->ka", self.forces, by_motion)


def checked_velocities(poses: Array, velocities: ArrayLike) -> Array:
    """Rates of poses (n, 6), as many or one (6,) for all; raises ValueError for another shape and for what is not
    finite."""
    array = finite_numbers(velocities)
    if array is None or array.shape not in ((6,), poses.shape):
        got = "what is no finite number" if array is None else f"the shape {array.shape}"
        raise ValueError(f"velocities have {got}, expected rates of the poses {poses.shape} [mm/s, rad/s], or (6,)")
    return np.ascontiguousarray(np.broadcast_to(array, poses.shape))


class SlidingContact(WrenchLoads):
    """A contact model of the points of its surface, whose loads may depend on how fast its poses change."""

    def pressed_points(self, poses: Array) -> Iterable[Sequence[PressedPoints]]:
        """Of each pose (n, 6), of each patch, the points that bear load; raises ValueError for a model without."""
        raise ValueError(f"{self!r} takes no velocity, expected elements or cells: cc.ElasticFoundation(scene)")

    def moving_jacobian(
        self, poses: Array, velocities: Array, coefficients: Array | None = None
    ) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) of poses that change at these rates (n, 6), in NumPy, and their derivatives
        (n, patches, 6, 17) by poses, rates, and coefficients: the scene's where these (5,) are left out."""
        theta = coefficients_of(self.scene.friction) if coefficients is None else coefficients
        shape = (len(poses), len(self.patch_names), 6)
        wrenches, slopes = np.zeros(shape), np.zeros((*shape, 17))
        moving = zip(self.pressed_points(poses), *motions(poses, velocities, theta), strict=True)
        for n, (patches, motion, by_inputs) in enumerate(moving):
            for p, points in enumerate(patches):
                wrenches[n, p], placed, moved = points.wrench(motion)
                slopes[n, p] = moved @ by_inputs
                slopes[n, p, :, :6] += twist_to_pose_gradient(placed[None], poses[n, None])[0]
        return wrenches, slopes

    @batched
    def __call__(self, poses: Array, loads: Iterable[str] | None = None, velocities: ArrayLike | None = None) -> Array:
        """Named loads (n, loads) [N, N·mm], all in the order of ``load_names``, or those asked for; velocities: rates
        (n, 6) [mm/s, rad/s] of the poses, with which bodies rub and press as the scene's friction says.

        Raises ValueError for a load that is not the scene's.
        """
        if velocities is None:
            return super().__call__(poses, loads)
        moving = self.moving_wrenches(poses, checked_velocities(poses, velocities))
        return np.einsum("lpk,npk->nl", self._rows(loads), moving)

    def moving_wrenches(self, poses: Array, velocities: Array) -> Array:
        """Wrenches (n, patches, 6) of poses that change at these rates (n, 6)."""
        moving = motions(poses, velocities, coefficients_of(self.scene.friction))[0]
        found = zip(self.pressed_points(poses), moving, strict=True)
        loads = [[points.wrench(motion, derivatives=False)[0] for points in each] for each, motion in found]
        return np.array(loads).reshape(len(poses), len(self.patch_names), 6)
