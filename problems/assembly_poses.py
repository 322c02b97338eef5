"""Poses of all bodies of an assembly over a cycle: of a knee with its patella in walking, or a knee on its ligaments.

    one body, if its contact's loads were measured:   min ½ |r(q)|²        (`PoseEstimation`)
    every other coordinate that was not measured:     forces(q; muscle forces) + applied = 0

r are the misfits of measured loads and centres of pressure, forces what contacts, ligaments and muscles of given force
do along a coordinate (`CoordinateSettling`). Frames settle one after the other, outwards from the one nearest to the
assembly's rest, each from its neighbour's coordinates. Every contact is verified on the elements of its scene.

A cycle file (CSV) names what was measured by the assembly's parts: time_s; femur_rz_rad or femur_tx_mm, a coordinate;
femur_Fy_N, a force applied along the coordinate femur_ty; tibiofemoral_Fy_med_N, tibiofemoral_cop_ap_mm, a load or
centre of pressure of one contact; quadriceps_N, the force of a muscle.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import casadi_contact as cc
from casadi_contact.core.conventions import LEVER_MM, POSE_NAMES, Array
from casadi_contact.core.quantities import FORCE, quantity
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.assembly.settling import CoordinateSettling
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
    """Curves (n,) by name: coordinates [mm, rad], forces [N] applied along coordinates, loads [N, N·mm] and centres of
    pressure [mm] of the measured contact, "" where none was, and forces [N] of muscles."""

    time_s: Array
    coordinates: Mapping[str, Array] = field(default_factory=dict)
    contact: str = ""
    loads: Mapping[str, Array] = field(default_factory=dict)
    muscles: Mapping[str, Array] = field(default_factory=dict)
    applied: Mapping[str, Array] = field(default_factory=dict)


def read_assembly_cycle(path: Path, assembly: cc.Assembly) -> AssemblyCycle:
    """Read a cycle file; ValueError for columns that the assembly has no part for."""
    known = {"time_s": ("time", "time")}
    for name, coordinate in assembly.coordinate_table.items():
        known[f"{name}_{'mm' if coordinate.kind == 'translation' else 'rad'}"] = ("coordinates", name)
        if name[-3:] in ("_tx", "_ty", "_tz"):
            known[f"{name[:-2]}F{name[-1]}_N"] = ("applied", name)
    for part in assembly.contacts:
        for name in (*part.model.load_names, *CENTRES):
            known[f"{part.name}_{quantity(name).column}"] = (part.name, name)
    known |= {f"{name}_N": ("muscles", name) for name in assembly.muscle_names}
    table = TextColumns.read(path, "cycle file")
    table.require("time_s")
    if unknown := set(table.header) - set(known):
        raise ValueError(f"{path}: got the columns {', '.join(sorted(unknown))}, expected some of {', '.join(known)}")
    found: dict[str, dict[str, Array]] = {}
    for column in table.header:
        curve, (what, name) = np.asarray(table.numbers(column)), known[column]
        if column.endswith("_rad"):
            check_reach(f"{path}, {column}", {"rz": curve})
        found.setdefault(what, {})[name] = curve
    check_rising(str(path), time_s := found.pop("time")["time"])
    given = {what: found.pop(what, {}) for what in ("coordinates", "muscles", "applied")}
    if len(found) > 1:
        raise ValueError(f"{path}: got loads of the contacts {', '.join(found)}, expected those of one")
    contact, loads = next(iter(found.items()), ("", {}))
    return AssemblyCycle(time_s, contact=contact, loads=loads, **given)


def walking() -> AssemblyCycle:
    """Of `knee_with_patella`: rotations and loads of the built-in walk, the quadriceps' force by `MuscleContact`."""
    cycle, walk = reference_cycle(), example_walk()
    solved = MuscleContact(cc.load_surrogate("knee"), walk).solve()
    quadriceps = [walk.muscles.names.index(name) for name in ("recfem", "vasint", "vaslat", "vasmed")]
    force = {"quadriceps": solved.muscle_forces_n[:, quadriceps].sum(axis=1)}
    turned = {f"femur_{name}": curve for name, curve in cycle.pose.items()}
    return AssemblyCycle(cycle.time_s, turned, "tibiofemoral", cycle.estimation_targets(), force)


def bending() -> AssemblyCycle:
    """Of a knee on its ligaments: it bends from 0 to 75 degrees in 2 s, pressed by 300 N along the tibia."""
    share = np.linspace(0.0, 1.0, 51)
    bent = {"femur_rz": -np.radians(75.0) * share}
    return AssemblyCycle(2.0 * share, bent, applied={"femur_ty": np.full(51, -300.0)})


@dataclass(frozen=True)
class AssemblyPoses:
    """Coordinates (n, c) [m, rad], poses of contacts (n, contacts, 6) [mm, rad]; by name loads of contacts and tensions
    of ligaments (n,) [N, N·mm]; what is left along coordinates (n,) [N], moments over 25 mm; frames that are solved."""

    q: Array
    contact_poses: Array
    loads: Mapping[str, Array]
    residual_n: Array
    solved: np.ndarray


def solve(assembly: cc.Assembly, cycle: AssemblyCycle, tolerance_n: float = 1e-4) -> AssemblyPoses:
    """Find the measured body's poses, then settle the other bodies. Frames that are not solved are marked, not raised.
    tolerance_n: what may be left along a coordinate, moments over 25 mm."""
    count, names = len(cycle), assembly.coordinates
    if set(cycle.muscles) != set(assembly.muscle_names):
        got, expected = ", ".join(cycle.muscles) or "nothing", ", ".join(assembly.muscle_names)
        raise ValueError(f"got forces of {got}, expected of {expected}")
    scale = np.array([c.scale for c in assembly.coordinate_table.values()])
    q, solved, measured = np.tile(assembly.default, (count, 1)), np.ones(count, dtype=bool), list(cycle.coordinates)
    q[:, assembly.rows(measured)] = np.reshape([*cycle.coordinates.values()], (-1, count)).T
    q[:, assembly.rows(measured)] /= scale[assembly.rows(measured)]
    if cycle.contact:
        contact = assembly.contacts[assembly.contact_names.index(cycle.contact)]
        of_body = [f"{contact.moving}_{name}" for name in POSE_NAMES]
        if contact.fixed != assembly.ground or np.any(contact.fixed_frame) or np.any(contact.moving_frame):
            raise ValueError(f"the measured contact {contact.name} is not between the ground and a body's own frame")
        pose = {name: cycle.coordinates[c] for name, c in zip(POSE_NAMES, of_body, strict=True) if c in measured}
        estimated = PoseEstimation(contact.model, cycle.loads, pose).solve()
        rows, solved = assembly.rows(of_body), estimated.solved
        q[:, rows] = estimated.poses / scale[rows]
        measured += of_body
    applied, residual = np.zeros(q.shape), np.zeros(count)
    applied[:, assembly.rows(cycle.applied)] = np.reshape([*cycle.applied.values()], (-1, count)).T
    drive = np.reshape([np.maximum(cycle.muscles[name], 0.0) for name in assembly.muscle_names], (-1, count))
    if free := [name for name in names if name not in measured]:
        settle, held = CoordinateSettling(assembly, free, by_force=True), assembly.rows(set(measured))
        in_mm = np.where(scale > 1.0, scale, LEVER_MM)[held]
        away = (q - assembly.default)[:, held] * in_mm
        first = int(np.abs(away).max(axis=1, initial=0.0).argmin())
        for frame in (*range(first, count), *range(first - 1, -1, -1)):
            neighbour = frame - 1 if frame > first else frame + 1
            if frame != first and residual[neighbour] <= tolerance_n:
                q[frame, settle.rows] = q[neighbour, settle.rows]
            rest = settle(q[frame], drive[:, frame], applied[frame], tolerance=tolerance_n, max_iterations=1000)
            residual[frame] = rest.residual
            if rest.converged:
                q[frame] = rest.q
    function = assembly.function(["contact_poses", "ligament_tensions"], by_force=True)
    found, tensions = (np.asarray(each) for each in function.map(count)(q.T, 0.0, 0.0, drive))
    poses = found.T.reshape(count, -1, 6)
    loads = {
        f"{part.name}_{name}": curve
        for k, part in enumerate(assembly.contacts)
        for name, curve in zip(part.model.load_names, part.model(poses[:, k]).T, strict=True)
    }
    loads |= dict(zip(assembly.ligament_names, tensions, strict=True))
    return AssemblyPoses(q, poses, loads, residual, solved & (residual <= tolerance_n))


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
    for k, part in enumerate(joint.contacts):
        elements = reference_model(part.model)
        print(f"{part.name}: {verify(part.model, found.contact_poses[:, k], elements, found.solved).line}")
    rest = f"up to {found.residual_n.max():.1g} N left along a coordinate"
    print(f"{int(found.solved.sum())} of {len(given)} frames solved, {rest}")
    print("force or tension                    largest [N]")
    kinds = {f"{c.name}_{name}": quantity(name).kind for c in joint.contacts for name in c.model.load_names}
    forces = {name: curve for name, curve in found.loads.items() if kinds.get(name, FORCE) == FORCE}
    for name, curve in forces.items():
        print(f"{name:35s} {curve[np.abs(curve).argmax()]:10.1f}")

    out.mkdir(parents=True, exist_ok=True)
    units = {name: "mm" if c.kind == "translation" else "rad" for name, c in joint.coordinate_table.items()}
    values = found.q * [c.scale for c in joint.coordinate_table.values()]
    columns = {"time_s": given.time_s}
    columns |= {f"{name}_{unit}": curve for (name, unit), curve in zip(units.items(), values.T, strict=True)}
    columns |= {f"{muscle}_N": curve for muscle, curve in given.muscles.items()}
    columns |= {f"{name}_{kinds.get(name, FORCE).plain_unit}": curve for name, curve in found.loads.items()}
    write_columns(out / "assembly_poses.csv", {**columns, "solved": found.solved.astype(int)}, digits=9)
    page = new_page(13.5, 4.0)
    left, *others = page.subplots(1, 3)
    for name, curve in forces.items():
        left.plot(given.percent, curve, label=name)
    left.set(xlabel="cycle [%]", ylabel="force on the fixed body, tension [N]")
    for axis, unit, label in zip(others, ("mm", "rad"), ("translations [mm]", "rotations [rad]"), strict=True):
        for (name, own_unit), curve in zip(units.items(), values.T, strict=True):
            if own_unit == unit:
                axis.plot(given.percent, curve, label=name)
        axis.set(xlabel="cycle [%]", ylabel=label)
    for axis in (left, *others):
        axis.legend(fontsize=6)
    save_page(page, out / "assembly_poses.png")


if __name__ == "__main__":
    run_program(main)
