"""The motion that found actuator loads bring about when they alone drive the joint: a forward simulation.

What the cycle holds of the pose is prescribed, as flexion in a simulator; the rest follows from the same equations as
in `problem`, integrated by CVODES with the exact Jacobian, actuator loads between collocation points by cubic splines.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from casadi_contact.conventions import POSE_IN_MM, POSE_NAMES, Array
from casadi_contact.interrupts import raise_if_interrupted
from problems.optimal_control.carried import furthest_off
from problems.optimal_control.problem import LOAD_SCALE_N, OptimalControl, inertia_of, point_function
from problems.optimal_control.solve import ControlResult

_TOLERANCE = 1e-7  # of a step, relative and absolute


def forward_poses(problem: OptimalControl, result: ControlResult) -> Array | None:
    """Poses (points, 6) at the collocation times, from the state at the first of them. None where the integrator gives
    up, which is an answer as well: nothing holds that motion."""
    rig, held = problem.wanted.rig, tuple(problem.wanted.held)
    free = [i for i, name in enumerate(POSE_NAMES) if name not in held]
    point = point_function(problem.model, rig, held)
    x, t = ca.MX.sym("x", 2 * len(free)), ca.MX.sym("t")
    given = _spline("prescribed", problem.times, result.poses)(t)
    pose, rate = given, ca.jacobian(given, t)
    pose[free], rate[free] = x[: len(free)], x[len(free) :]
    loads = _spline("actuators", problem.times, result.actuators / (LOAD_SCALE_N * POSE_IN_MM))(t)
    wanted = [np.zeros(point.size1_in(i)) for i in (3, 4)]  # of the tracking residuals, which are not asked for
    forces = point(pose / problem.steps, rate / problem.rates, loads, *wanted)[0] * POSE_IN_MM
    dae = {"x": x, "t": t, "ode": ca.vertcat(rate[free], forces[free] / inertia_of(rig)[free])}
    options = {"abstol": _TOLERANCE, "reltol": _TOLERANCE, "max_num_steps": 100_000}
    integrate = ca.integrator("forward", "cvodes", dae, problem.times[0], problem.times[1:].tolist(), options)
    start = np.concatenate([result.poses[0, free], result.rates[0, free]])
    try:
        answer = np.asarray(integrate(x0=start)["xf"]).T
    except RuntimeError:
        raise_if_interrupted()
        return None
    poses = result.poses.copy()
    poses[1:, free] = answer[:, : len(free)]
    return poses


def forward_load_errors(problem: OptimalControl, result: ControlResult, forward: Array) -> dict[str, float]:
    """Root mean square difference of each contact load [N, N·mm] by name, in poses (points, 6) of `forward_poses`, from
    those found."""
    off = problem.model(forward) - result.loads
    return dict(zip(problem.model.load_names, np.sqrt(np.mean(off**2, axis=0)).tolist(), strict=True))


def strays(problem: OptimalControl, result: ControlResult, forward: Array | None) -> str:
    """Why the found actuators do not bring about the found contact loads forward in time, "" where they do, as
    `furthest_off` tells.

    Collocation meets the equations of motion at its points alone; how well they hold between them, this tells.
    """
    cure = "give more --intervals or a higher --degree, or springs where nothing holds the motion"
    if forward is None:
        return f"forward in time under these actuators the integrator gives up, expected the motion found: {cure}"
    off = furthest_off(problem.model.load_names, problem.model(forward) - result.loads, result.loads)
    return off and f"forward in time under these actuators {off}: {cure}"


def _spline(name: str, times: Array, values: Array) -> ca.Function:
    """Cubic spline t -> (6) through values (points, 6)."""
    return ca.interpolant(name, "bspline", [times.tolist()], values.ravel().tolist())
