"""The passive motion of an imported joint: where do its secondary coordinates go while it is bent?

    forces(x_k, (x_k - x_{k-1})/Δt, muscles; motion_k) = 0

on the secondary coordinates x, frame after frame by Newton's method (`FrameBalance.settle`): contact, ligaments with
their damping, gravity and muscles, which have one activation and rigid tendons, or forces from a file. Prescribed
coordinates come from a file, all others keep the model's default. So does JAM's forward simulation, whose settings file
is read as it is, and with whose states.sto, contact and ligaments there are compared.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import casadi_contact as cc
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.balance import FrameBalance
from casadi_contact.optimisation.assembly.file import ray_casting
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.opensim import TIME, read_opensim_table
from casadi_contact.workflow.opensim_import.importing import states_of
from casadi_contact.workflow.opensim_import.model_file import opensim_root
from problems.comak import draw
from problems.measured_motion import Motion, loads_table, names_of, read_loads, write_values
from problems.summary import write_summary


def move(
    assembly: Assembly,
    motion: Motion,
    secondary: list[str],
    activation: float,
    force_n: Array | None = None,
    rest: bool = False,
) -> tuple[Array, Array]:
    """Coordinates (n, c) with the secondary ones in balance, and the force [N] left in each frame (n,). force_n (n, m):
    of muscles, in place of their activation. rest: they are at rest in the first frame, else at the model's default."""
    balance = FrameBalance(assembly, secondary, secondary, motion.bodies, by_force=force_n is not None)
    drive = np.full((len(motion.q), len(assembly.muscles)), activation) if force_n is None else force_n
    q, x, left = motion.q.copy(), assembly.default[balance.free], 0.0
    if rest:
        standing = [each if i in (0, 3) else 0.0 * each for i, each in enumerate(motion.inputs(slice(0, 1)))]
        x, left = balance.settle(x, drive[0], standing)
    q[0, balance.free], residuals = x, [left]
    for k, step in enumerate(np.diff(motion.time_s), start=1):
        x, left = balance.settle(x, drive[k], motion.inputs(slice(k, k + 1)), x, float(step))
        q[k, balance.free] = x
        residuals.append(left)
    return q, np.array(residuals)


def main(
    model: Path,
    settings: Path,
    prescribed: Path,
    forces: Path | None = None,
    against: Path | None = None,
    rest: bool = False,
    out: Path = Path("results/passive_flexion"),
) -> None:
    """Settle an imported joint along a prescribed motion.

    model: the folder that `casadi-contact import` wrote; settings: of JAM's forsim, .xml, whose external loads act too;
    prescribed: .sto, angles in degrees unless it says otherwise; forces: of muscles [N] by name, .sto, in place of the
    settings' control; against: a folder with JAM's states.sto, to compare with; rest: secondary coordinates are at rest
    at first, where JAM's start at the model's default. Exit status 3: some frames do not settle.
    """
    assembly, root = cc.load_assembly(model), opensim_root(settings)
    if forces is None and (inputs := (root.findtext(".//actuator_input_file") or "").strip()):
        raise ValueError(f"{settings} names {inputs}, which is not read: expected muscles' forces by --forces FILE")
    secondary = list(names_of(root.findtext(".//unconstrained_coordinates")))
    table = read_opensim_table(prescribed)
    table = replace(table, in_degrees=table.in_degrees is not False)
    time_s, loads = table.columns[TIME], (root.findtext(".//external_loads_file") or "").strip()
    if loads:  # they may go on where the motion rests
        time_s = np.unique(np.append(time_s, loads_table(settings.parent / loads).columns[TIME]).round(9))
    q = np.column_stack([np.interp(time_s, table.columns[TIME], x) for x in states_of(assembly, table).T])
    loaded = read_loads(settings.parent / loads, time_s) if loads else ((), None)
    spline = CubicSpline(time_s, q)
    motion = Motion(time_s, q, spline(time_s, 1), spline(time_s, 2), *loaded)
    given = None
    if forces is not None:
        known = read_opensim_table(forces)
        columns = (known.column(name) for name in assembly.muscle_names)
        given = np.column_stack([np.interp(time_s, known.columns[TIME], column) for column in columns])
    activation = max(0.0, float(root.findtext(".//constant_muscle_control") or 0.01))  # -1: none
    found, left = move(assembly, motion, secondary, activation, given, rest)
    settled = left <= 0.1
    print(f"{int(settled.sum())} of {len(left)} frames settled, up to {left.max():.2g} N left")
    ours = quantities(assembly, found, secondary)
    names = [name for name in ours if not name.startswith("ligament")]
    summary: dict[str, Any] = {"frames": len(left), "settled": int(settled.sum()), "left_n": float(left.max())}
    theirs = None
    if against is not None:
        states = read_opensim_table(next(against.glob("*states.sto")))
        stored = np.column_stack([np.interp(time_s, states.columns[TIME], x) for x in states_of(assembly, states).T])
        rays = cc.load_assembly(model, contact=ray_casting)
        theirs = quantities(rays, stored, secondary)
        if (against / "forces.sto").is_file():
            exact = exactness(assembly, rays, against, activation)
            if given is not None:  # the muscles of their states have other activations
                del exact["muscles [N]"]
            summary["largest difference at their states"] = exact
            for name, value in exact.items():
                print(f"at their states, {name}: largest difference {value:.2g}")
        off = {name: float(np.sqrt(np.mean((curve - theirs[name]) ** 2))) for name, curve in ours.items()}
        peaks = {name: float(np.abs(theirs[name]).max()) for name in off}
        summary |= {"RMS difference": off, "their peak": peaks}
        for name in names:
            print(f"{name}: RMS difference {off[name]:.3f}, their peak {peaks[name]:.2f}")
        ligaments = [off[name] for name in off if name.startswith("ligament")]
        print(f"ligaments: RMS difference {np.mean(ligaments):.2f} N in the mean, {max(ligaments):.2f} N at most")
    out.mkdir(parents=True, exist_ok=True)
    write_columns(out / "passive_flexion.csv", {"time_s": time_s, **ours, "settled": settled.astype(int)}, digits=9)
    write_values(out / "values.sto", assembly, time_s, found)
    write_summary(out / "summary.json", summary)
    draw(out / "passive_flexion.png", time_s, ({"JAM": theirs} if theirs else {}) | {"here": ours}, names, 3)
    print(f"results in {out}")
    raise SystemExit(0 if settled.all() else 3)


def exactness(assembly: Assembly, rays: Assembly, folder: Path, activation: float) -> dict[str, float]:
    """Largest differences [N, mm] from what JAM's forces.sto holds at the states of its states.sto: contact by rays and
    by the assembly's own models, bundles that are straight and that wrap, and muscles, which have one activation."""
    states, forces = (read_opensim_table(folder / f"{name}.sto") for name in ("states", "forces"))
    time_s, q = states.columns[TIME], states_of(assembly, states)
    u, found = np.zeros_like(q), dict[str, float]()
    for label, column in states.columns.items():
        if label.endswith("/speed"):
            u[:, assembly.rows([label.split("/")[-2]])[0]] = column

    def off(ours: Any, columns: list[str]) -> Any:
        """Largest difference of each curve (curves, n) from the column of that name."""
        theirs = [np.interp(time_s, forces.columns[TIME], forces.columns[name]) for name in columns]
        return np.abs(np.asarray(ours) - theirs).max(axis=1)

    for name, model in (("rays", rays), ("cells", assembly)):
        wrenches = np.asarray(model.function(["contact_wrenches"]).map(len(q))(q.T, 0.0, 0.0, 0.0))
        for i, contact in enumerate(assembly.contact_names):
            columns = [f"{contact}.casting.total.contact_force_{axis}" for axis in "xyz"]
            found[f"{contact} by {name} [N]"] = float(off(wrenches[:3, i :: len(assembly.contacts)], columns).max())
    outputs = ["ligament_lengths", "ligament_tensions", "muscle_forces"]
    lengths, tensions, _ = assembly.function(outputs)(q.T, 0.0, 0.0, activation)
    muscles = assembly.function(outputs[2:])(q.T, u.T, 0.0, activation)
    straight = np.array([ligament.wrap is None for ligament in assembly.ligaments])
    springs = (("length [mm]", lengths, "length", 1e3), ("spring [N]", tensions, "force_spring", 1.0))
    for label, ours, key, unit in springs:
        worst = unit * off(ours, [f"{name}.{key}" for name in assembly.ligament_names])
        found |= {f"straight bundles' {label}": float(worst[straight].max())}
        found |= {f"wrapped bundles' {label}": float(worst[~straight].max(initial=0.0))}
    return found | {"muscles [N]": float(off(muscles, list(assembly.muscle_names)).max())}


def quantities(assembly: Assembly, q: Array, secondary: list[str]) -> dict[str, Array]:
    """Curves (n,) by name: secondary coordinates [mm, degrees], contact forces [N] and ligaments' tensions [N]."""
    units = {"translation": ("mm", 1e3), "rotation": ("deg", float(np.degrees(1.0)))}
    in_units = [(name, *units[assembly.coordinate_table[name].kind]) for name in secondary]
    curves = {f"{n}_{unit}": s * q[:, i] for (n, unit, s), i in zip(in_units, assembly.rows(secondary), strict=True)}
    function = assembly.function(["contact_wrenches", "ligament_tensions"]).map(len(q))
    wrenches, tensions = (np.asarray(part) for part in function(q.T, 0.0, 0.0, 0.0))
    contact = np.linalg.norm(wrenches.reshape(6, len(q), -1)[:3], axis=0)
    curves |= {f"{name}_N": curve for name, curve in zip(assembly.contact_names, contact.T, strict=True)}
    return curves | {f"ligament_{n}_N": curve for n, curve in zip(assembly.ligament_names, tensions, strict=True)}


if __name__ == "__main__":
    run_program(main)
