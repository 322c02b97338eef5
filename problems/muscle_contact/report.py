"""What muscle and contact say together: a table, every frame as CSV and .sto, a JSON summary and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.contact.continuity import leaps_in_words
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.quantities import FORCE, Kind, two_digits
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.knee import KNEE_LOADS, SIDES, coordinate_unit
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.load_cycle import LoadCycle
from casadi_contact.scenes.opensim.mapping import loads_table, poses_table
from casadi_contact.scenes.opensim.table import write_table
from problems.common.outcome import print_outcome, print_verdict, solver_record
from problems.common.records import (
    DIGITS,
    assembly_columns,
    load_columns,
    pose_columns,
    rms_and_largest_words,
    write_summary,
)
from problems.muscle_contact.cocontraction import SOLEUS_N
from problems.muscle_contact.compared import Compared
from problems.muscle_contact.extensor import PatellaResult
from problems.muscle_contact.picture import draw
from problems.muscle_contact.problem import MAY_MOVE, MuscleContact
from problems.muscle_contact.solve import MuscleContactResult


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
        for line in (f"patella: {patellar}", _patella_line(problem, result.patella)):
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
        f"{name} {two_digits(np.abs(curve).max())} {coordinate_unit(name)}" for name, curve in result.reserves.items()
    )
    console.print(f"largest reserves: {largest}; largest activation: {result.activations.max():.2f}", highlight=False)
    print_outcome(console, result)
    if leaping := leaps_in_words(result.poses, MAY_MOVE):
        said = f"the femur leaps: {leaping}; neighbours may stand in different equilibria, do not compare their poses"
        console.print(said, highlight=False, soft_wrap=True)


def _patella_line(problem: MuscleContact, patella: PatellaResult) -> str:
    """The largest tension of each ligament and the largest load of each facet."""
    kinds = _load_kinds(problem)
    largest = [f"{name} {np.abs(curve).max():.0f} N" for name, curve in patella.loads.items() if kinds[name] == FORCE]
    return f"largest: {', '.join(largest)}"


def _load_kinds(problem: MuscleContact) -> Mapping[str, Kind]:
    assert problem.extensor is not None
    return problem.extensor.assembly.load_kinds


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
        columns |= assembly_columns(_load_kinds(problem), np.column_stack(list(result.patella.loads.values())))
        columns |= {"patella_left_N": result.patella.left_n}
    if result.soleus is not None:
        columns |= {"soleus_activation": result.soleus, "soleus_N": SOLEUS_N * result.soleus}
    for name in problem.balanced:
        columns[f"{name}_reserve_{coordinate_unit(name)}"] = result.reserves[name]
        columns[f"{name}_imbalance_{coordinate_unit(name)}"] = result.unbalanced[name]
    columns |= {"converged": result.converged.astype(int), "reason": result.reason, "verdict": verdict.words}
    write_columns(path, columns, digits=DIGITS)
