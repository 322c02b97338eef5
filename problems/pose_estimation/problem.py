"""Pose estimation: the poses of a cycle that carry measured loads and centres of pressure ([EF15 §3.3], any scene).

Measured pose parameters are locked, all others of every frame are free that the scene neither locks nor ties: for a
knee ry and rz are measured, and tx, ty, tz, rx are free. All frames stand in one IPOPT problem with exact Hessian:

    min ½ Σ |r_k(q_k)|² + ½ smoothness·Σ |q_{k+1} - q_k|²    with q_k in the learned range

r are the misfits [N] of what is wanted (`ContactFrames.misfit`), for a knee

    r = ( 2·√(N0·N*_med)·(s_med - s*_med),  2·√(N0·N*_lat)·(s_lat - s*_lat),
          (Tz - cop_ap*·Fy)/L,  (Tx + cop_ml*·Fy)/L )

with starred values wanted, s = √(N/N0) the signed root load, Fy the model's own total, and L = 10 mm. Forces are
compared as root loads because those are nearly linear in the pose and keep their slope out of contact (near the
solution the residual is the force error); the centre of pressure is written without dividing by the load. Variables
are scaled by the moves that change the residuals alike, so that IPOPT's regularisation bears on all of them alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_IN_MM, Array
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.starts import pose_steps
from casadi_contact.samples import reference
from casadi_contact.scenes.scene import Scene
from problems.pose_estimation.wanted import WantedLoads


class Cycle(reference.Cycle, Protocol):
    """A measured cycle: `LoadCycle` of a knee, `JointCycle` of any scene."""

    @property
    def percent(self) -> Array:
        """Percentage of the cycle (n,), 0 to 100."""

    def wanted(self) -> Mapping[str, Array]:
        """Measured loads [N, N·mm] and centres of pressure [mm] by name, each (n,)."""


@dataclass(frozen=True)
class PoseEstimation:
    """A problem that can be looked at unsolved: CasADi's nlp, its variables' bounds and scales (`ContactFrames`), and
    what it came from. residuals: scaled free parameters (f, n) -> residuals (wanted, n) [N]."""

    model: SymbolicContact
    cycle: Cycle
    wanted: WantedLoads
    smoothness: float
    compiled: bool | None
    contact: ContactFrames
    nlp: dict[str, Any]
    residuals: ca.Function

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.cycle.time_s)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free pose parameters."""
        return self.contact.free

    @property
    def learned(self) -> bool:
        """True for a model that has learned a range of poses, as a surrogate has and a foundation has not."""
        return bool(np.isfinite(self.contact.lower).any())

    @property
    def within(self) -> str:
        """Where poses are looked for, in words."""
        return " in the learned range" if self.learned else ""

    @property
    def parameters(self) -> Array:
        """What `one_frame` is told of each frame (n, wanted + locked)."""
        return np.column_stack([*self.wanted.values.values(), *self.measured.values()])

    @property
    def measured(self) -> dict[str, Array]:
        """The measured pose parameters by name, each (n,)."""
        return measured_pose(self.model.scene, self.cycle)

    def one_frame(self) -> dict[str, Any]:
        """The nlp of one frame alone, with a row of `parameters` as its parameters."""
        names, locked = tuple(self.wanted.values), tuple(self.measured)
        given = ca.MX.sym("given", len(names) + len(locked))
        parts = ca.vertsplit(given)
        wanted, measured = dict(zip(names, parts, strict=False)), dict(zip(locked, parts[len(names) :], strict=True))
        contact = ContactFrames(self.model, 1, locked=measured, loads=self.wanted.load_names, compiled=self.compiled)
        return {"x": ca.vec(contact.q), "p": given, "f": 0.5 * ca.sumsqr(contact.misfit(wanted))}

    def start_poses(self) -> Array:
        """Start poses (n, 6): the measured pose parameters, all others in the middle of the learned range, or where a
        foundation is first touched."""
        return self.contact.start_poses()


def measured_pose(scene: Scene, cycle: Cycle) -> dict[str, Array]:
    """The pose parameters that a cycle measures and the scene leaves free, by name, each (n,); ValueError for measured
    ones that contradict what the scene locks or ties."""
    return scene.pose_space.free_curves(cycle.measured_pose(), f"cycle {cycle.name}")


def wanted_loads(scene: Scene, cycle: Cycle) -> WantedLoads:
    """What a cycle wants of a scene's contact.

    Raises ValueError for loads that the scene lacks, for a cycle that measures too little to tell the pose, or so much
    that nothing is free to press, and as `measured_pose` does.
    """
    wanted, measured = WantedLoads.of(scene, cycle.wanted()), measured_pose(scene, cycle)
    free = [name for name in scene.pose_space.free_names if name not in measured]
    if len(wanted.values) < len(free):
        raise ValueError(
            f"cycle {cycle.name}: {len(wanted.values)} loads ({', '.join(wanted.values)}) cannot tell "
            f"{len(free)} pose parameters ({', '.join(free)}): measure more of either"
        )
    held = [name for name in scene.sensitive_pose if name in measured]
    if held and len(wanted.pressing) > len(scene.sensitive_pose) - len(held):
        raise ValueError(
            f"cycle {cycle.name} gives {', '.join(held)}, expected {'it' if len(held) == 1 else 'them'} free: "
            f"{', '.join(scene.sensitive_pose)} carry {', '.join(wanted.pressing)}"
        )
    return wanted


def build(
    model: SymbolicContact, cycle: Cycle, smoothness: float = 0.0, *, compiled: bool | None = None
) -> PoseEstimation:
    """Pose the problem for all frames of a cycle; smoothness [N²/mm²] weighs the change from frame to frame.

    model: a surrogate or a foundation. compiled: as a C kernel, which solves several times faster once it is compiled;
    if left out, a foundation is and a surrogate is not. Raises ValueError for a smoothness that is negative or not
    finite, and as `wanted_loads` does.
    """
    if not 0.0 <= smoothness < np.inf:
        raise ValueError(f"smoothness is {smoothness}, expected a finite number >= 0")
    count, wanted = len(cycle.time_s), wanted_loads(model.scene, cycle)
    measured = measured_pose(model.scene, cycle)
    contact = ContactFrames(model, count, locked=measured, loads=wanted.load_names, compiled=compiled)
    residuals = contact.misfit(wanted.values)
    q, objective = contact.q, 0.5 * ca.sumsqr(residuals)
    if smoothness > 0.0 and count > 1:
        in_mm = (POSE_IN_MM * pose_steps(model.scene.sensitive_pose))[contact.columns]
        steps_mm = (q[:, 1:] - q[:, :-1]) * ca.repmat(ca.DM(in_mm), 1, count - 1)
        objective += 0.5 * smoothness * ca.sumsqr(steps_mm)
    nlp = {"x": ca.vec(q), "f": objective}
    all_residuals = ca.Function("all_residuals", [q], [residuals])
    return PoseEstimation(model, cycle, wanted, smoothness, compiled, contact, nlp, all_residuals)
