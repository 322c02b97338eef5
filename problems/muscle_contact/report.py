"""What muscle and contact say together: a table, every frame as CSV and .sto, a JSON summary and a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.conventions import Array
from casadi_contact.files import writable_folder
from casadi_contact.motion.columns import write_columns
from casadi_contact.motion.load_cycle import LoadCycle
from casadi_contact.motion.opensim import loads_table, poses_table, write_table
from casadi_contact.optimisation import total_selection
from casadi_contact.page import (
    COLOURS,
    FAILED,
    FOUNDATION,
    SURROGATE,
    WANTED,
    Panel,
    frame,
    new_page,
    panels,
    save_page,
)
from casadi_contact.terminal import PlainConsole
from casadi_contact.verification import Verdict
from problems.common.contact import grids_in_words, models_on_grids
from problems.common.knee_scene import KNEE_LOADS, SIDES
from problems.common.outcome import print_outcome, print_verdict, solver_record
from problems.common.records import (
    DIGITS,
    assembly_columns,
    load_columns,
    pose_columns,
    rms_and_largest,
    rms_and_largest_words,
    write_summary,
)
from problems.muscle_contact.cocontraction import SOLEUS_N
from problems.muscle_contact.extensor import PATELLA, PatellaResult, quadriceps
from problems.muscle_contact.knee_coordinates import coordinate_unit
from problems.muscle_contact.problem import MuscleContact
from problems.muscle_contact.solve import MuscleContactResult
from problems.muscle_contact.times import at_times

_MUSCLES = {
    "bflh": "biceps femoris, long head",
    "bfsh": "biceps femoris, short head",
    "gaslat": "gastrocnemius, lateral head",
    "gasmed": "gastrocnemius, medial head",
    "grac": "gracilis",
    "recfem": "rectus femoris",
    "sart": "sartorius",
    "semimem": "semimembranosus",
    "semiten": "semitendinosus",
    "tfl": "tensor fasciae latae",
    "vasint": "vastus intermedius",
    "vaslat": "vastus lateralis",
    "vasmed": "vastus medialis",
}
_DRAWN_MUSCLES = 6


@dataclass(frozen=True)
class Compared:
    """Contact loads (n, 7) as in `KNEE_LOADS` of the problem's model, on the fine EF grid and on the teacher grid,
    which has next to no error of its own, None where there is no EF at hand; measured (n, 2) as in `SIDES`, at the
    walk's times, or None; grids: of the EF, in words."""

    got: Array
    ef: Array | None
    teacher: Array | None
    measured: Array | None
    grids: dict[str, str]

    @classmethod
    def of(cls, problem: MuscleContact, result: MuscleContactResult, measured: LoadCycle | None) -> Compared:
        """Re-evaluate the solution on the scene's fine and teacher EF grids, and take measured forces at its times.

        Raises ValueError where the measured cycle does not reach over the walk (`at_times`).
        """
        scene, walk = problem.contact_model.scene, problem.walk
        columns = [scene.load_names.index(name) for name in KNEE_LOADS]
        models = models_on_grids(scene)
        on = {name: model(result.poses)[:, columns] for name, model in models.items()}
        grids = grids_in_words(models)
        if measured is None:
            return cls(result.loads, on.get("fine"), on.get("teacher"), None, grids)
        sides = np.column_stack([measured.fy_med, measured.fy_lat])
        forces = at_times(f"measured cycle {measured.name}", measured.time_s, sides, walk.time_s)
        return cls(result.loads, on.get("fine"), on.get("teacher"), forces, grids)

    def errors(self) -> dict[str, dict[str, dict[str, float | None]]]:
        """RMS, mean and largest difference [N] by side: predicted minus measured compression, EF minus model."""
        pairs = {
            name: ef - self.got for name, ef in (("fine_ef", self.ef), ("teacher_ef", self.teacher)) if ef is not None
        }
        if self.measured is not None:
            pairs["prediction"] = self.measured - self.got[:, : len(SIDES)]
        return {
            name: {
                key: {**rms_and_largest(off[:, column]), "mean": float(off[:, column].mean())}
                for key, off in pairs.items()
            }
            for column, name in enumerate(SIDES)
        }


def report(
    problem: MuscleContact,
    result: MuscleContactResult,
    verdict: Verdict,
    out: Path,
    measured: LoadCycle | None = None,
    kind: str = "surrogate",
    patellar: Verdict | None = None,
) -> None:
    """Print the table; write muscle_contact.csv, .png, poses.sto, loads.sto and summary.json in the folder out;
    kind: what to call the contact model there; patellar: the verdict on the patella, where there is one."""
    writable_folder(out)
    walk = problem.walk
    compared = Compared.of(problem, result, measured)
    errors = compared.errors()
    _print(problem, result, verdict, errors, kind)
    if result.patella is not None and patellar is not None:
        for line in (f"patella: {patellar}", _patella_line(result.patella)):
            PlainConsole().print(line, highlight=False, soft_wrap=True)
    _write_table(out / "muscle_contact.csv", problem, result, compared, verdict)
    write_table(poses_table(walk.time_s, result.poses, f"{walk.name} femur in insert"), out / "poses.sto")
    write_table(loads_table(walk.time_s, result.loads, KNEE_LOADS, f"{walk.name} contact on insert"), out / "loads.sto")
    summary: dict[str, Any] = {
        "verdict": str(verdict),
        "walk": walk.name,
        "frames": len(walk),
        "converged": int(result.converged.sum()),
        "verified": int(verdict.verified.sum()),
        **solver_record(result),
        "overloaded_frames": np.flatnonzero(result.overloaded).tolist(),
        "slack_frames": {
            name: np.flatnonzero(frames).tolist()
            for name, frames in zip(walk.muscles.names, problem.capacity.slack.T, strict=True)
            if frames.any()
        },
        "balanced": problem.balanced,
        "free": problem.free,
        "measured": None if measured is None else measured.name,
        "errors_n": errors,
        "largest_reserve": {name: float(np.abs(curve).max()) for name, curve in result.reserves.items()},
        "largest_imbalance": {name: float(np.abs(curve).max()) for name, curve in result.unbalanced.items()},
        "largest_activation": dict(zip(walk.muscles.names, result.activations.max(axis=0).tolist(), strict=True)),
        **({"ef_grids": compared.grids} if compared.grids else {}),
        "scene": problem.contact_model.scene.name,
        "patella": None if patellar is None else str(patellar),
    }
    write_summary(out / "summary.json", summary)
    draw(problem, result, compared, out / "muscle_contact.png", patellar)
    PlainConsole().print(f"results in {out}", highlight=False)


def _print(
    problem: MuscleContact, result: MuscleContactResult, verdict: Verdict, errors: dict[str, Any], kind: str
) -> None:
    walk, console = problem.walk, PlainConsole()
    print_verdict(console, verdict)
    table = Table(title=f"Muscle and contact, {walk.name}: {len(walk)} frames, compression in N")
    table.add_column("")
    for title in ("largest", "predicted - measured: RMS", "mean", f"EF fine - {kind}: RMS / max", "EF teacher"):
        table.add_column(title, justify="right")
    for column, name in enumerate(SIDES):
        row = errors[name]
        prediction = [f"{row['prediction'][key]:.0f}" if "prediction" in row else "-" for key in ("rms", "mean")]
        grids = [rms_and_largest_words(row[key]) if key in row else "-" for key in ("fine_ef", "teacher_ef")]
        table.add_row(name, f"{-result.loads[:, column].min():.0f}", *prediction, *grids)
    console.print(table)
    largest = ", ".join(
        f"{name} {np.abs(curve).max():.2g} {coordinate_unit(name)}" for name, curve in result.reserves.items()
    )
    console.print(f"largest reserves: {largest}; largest activation: {result.activations.max():.2f}", highlight=False)
    print_outcome(console, result)


def _patella_line(patella: PatellaResult) -> str:
    """The largest tension of each ligament and the largest load of each facet."""
    largest = [f"{name} {np.abs(curve).max():.0f} N" for name, curve in patella.loads.items() if "_T" not in name]
    return f"largest: {', '.join(largest)}"


def _write_table(
    path: Path, problem: MuscleContact, result: MuscleContactResult, compared: Compared, verdict: Verdict
) -> None:
    walk = problem.walk
    columns: dict[str, Any] = {"frame": range(len(walk)), "time_s": walk.time_s, "cycle_percent": walk.percent}
    columns |= pose_columns(result.poses) | load_columns(KNEE_LOADS, compared.got)
    for what, table in (("ef", compared.teacher), ("measured", compared.measured)):
        if table is not None:
            columns |= {f"{name}_{what}_N": curve for name, curve in zip(SIDES, table.T, strict=False)}
    for muscle, name in enumerate(walk.muscles.names):
        columns[f"{name}_activation"] = result.activations[:, muscle]
        columns[f"{name}_N"] = result.muscle_forces_n[:, muscle]
    if result.patella is not None:
        columns |= {f"patella_{name}": curve for name, curve in pose_columns(result.patella.poses).items()}
        columns |= assembly_columns(list(result.patella.loads), np.column_stack(list(result.patella.loads.values())))
        columns |= {"patella_left_N": result.patella.left_n}
    if result.soleus is not None:
        columns |= {"soleus_activation": result.soleus, "soleus_N": SOLEUS_N * result.soleus}
    for name in problem.balanced:
        columns[f"{name}_reserve_{coordinate_unit(name)}"] = result.reserves[name]
        columns[f"{name}_imbalance_{coordinate_unit(name)}"] = result.unbalanced[name]
    columns |= {"converged": result.converged.astype(int), "reason": result.reason, "verdict": verdict.words}
    write_columns(path, columns, digits=DIGITS)


def draw(
    problem: MuscleContact,
    result: MuscleContactResult,
    compared: Compared,
    path: Path,
    patellar: Verdict | None = None,
) -> None:
    """Forces of both sides (predicted, EF, measured), activations and the greatest muscle forces, and where the verdict
    on a patella is given what holds it, as a PNG."""
    walk, errors = problem.walk, compared.errors()
    rows = 2 if patellar is None else 3
    page = new_page(13.0, 4.25 * rows)
    parts = panels(page, rows, 2, {(2, 1)} if compared.teacher is None else {(0, 0), (0, 1), (2, 1)})
    failed = ~result.converged
    for column, (name, side) in enumerate(zip(SIDES, ("medial", "lateral"), strict=True)):
        panel, axis = parts[0, column], parts[0, column].curves
        title = f"{side} side"
        if compared.measured is not None:
            axis.plot(walk.percent, -compared.measured[:, column], label="measured", **WANTED)
            title += f": RMS error {errors[name]['prediction']['rms']:.0f} N"
        axis.plot(walk.percent, -compared.got[:, column], label="predicted", **SURROGATE)
        if compared.teacher is not None:
            axis.plot(walk.percent, -compared.teacher[:, column], label="EF, same poses", **FOUNDATION)
        if failed.any():
            axis.plot(walk.percent[failed], -compared.got[failed, column], label="not converged", **FAILED)
        axis.set(title=title, ylabel="compression [N]")
        axis.legend(fontsize=8)
        if compared.teacher is not None:
            off = compared.got[:, column] - compared.teacher[:, column]  # of compressions, which have the other sign
            panel.difference(walk.percent, off, "EF - predicted", **FOUNDATION)
            panel.differences.set_ylabel("EF - predicted [N]", fontsize=7)
    forces = [parts[0, column].curves for column in range(2)]
    top = max(axis.get_ylim()[1] for axis in forces)
    for axis in forces:
        axis.set_ylim(-0.03 * top, top)
    names = [_MUSCLES.get(name, name) for name in walk.muscles.names]
    activation, strongest_forces = parts[1, 0].curves, parts[1, 1].curves
    image = activation.pcolormesh(
        walk.percent, np.arange(len(names)), result.activations.T, shading="nearest", cmap="viridis", vmin=0.0
    )
    activation.set_yticks(np.arange(len(names)), names, fontsize=8)
    page.colorbar(image, ax=activation, label="activation [-]")
    strongest = np.argsort(result.muscle_forces_n.max(axis=0))[::-1][:_DRAWN_MUSCLES]
    colours = [COLOURS[name] for name in ("blue", "vermillion", "green", "purple", "orange", "sky blue")]
    for muscle, color in zip(strongest, colours, strict=True):
        strongest_forces.plot(walk.percent, result.muscle_forces_n[:, muscle], color=color, label=names[muscle])
    strongest_forces.set(title="strongest muscles", ylabel="force [N]")
    strongest_forces.legend(fontsize=8)
    if patellar is not None:
        _draw_patella(parts[2, 0].curves, parts[2, 1], problem, result, patellar)
    frame((panel.lowest for panel in parts.values()), "cycle [%]")
    for panel in parts.values():
        panel.curves.set_xlim(0.0, 100.0)
    activation.grid(visible=False)
    converged = f"{int(result.converged.sum())} of {len(walk)} frames converged"
    page.suptitle(f"Muscle and contact forces from inverse dynamics, {walk.name}: {converged}")
    save_page(page, path, dots_per_inch=110)


def _draw_patella(
    forces: Any, facets: Panel, problem: MuscleContact, result: MuscleContactResult, patellar: Verdict
) -> None:
    """Quadriceps, tendon and the resultant of the groove, which balance, and the compression of each facet with what
    the elastic foundation adds to it at the same poses."""
    assert problem.extensor is not None
    assert result.patella is not None
    walk, groove = problem.walk, problem.extensor.contact
    loads = groove.model(result.patella.contact_poses, patellar.load_names)
    selection = total_selection(patellar.load_names, groove.model.patch_names)[:3]
    resultant = loads @ selection.T
    held = {
        "quadriceps": result.muscle_forces_n[:, quadriceps(walk.muscles.names)].sum(axis=1),
        "groove contact": np.linalg.norm(resultant, axis=1),
    }
    lines = [line.name for line in problem.extensor.assembly.ligaments if PATELLA in line.bodies]
    held |= {name.replace("_", " "): result.patella.loads[name] for name in lines}
    for (label, curve), color in zip(held.items(), COLOURS.values(), strict=False):
        forces.plot(walk.percent, curve, color=color, label=label)
    forces.set(title="what holds the patella", ylabel="force [N]")
    for name, color in zip(groove.model.scene.sensitive_loads, COLOURS.values(), strict=False):
        column = patellar.load_names.index(name)
        compression = np.abs(loads[:, column])
        facets.curves.plot(walk.percent, compression, color=color, label=name)
        on_ef = np.abs(loads[:, column] - patellar.errors[:, column])
        facets.difference(walk.percent, on_ef - compression, name, color=color)
    facets.curves.set(title="facets of the patella", ylabel="compression [N]")
    facets.differences.set_ylabel("EF - predicted [N]", fontsize=7)
    for axis in (forces, facets.curves):
        axis.legend(fontsize=8)
