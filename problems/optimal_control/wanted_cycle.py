"""Contact loads wanted over a cycle, and the pose parameters that contact does not hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import Array, pose_index
from casadi_contact.project import reference_motion_cycles
from problems import knee_simulator, pose_estimation
from problems.knee_simulator.problem import DOWN, pressed_along
from problems.knee_simulator.rig import Rig

SPRINGLESS = Rig(ap_spring_n_per_mm=0.0, ie_spring_nmm_per_deg=0.0)


@dataclass(frozen=True)
class WantedCycle:
    """time_s (n,) from 0 over one cycle; loads (n, L) as in ``load_names`` of the contact model; held: pose parameters
    (n,) [mm, rad] by name that are wanted too; rig: what moves and holds the joint."""

    time_s: Array
    loads: Array
    held: Mapping[str, Array]
    rig: Rig

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Loads (m, L) and held parameters (m, h) at other times, by `curve_through`."""
        curves = [curve_through(self.time_s, curve)(time_s) for curve in (*self.loads.T, *self.held.values())]
        count = self.loads.shape[1]
        return np.column_stack(curves[:count]), np.column_stack([np.zeros((len(time_s), 0)), *curves[count:]])


def curve_through(time_s: Array, values: Array) -> Callable[[Array], Array]:
    """The cubic spline through values (n,), or, where it would leave the one sign that they have, as about a liftoff,
    the monotone pieces of Fritsch and Carlson (SIAM J Numer Anal 17 (1980) 238-246): contact never pulls."""
    spline, sign = CubicSpline(time_s, values), 1.0 if values.sum() > 0.0 else -1.0
    turns = spline.derivative().roots(extrapolate=False)
    beyond = sign * spline(turns[np.isfinite(turns)]) < 0.0
    if (sign * values).min() < 0.0 or not beyond.any():
        return spline
    shaped = PchipInterpolator(time_s, values)
    return lambda at: sign * np.maximum(sign * shaped(at), 0.0)  # which rounding leaves by 1e-13


def cycle_of(model: SymbolicContact) -> WantedCycle:
    """The simulator's cycle for a scene that is pressed down as a knee is, the scene's own for any other."""
    return simulated_cycle(model) if pressed_along(model.scene) == DOWN else own_cycle(model)


def simulated_cycle(model: SymbolicContact, frames: int = 401) -> WantedCycle:
    """The loads that the knee simulator's second cycle, by then periodic, carries, and its flexion."""
    simulator = knee_simulator.build(model)
    motion = knee_simulator.solve(simulator, cycles=2.0, frames=2 * frames - 1, tolerance=1e-8)
    second = slice(frames - 1, None)
    return WantedCycle(
        time_s=motion.time_s[second] - motion.time_s[frames - 1],
        loads=model(motion.poses[second]),
        held={"rz": motion.poses[second, pose_index("rz")]},
        rig=simulator.rig,
    )


def own_cycle(model: SymbolicContact) -> WantedCycle:
    """All loads that contact carries in the poses of the scene's own cycle (`pose_estimation`), which holds what is
    measured of the pose there; without springs.

    Raises ValueError for a scene without a cycle, and where a frame of it has no pose.
    """
    cycle = reference_motion_cycles(model.scene, ())[0]
    found = pose_estimation.solve(pose_estimation.build(model, cycle))
    if not found.converged.all():
        frame = int(np.argmin(found.converged))
        raise ValueError(f"scene {model.scene.name}: frame {frame} of its cycle has no pose: {found.reason[frame]}")
    return WantedCycle(cycle.time_s - cycle.time_s[0], model(found.poses), cycle.measured_pose(), SPRINGLESS)
