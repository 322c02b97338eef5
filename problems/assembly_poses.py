"""Poses of all bodies of an assembly over a cycle: of a knee with its patella in walking, or a knee on its ligaments.

    one body, if its contact's loads were measured:   min ½ |r(q)|²        (`PoseEstimation`)
    every other body:                                 Q(q; tensions) + applied = 0

r are the misfits of measured loads and centres of pressure, Q the generalised forces of contacts, ligaments and pulls
along the body's free pose parameters (`Settling`). Measured pose parameters are locked. Frames settle one after the
other, outwards from the one nearest to the assembly's start, each from its neighbour's pose. Every contact is verified
on the elements of its scene.

A cycle file (CSV) names what was measured by the assembly's parts: time_s; femur_rz_rad, a pose parameter of a body;
femur_Fy_N, a force applied to it at its origin, along the ground's axes; tibiofemoral_Fy_med_N, tibiofemoral_cop_ap_mm,
a load or centre of pressure of one contact; quadriceps_N, the tension of a pull.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, Array, pose_index
from casadi_contact.core.quantities import FORCE, quantity
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.assembly import Assembly, Settling
from casadi_contact.optimisation.muscle_contact import MuscleContact
from casadi_contact.optimisation.pose_estimation import PoseEstimation
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.scenes.columns import TextColumns, check_reach, check_rising, write_columns
from casadi_contact.scenes.cycle import OverTime
from casadi_contact.scenes.walking import reference_cycle
from problems.walks import example_walk

CENTRES = ("cop_ap", "cop_ml", "cop_x", "cop_y", "cop_z")


@dataclass(frozen=True)
class AssemblyCycle(OverTime):
    """Curves (n,) by name: pose parameters [mm, rad] and applied forces Fx, Fy, Fz [N] by body; loads [N, N·mm] and
    centres of pressure [mm] of the measured contact, "" where none was; tensions [N] by pull."""

    time_s: Array
    pose: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    contact: str = ""
    loads: Mapping[str, Array] = field(default_factory=dict)
    tensions: Mapping[str, Array] = field(default_factory=dict)
    applied: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)


def read_assembly_cycle(path: Path, assembly: Assembly) -> AssemblyCycle:
    """Read a cycle file; ValueError for columns that the assembly has no part for."""
    known = {"time_s": ("time", "", "")}
    for body in assembly.bodies:
        known |= {f"{body}_{quantity(name).column}": ("pose", body, name) for name in POSE_NAMES}
        known |= {f"{body}_{name}_N": ("applied", body, name) for name in ("Fx", "Fy", "Fz")}
    for part in assembly.contacts:
        names = (*part.model.load_names, *CENTRES)
        known |= {f"{part.name}_{quantity(name).column}": ("loads", part.name, name) for name in names}
    known |= {f"{pull.name}_N": ("tensions", "", pull.name) for pull in assembly.pulls}
    table = TextColumns.read(path, "cycle file")
    table.require("time_s")
    if unknown := set(table.header) - set(known):
        raise ValueError(f"{path}: got the columns {', '.join(sorted(unknown))}, expected some of {', '.join(known)}")
    found: dict[str, dict[str, dict[str, Array]]] = {}
    for column in table.header:
        curve, (what, owner, name) = np.asarray(table.numbers(column)), known[column]
        if column.endswith("_rad"):
            check_reach(str(path), {name: curve})
        found.setdefault(what, {}).setdefault(owner, {})[name] = curve
    time_s, loads = found["time"][""][""], found.get("loads", {})
    check_rising(str(path), time_s)
    if len(loads) > 1:
        raise ValueError(f"{path}: got loads of the contacts {', '.join(loads)}, expected those of one")
    contact, measured = next(iter(loads.items()), ("", {}))
    tensions = found.get("tensions", {}).get("", {})
    return AssemblyCycle(time_s, found.get("pose", {}), contact, measured, tensions, found.get("applied", {}))


def walking() -> AssemblyCycle:
    """Of `knee_with_patella`: rotations and tibiofemoral loads of the built-in walk, and the quadriceps' tension that
    `MuscleContact` finds in it."""
    cycle, walk = reference_cycle(), example_walk()
    solved = MuscleContact(cc.load_surrogate("knee"), walk).solve()
    quadriceps = [walk.muscles.names.index(name) for name in ("recfem", "vasint", "vaslat", "vasmed")]
    tension = {"quadriceps": solved.muscle_forces_n[:, quadriceps].sum(axis=1)}
    pose = {"femur": cycle.pose}
    return AssemblyCycle(cycle.time_s, pose, "tibiofemoral", cycle.estimation_targets(), tension)


def bending() -> AssemblyCycle:
    """Of a knee on its ligaments: it bends from 0 to 75 degrees in 2 s, pressed by 300 N along the tibia."""
    share = np.linspace(0.0, 1.0, 51)
    bent = {"femur": {"rz": -np.radians(75.0) * share}}
    return AssemblyCycle(2.0 * share, bent, applied={"femur": {"Fy": np.full(51, -300.0)}})


@dataclass(frozen=True)
class AssemblyPoses:
    """Poses (n, bodies, 6), loads (n, L) of the assembly's ``load_names``, what is left on settled bodies [N] (n,),
    torques over 25 mm, and whether a frame is solved (n,)."""

    poses: Array
    loads: Array
    residual_n: Array
    solved: np.ndarray


def solve(assembly: Assembly, cycle: AssemblyCycle, tolerance_n: float = 1e-4) -> AssemblyPoses:
    """Find the measured body's poses, then settle the other bodies. Frames that are not solved are marked, not raised.

    tolerance_n: what may be left on a body, torques over 25 mm. Raises ValueError for a pull without
    tension and for unknown bodies.
    """
    count, bodies = len(cycle), assembly.bodies
    if set(cycle.tensions) != {pull.name for pull in assembly.pulls} or not {*cycle.pose, *cycle.applied} <= {*bodies}:
        raise ValueError(
            f"got tensions of {', '.join(cycle.tensions) or 'nothing'} and curves of {', '.join(cycle.pose)}; assembly "
            f"{assembly.name} has the pulls {', '.join(p.name for p in assembly.pulls)} and bodies {', '.join(bodies)}"
        )
    poses, solved = np.tile(assembly.start_poses(), (count, 1, 1)), np.ones(count, dtype=bool)
    for body, curves in cycle.pose.items():
        for name, curve in curves.items():
            poses[:, bodies.index(body), pose_index(name)] = curve
    measured = ""
    if cycle.contact:
        contact = assembly.contact(cycle.contact)
        measured = contact.moving
        if contact.fixed != assembly.ground or np.any(contact.fixed_frame) or np.any(contact.moving_frame):
            raise ValueError(f"the measured contact {contact.name} is not between the ground and a body's own frame")
        found = PoseEstimation(contact.model, cycle.loads, cycle.pose.get(measured, {})).solve()
        poses[:, bodies.index(measured)], solved = found.poses, found.solved
    free = {
        body: [name for name in POSE_NAMES if name not in cycle.pose.get(body, {})]
        for body in bodies
        if body != measured
    }
    free = {body: names for body, names in free.items() if names}
    residual = np.zeros(count)
    if free:
        settle, flat = Settling(assembly, free), poses.reshape(count, -1)
        locked = [i for i in range(flat.shape[1]) if i not in settle.rows]
        away = ((poses - assembly.start_poses()) * POSE_IN_MM).reshape(count, -1)[:, locked]
        first = int(np.abs(away).max(axis=1, initial=0.0).argmin())
        for frame in (*range(first, count), *range(first - 1, -1, -1)):
            neighbour = frame - 1 if frame > first else frame + 1
            if frame != first and residual[neighbour] <= tolerance_n:
                flat[frame, settle.rows] = flat[neighbour, settle.rows]
            applied = {
                body: [f.get("Fx", zero)[frame], f.get("Fy", zero)[frame], f.get("Fz", zero)[frame], 0.0, 0.0, 0.0]
                for zero in (np.zeros(count),)
                for body, f in cycle.applied.items()
            }
            tensions = [max(float(cycle.tensions[pull.name][frame]), 0.0) for pull in assembly.pulls]
            held = settle(flat[frame].reshape(-1, 6), applied, tensions, tolerance=tolerance_n)
            residual[frame] = held.residual
            if held.converged:
                flat[frame] = held.poses.ravel()
        poses = flat.reshape(poses.shape)
    loads = np.asarray(assembly.function().map(count)(poses.reshape(-1, 6).T)).T
    return AssemblyPoses(poses, loads, residual, solved & (residual <= tolerance_n))


def main(
    assembly: str = "knee_with_patella", cycle: Path | None = None, out: Path = Path("results/assembly_poses")
) -> None:
    """Find all poses of a ready assembly, or of an assembly .toml, over a measured cycle (CSV) or its own."""
    joint = cc.load_assembly(assembly)
    own = {"knee_with_patella": walking, "natural_knee": bending}
    if cycle is None and joint.name not in own:
        raise ValueError(f"assembly {joint.name} has no cycle of its own, expected a cycle file (--cycle)")
    given = own[joint.name]() if cycle is None else read_assembly_cycle(cycle, joint)
    found = solve(joint, given)
    for part in joint.contacts:
        elements = reference_model(part.model)
        q = ca.MX.sym("q", 6, len(joint.bodies))
        at_contact = ca.Function("at_contact", [q], [joint.contact_pose(part, q)])
        poses = np.array([at_contact(frame.T).full().ravel() for frame in found.poses])
        print(f"{part.name}: {verify(part.model, poses, elements, found.solved).line}")
    print(
        f"{int(found.solved.sum())} of {len(given)} frames solved, up to {found.residual_n.max():.1g} N left on a body"
    )
    print("force or tension                    largest [N]")
    for (name, kind), curve in zip(joint.load_kinds.items(), found.loads.T, strict=True):
        if kind == FORCE:
            print(f"{name:35s} {curve[np.abs(curve).argmax()]:10.1f}")

    out.mkdir(parents=True, exist_ok=True)
    columns = {"time_s": given.time_s}
    for k, body in enumerate(joint.bodies):
        columns |= {f"{body}_{quantity(name).column}": found.poses[:, k, i] for i, name in enumerate(POSE_NAMES)}
    columns |= {f"{pull}_N": curve for pull, curve in given.tensions.items()}
    columns |= {
        f"{name}_{kind.plain_unit}": curve
        for (name, kind), curve in zip(joint.load_kinds.items(), found.loads.T, strict=True)
    }
    write_columns(out / "assembly_poses.csv", {**columns, "solved": found.solved.astype(int)}, digits=9)
    page = new_page(4.5 * (len(joint.bodies) + 1), 4.0)
    left, *others = page.subplots(1, len(joint.bodies) + 1)
    for (name, kind), curve in zip(joint.load_kinds.items(), found.loads.T, strict=True):
        if kind == FORCE:
            left.plot(given.percent, curve, label=name)
    left.set(xlabel="cycle [%]", ylabel="force on the fixed body, tension [N]")
    for k, axis in enumerate(others):
        axis.plot(given.percent, found.poses[:, k] * POSE_IN_MM, label=list(POSE_NAMES))
        axis.set(xlabel="cycle [%]", ylabel=f"pose of the {joint.bodies[k]} [mm, rotations over 25 mm]")
    for axis in (left, *others):
        axis.legend(fontsize=6)
    save_page(page, out / "assembly_poses.png")


if __name__ == "__main__":
    run_program(main)
