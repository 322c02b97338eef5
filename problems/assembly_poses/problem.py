"""Pose estimation of an assembly: the poses of all its bodies over a cycle, in one IPOPT problem with exact Hessian.

    min ½ Σ |r_k(q_k)|²    with Q_free(q_k; tensions_k) + applied_k = 0 in every frame k

r are the misfits [N] of the measured contact (`PoseEstimation`), which tell the pose of its moving body; Q
are the generalised forces on every other body along its free pose parameters: it stands where contacts, ligaments,
pulls and springs balance (`Assembly.forces`), torques over 25 mm. Measured pose parameters are locked. Without a
measured contact all bodies balance, and the problem is a system of equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, Array, pose_index
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.pose_estimation import PoseEstimation
from casadi_contact.scenes.joint_cycle import JointCycle
from problems.assembly_poses.cycle import FORCES, AssemblyCycle

_STEP_MM = 0.05  # of a balanced body's variables, rotations over 25 mm


@dataclass(frozen=True)
class AssemblyPoses:
    """A problem that can be looked at unsolved: CasADi's nlp and the bounds of its variables; the problem of the
    measured contact, None without one; free pose parameters of the balanced bodies by name.

    poses: Function variables -> poses (6·bodies, n); tensions (pulls, n) and applied (6·bodies, n) of every frame.
    """

    assembly: Assembly
    cycle: AssemblyCycle
    measured: PoseEstimation | None
    free: Mapping[str, tuple[str, ...]]
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    poses: ca.Function
    tensions: Array
    applied: Array

    @property
    def measured_body(self) -> str:
        """The body whose pose the measured contact tells; "" without one."""
        return self.assembly.contact(self.cycle.contact).moving if self.measured else ""

    def variables(self, poses: Array) -> Array:
        """Values of the variables at poses (n, bodies, 6)."""
        parts = []
        if self.measured:
            parts.append(self.measured.contact.variables(poses[:, self.assembly.bodies.index(self.measured_body)]))
        balanced = [poses[:, self.assembly.bodies.index(body)][:, _columns(names)] for body, names in self.free.items()]
        if balanced:
            parts.append((np.hstack(balanced) / _steps(self.free)).ravel())
        return np.concatenate(parts)

    def start_poses(self) -> Array:
        """Poses (n, bodies, 6): the assembly's start, with what is measured."""
        poses = np.tile(self.assembly.start_poses(), (len(self.cycle), 1, 1))
        for body, curves in self.cycle.pose.items():
            for name, curve in curves.items():
                poses[:, self.assembly.bodies.index(body), pose_index(name)] = curve
        if self.measured:
            poses[:, self.assembly.bodies.index(self.measured_body)] = self.measured.contact.start_poses()
        return poses


def build(assembly: Assembly, cycle: AssemblyCycle) -> AssemblyPoses:
    """Pose the problem for all frames of a cycle.

    Raises ValueError for a pull without tension or that pushes, names that the assembly has not, forces on the body
    whose pose is measured by loads, a measured contact that is not one between the ground and a body in their own
    frames, a cycle that measures all pose parameters of all bodies, and as `PoseEstimation`.
    """
    _check(assembly, cycle)
    count, bodies = len(cycle), assembly.bodies
    measured = _measured(assembly, cycle) if cycle.contact else None
    told = assembly.contact(cycle.contact).moving if measured else ""
    free = {
        body: tuple(name for name in POSE_NAMES if name not in cycle.pose.get(body, {}))
        for body in bodies
        if body != told
    }
    free = {body: names for body, names in free.items() if names}
    if not free and not measured:
        raise ValueError(
            f"cycle {cycle.name}: all pose parameters are measured, nothing is left to find: leave out a column"
        )
    z = ca.MX.sym("z", sum(map(len, free.values())), count)
    moves = ca.mtimes(ca.diag(ca.DM(_steps(free))), z)
    named = {body: measured.contact.pose for body in (told,) if measured}
    offset = 0
    for body in bodies:
        if body == told:
            continue
        rows = []
        for name in POSE_NAMES:
            if name in free.get(body, ()):
                rows.append(moves[offset, :])
                offset += 1
            else:
                rows.append(ca.MX(ca.DM(cycle.pose[body][name][None])))
        named[body] = ca.vertcat(*rows)
    poses = ca.vertcat(*(named[body] for body in bodies))
    tensions = np.array([cycle.tensions[pull.name] for pull in assembly.pulls]).reshape(-1, count)
    applied = np.zeros((6 * len(bodies), count))
    for body, forces in cycle.applied.items():
        for name, curve in forces.items():
            applied[6 * bodies.index(body) + FORCES.index(name)] = curve
    parts = [ca.vec(measured.contact.q)] if measured else []
    x = ca.vertcat(*parts, ca.vec(z))
    balance = _balance(assembly, free).map(count)(poses, ca.DM(tensions), ca.DM(applied))
    nlp = {"x": x, "f": measured.nlp["f"] if measured else ca.MX(0.0), "g": ca.vec(balance)}
    unbound = np.full(z.numel(), np.inf)
    lower, upper = (measured.contact.lower, measured.contact.upper) if measured else (np.empty(0), np.empty(0))
    lower, upper = np.concatenate([lower, -unbound]), np.concatenate([upper, unbound])
    return AssemblyPoses(
        assembly, cycle, measured, free, nlp, lower, upper, ca.Function("poses", [x], [poses]), tensions, applied
    )


def _balance(assembly: Assembly, free: Mapping[str, tuple[str, ...]]) -> ca.Function:
    """casadi.Function poses (6·bodies), tensions, applied (6·bodies) -> what is left (free) [N] of one frame."""
    count = len(assembly.bodies)
    q, tensions, applied = (
        ca.MX.sym(name, size)
        for name, size in (("q", 6 * count), ("tensions", len(assembly.pulls)), ("applied", 6 * count))
    )
    # Inlined, so that contacts between other bodies are not evaluated.
    (forces,) = assembly.forces().call([ca.reshape(q, 6, count), tensions], True, False)
    rows = [6 * assembly.bodies.index(body) + i for body, names in free.items() for i in _columns(names)]
    scales = np.concatenate([POSE_IN_MM[_columns(names)] for names in free.values()]) if free else np.empty(0)
    return ca.Function("balance", [q, tensions, applied], [(ca.vec(forces) + applied)[rows] / ca.DM(scales)])


def _measured(assembly: Assembly, cycle: AssemblyCycle) -> PoseEstimation:
    """Pose estimation of the measured contact alone."""
    contact = assembly.contact(cycle.contact)
    if contact.fixed != assembly.ground or np.any(contact.fixed_frame) or np.any(contact.moving_frame):
        raise ValueError(
            f"loads of the contact {contact.name} are given, expected those of one between the ground "
            f"{assembly.ground} and a body, in their own frames"
        )
    centres = {name: curve for name, curve in cycle.loads.items() if name.startswith("cop_")}
    loads = {name: curve for name, curve in cycle.loads.items() if name not in centres}
    pose = cycle.pose.get(contact.moving, {})
    measured = JointCycle(cycle.name, cycle.time_s, pose, loads, centres)
    return PoseEstimation.of_cycle(contact.model, measured)


def _check(assembly: Assembly, cycle: AssemblyCycle) -> None:
    pulls = {pull.name for pull in assembly.pulls}
    if set(cycle.tensions) != pulls:
        raise ValueError(
            f"cycle {cycle.name} has the tensions {', '.join(cycle.tensions) or 'of nothing'}, assembly "
            f"{assembly.name} has the pulls {', '.join(sorted(pulls)) or 'none'}"
        )
    unknown = (set(cycle.pose) | set(cycle.applied)) - set(assembly.bodies)
    if unknown:
        raise ValueError(
            f"cycle {cycle.name} tells of {', '.join(sorted(unknown))}; assembly {assembly.name} has the free bodies "
            f"{', '.join(assembly.bodies)}"
        )
    told = assembly.contact(cycle.contact).moving if cycle.contact else ""
    if told in cycle.applied:
        raise ValueError(
            f"cycle {cycle.name} applies forces to {told}, whose pose the loads of contact {cycle.contact} tell: they "
            "would move nothing. Leave out these forces, or the contact's loads, so that the body balances"
        )
    for pull, tension in cycle.tensions.items():
        if (tension < 0.0).any():
            frame = int(tension.argmin())
            raise ValueError(
                f"cycle {cycle.name}: the tension of {pull} is {tension[frame]:g} N at frame {frame}, expected 0 or "
                "more: a line pulls and never pushes"
            )


def _columns(names: tuple[str, ...]) -> list[int]:
    return [pose_index(name) for name in names]


def _steps(free: Mapping[str, tuple[str, ...]]) -> Array:
    """What one unit of each variable of the balanced bodies is in their poses [mm, rad]."""
    sizes = [_STEP_MM / POSE_IN_MM[_columns(names)] for names in free.values()]
    return np.concatenate(sizes) if sizes else np.empty(0)
