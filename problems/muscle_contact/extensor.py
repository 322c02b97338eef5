"""The quadriceps through the patella: an assembly's patella as part of the muscle problem.

Where the walk's arms say what the quadriceps do at the knee, its patella is a pulley without size. Here it is a body
with six degrees of freedom, which quadriceps, patellar tendon and contact with the femur hold in equilibrium,

    Q_patella(q, p, F_quadriceps) = 0        [N, N·mm], for every frame

and what these forces, and all other ligaments of the assembly, do to the femur takes the place of Σ arm·F of the
quadriceps in the balance. The muscles end above the knee, so that the thigh counts as one body with the femur. The
variables p are the pose of the patella in its groove, scaled so that all change its contact alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.choice import foundation
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import LEVER_MM, POSE_NAMES, Array
from casadi_contact.networks.frames import placed, relative_pose
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.connections import Contact
from casadi_contact.optimisation.assembly.file import load_assembly
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.optimisation.knee import COORDINATES, check_knee
from casadi_contact.optimisation.starts import pose_steps
from problems.patella.follow import follow

FEMUR, PATELLA = "femur", "patella"
SETTLED_N = 0.01
_QUADRICEPS = ("recf", "rect_f", "vas")  # rectus femoris and vasti, as their names begin in the usual models
_USUAL_TENSION_N = 300.0
_FLEXIONS = 9  # at which arms are sought: they are smooth in flexion
_IN_NEWTONS = np.repeat([1.0, 1.0 / LEVER_MM], 3)
_UNITS = np.array([1.0 if name.startswith("t") else 1e-3 for name in POSE_NAMES])  # to N and N·m


@dataclass(frozen=True)
class Extensor:
    """Patella, tendon and all else that acts on the femur but the tibiofemoral contact.

    assembly: the bodies femur and patella in the tibia, with the contact between these two alone.
    """

    assembly: Assembly

    @property
    def contact(self) -> Contact:
        """Patella in the groove of the femur."""
        return self.assembly.contacts[0]

    @property
    def steps(self) -> Array:
        """Size (6,) [mm, rad] of the patella's variables."""
        return pose_steps(self.contact.model.scene.sensitive_pose)

    def balance(self, femur: ca.MX, p: ca.MX, tension: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Loads on the femur (6, n) [N, N·m] in the order of `COORDINATES`, what is left on the patella (6, n) [N], its
        torques over 25 mm, and its pose in the tibia (6, n), for the femur's pose (6, n), variables (6, n) and tension
        (1, n)."""
        q, v, pull = ca.MX.sym("q", 6), ca.MX.sym("v", 6), ca.MX.sym("pull")
        groove = placed(q, ca.DM(self.contact.fixed_frame))
        R = ca.mtimes(groove[1], placed(ca.DM.zeros(6), ca.DM(self.steps) * v)[1])
        patella = relative_pose(
            (ca.DM.zeros(3), ca.DM.eye(3)), (groove[0] + ca.mtimes(groove[1], ca.DM(self.steps[:3]) * v[:3]), R)
        )
        forces = self.assembly.forces()(ca.horzcat(q, patella), pull)
        out = [ca.DM(_UNITS) * forces[:, 0], ca.DM(_IN_NEWTONS) * forces[:, 1], patella]
        found = ca.Function("extensor", [q, v, pull], out).map(femur.shape[1])(femur, p, tension)
        return found[0], found[1], found[2]

    def on_femur(self, femur: Array, patella: Array, tension_n: Array) -> tuple[dict[str, Array], Array]:
        """Loads on the femur (n,) by coordinate [N, N·m], and the largest force left on the patella (n,) [N], for poses
        in the tibia (n, 6) and tensions (n,)."""
        function = self.assembly.forces()
        forces = [
            np.asarray(function(np.column_stack(row[:2]), row[2]))
            for row in zip(femur, patella, tension_n, strict=True)
        ]
        on_femur, on_patella = np.moveaxis(np.array(forces), 2, 0)
        named = dict(zip(COORDINATES, (_UNITS * on_femur).T, strict=True))
        return named, np.abs(_IN_NEWTONS * on_patella).max(axis=1)

    def loads(self, femur: Array, patella: Array) -> dict[str, Array]:
        """Loads (n,) by the assembly's names: patellofemoral contact, and the tension of each ligament."""
        function = self.assembly.function()
        found = np.array(
            [np.asarray(function(np.column_stack(row))).ravel() for row in zip(femur, patella, strict=True)]
        )
        return dict(zip(self.assembly.load_names, found.T, strict=True))

    def contact_poses(self, femur: Array, patella: Array) -> Array:
        """Poses (n, 6) of the patella in its groove, for poses (n, 6) of both in the tibia."""
        return self.assembly.contact_poses(self.contact.name, np.stack([femur, patella], axis=1))

    def settled(self, femur: Array, tension_n: Array) -> Array:
        """Poses of the patella in the tibia (n, 6) under tensions (n,) on the femur (n, 6), frame after frame in the
        order of flexion. Raises ValueError where it finds no equilibrium."""
        order = np.argsort(femur[:, 5])
        ride = follow(self.assembly, femur[order], tension_n[order], tolerance_n=SETTLED_N)
        if not ride.converged.all():
            flexion = -np.degrees(femur[order[~ride.converged][0], 5])
            raise ValueError(
                f"assembly {self.assembly.name}: the patella finds no equilibrium at {flexion:.0f} degrees of flexion, "
                f"expected a groove that reaches so far"
            )
        return np.asarray(ride.poses[np.argsort(order), 1])

    def arms(self, femur: Array) -> dict[str, Array]:
        """What a newton of the quadriceps does to the femur by coordinate (n,) [N, N·m], on poses (n, 6): settled under
        a usual tension at some flexions, and interpolated."""
        order = np.argsort(femur[:, 5])
        some = femur[order[np.unique(np.linspace(0, len(order) - 1, _FLEXIONS).round().astype(int))]]
        tension_n = np.full(len(some), _USUAL_TENSION_N)
        loads, _ = self.on_femur(some, self.settled(some, tension_n), tension_n)
        return {name: np.interp(femur[:, 5], some[:, 5], load / tension_n) for name, load in loads.items()}

    def moved_forward(self, by_mm: float) -> Extensor:
        """The same with groove, tuberosity and origin of the quadriceps so much farther in front of the knee: all that
        stands on femur and tibia moves along their -x, lines between these two (collaterals) stay."""
        parts, back = self.assembly, np.array([by_mm, 0.0, 0.0])

        def moved(line: Any) -> Any:
            if PATELLA not in line.bodies:
                return line
            ends = zip(line.bodies, line.points_mm, strict=True)
            return replace(line, points_mm=tuple(point if body == PATELLA else point - back for body, point in ends))

        groove = replace(self.contact, fixed_frame=self.contact.fixed_frame - np.append(back, np.zeros(3)))
        begin = {**parts.start, PATELLA: parts.start[PATELLA] - np.append(back, np.zeros(3))}
        ligaments, pulls = [*map(moved, parts.ligaments)], [*map(moved, parts.pulls)]
        return Extensor(replace(parts, start=begin, contacts=[groove], ligaments=ligaments, pulls=pulls))


@dataclass(frozen=True)
class PatellaResult:
    """Poses of the patella in the tibia and in its groove, each (n, 6); loads (n,) [N, N·mm] by the assembly's names:
    patellofemoral contact and the tension of each ligament; the largest force that is left on it (n,) [N]."""

    poses: Array
    contact_poses: Array
    loads: Mapping[str, Array]
    left_n: Array


def quadriceps(names: Sequence[str]) -> list[int]:
    """Columns of rectus femoris and the vasti; raises ValueError where there are none."""
    columns = [column for column, name in enumerate(names) if name.lower().startswith(_QUADRICEPS)]
    if not columns:
        raise ValueError(f"muscles are {', '.join(names)}: no rectus femoris or vastus pulls the patella")
    return columns


def load_extensor(name_or_path: str, contact_model: SymbolicContact) -> Extensor:
    """The extensor mechanism of an assembly (`load_assembly`): bodies femur and patella in the tibia, one contact
    between femur and ground, one between femur and patella, and one pull, the quadriceps.

    contact_model stands for the contact between femur and ground, whose scene it must have. Raises ValueError for an
    assembly that is built otherwise, and for a model of no knee with two sides.
    """
    check_knee("a patella's muscle problem", contact_model.scene, contact_model.load_names)
    scene, whole = contact_model.scene.name, whole_wrench(contact_model.scene).digest
    assembly = load_assembly(name_or_path, lambda given: contact_model if given.digest == whole else foundation(given))
    if assembly.bodies != (FEMUR, PATELLA) or len(assembly.pulls) != 1:
        raise ValueError(
            f"assembly {assembly.name} has the bodies {', '.join(assembly.bodies)} and {len(assembly.pulls)} pulls, "
            f"expected {FEMUR}, {PATELLA}, and the quadriceps"
        )
    parts = {contact.bodies: contact for contact in assembly.contacts}
    knee, groove = parts.get((assembly.ground, FEMUR)), parts.get((FEMUR, PATELLA))
    if knee is None or groove is None or len(parts) != 2 or knee.model is not contact_model:
        raise ValueError(
            f"assembly {assembly.name} has the contacts {', '.join(c.name for c in assembly.contacts)}, expected scene "
            f"{scene} of the same bodies, material and loads, with femur on {assembly.ground}, and patella on femur"
        )
    if np.any(knee.fixed_frame) or np.any(knee.moving_frame):
        raise ValueError(f"assembly {assembly.name}: {knee.name} has frames of its own, expected those of its scene")
    if np.any(groove.moving_frame):
        raise ValueError(f"assembly {assembly.name}: {groove.name} has a moving_frame, expected the patella's own")
    return Extensor(replace(assembly, contacts=[groove]))
