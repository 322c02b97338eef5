"""What pose estimation says: a table, a CSV of every frame, a JSON summary and a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.quantities import LENGTH, quantity
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.pictures.page import (
    COLOURS,
    FAILED,
    FOUNDATION,
    SURROGATE,
    WANTED,
    frame,
    new_page,
    panels,
    save_page,
)
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.opensim.mapping import poses_table
from casadi_contact.scenes.opensim.table import write_table
from casadi_contact.surrogate.base import Surrogate
from problems.common.outcome import print_outcome, print_verdict, rows_in_words, solver_record
from problems.common.pressures import pressure_columns, pressures_table
from problems.common.records import (
    DIGITS,
    add_to_summary,
    pose_columns,
    rms_and_largest,
    rms_and_largest_words,
    write_summary,
)
from problems.pose_estimation.estimate import Estimate
from problems.pose_estimation.identifiability import hardly_determined_frames, hardly_determined_in_words
from problems.pose_estimation.on_foundation import OnFoundation
from problems.pose_estimation.problem import PoseEstimation
from problems.pose_estimation.several_poses import elsewhere_mm, several_poses_in_words, unstable_frames
from problems.pose_estimation.solve import PoseResult
from problems.pose_estimation.starts import RandomStarts

Errors = dict[str, dict[str, dict[str, float | None]]]
CENTRE_OFF_MM = 1.0
COMPARISONS = ("tracking", "fine_ef", "teacher_ef")
_TITLES = {
    "Fy_med": "medial vertical force",
    "Fy_lat": "lateral vertical force",
    "cop_ap": "centre of pressure, anterior-posterior",
    "cop_ml": "centre of pressure, medial-lateral",
}
_ON_MODEL = {"color": COLOURS["green"], "ls": "", "marker": "."}
_REFINE = "refine teaches the surrogate around them (casadi_contact.refine, docs/how-to/refine.md)"
_PANELS = (("tx", "tz"), ("ty",), ("rx", "ry"), ("rz",))


@dataclass(frozen=True)
class Tracked:
    """Values of what is wanted, by name, each (n, wanted): wanted, got (on the problem's model), and what the EF says,
    None where there is none at hand."""

    names: tuple[str, ...]
    wanted: Array
    got: Array
    ef: OnFoundation | None

    @classmethod
    def of(cls, problem: PoseEstimation, result: PoseResult, ef: OnFoundation | None) -> Tracked:
        """What a solution tracks."""
        wanted = problem.wanted
        return cls(tuple(wanted.values), np.column_stack(list(wanted.values.values())), wanted.got(result.loads), ef)

    def caveats(self, verdict: Verdict) -> list[str]:
        """What the verdict, which is in newtons, does not know of."""
        return [] if self.ef is None else [words for words in (self._lightly(verdict), *self.ef.caveats) if words]

    def _lightly(self, verdict: Verdict) -> str:
        """Verified frames whose centre of pressure lies elsewhere on the EF, because so little presses."""
        centres = [column for column, name in enumerate(self.names) if quantity(name).kind == LENGTH]
        if self.ef is None or not centres:
            return ""
        away = np.nan_to_num(np.abs(self.ef.teacher - self.wanted)[:, centres].max(axis=1), nan=np.inf)
        light = verdict.verified & (away > CENTRE_OFF_MM)
        if not light.any():
            return ""
        largest = away[light].max()
        where = f"up to {largest:.2g} mm from the wanted one" if np.isfinite(largest) else "nowhere, or far off"
        return (
            f"verified under so light a load that on the EF the centre of pressure lies {where}: "
            f"frames {rows_in_words(light)}"
        )

    def errors(self) -> Errors:
        """RMS and largest difference by quantity: model - wanted, fine EF - model, teacher EF - model."""
        pairs = [self.got - self.wanted]
        if self.ef is not None:
            pairs += [self.ef.fine - self.got, self.ef.teacher - self.got]
        return {
            name: {key: rms_and_largest(off[:, column]) for key, off in zip(COMPARISONS, pairs, strict=False)}
            for column, name in enumerate(self.names)
        }


def report(problem: PoseEstimation, estimate: Estimate, out: Path, kind: str = "surrogate") -> None:
    """Print the table and write pose_estimation.csv, .png, summary.json, and poses.sto and pressures.sto (OpenSim) in
    the folder out; kind: what to call the model there. Without an EF at hand there are no pressures."""
    writable_folder(out)
    cycle, scene, result, verdict = problem.cycle, problem.model.scene, estimate.result, estimate.verdict
    ef = estimate.ef
    tracked = Tracked.of(problem, result, ef)
    errors = tracked.errors()
    _print(problem, estimate, errors, ef, kind)
    untold, along = hardly_determined_frames(problem, result.poses, result.converged)
    leaping = np.zeros(problem.frames, dtype=bool) if verdict.leaps is None else verdict.leaps
    elsewhere = np.where(untold, 0.0, elsewhere_mm(problem, result))
    several = several_poses_in_words(problem, result, leaping, elsewhere)
    for words in [
        *tracked.caveats(verdict),
        *filter(None, [hardly_determined_in_words(problem, untold, along)]),
        *several,
    ]:
        PlainConsole().print(words, highlight=False, soft_wrap=True)
    _write_table(out / "pose_estimation.csv", problem, result, tracked, verdict)
    write_table(poses_table(cycle.time_s, result.poses, f"{cycle.name} poses"), out / "poses.sto")
    if ef is not None:
        pressed = pressures_table(cycle.time_s, ef.pressures, scene.patch_names, f"{cycle.name} pressures")
        write_table(pressed, out / "pressures.sto")
    else:
        (out / "pressures.sto").unlink(missing_ok=True)  # of other poses
    summary: dict[str, Any] = {
        "verdict": str(verdict),
        "cycle": cycle.name,
        "frames": problem.frames,
        "converged": int(result.converged.sum()),
        "verified": int(verdict.verified.sum()),
        "without_load": int((~problem.wanted.loaded).sum()),
        "on_contact_model": int(result.on_model.sum()),
        "of_these_on_the_rim": int(result.on_rim.sum()),
        "leaping": int(leaping.sum()),
        "carried_elsewhere": int((elsewhere > 0.0).sum()),
        "in_unstable_equilibrium": int(unstable_frames(problem, result).sum()),
        **({} if ef is None else ef.record()),
        **solver_record(result),
        "errors": errors,
        **({} if ef is None else {"ef_grids": ef.grids}),
        "structure": getattr(problem.model, "structure", kind),
        "scene": scene.name,
    }
    if _learnable(problem, result):
        summary["refine"] = _REFINE
    write_summary(out / "summary.json", summary)
    draw(problem, result, verdict, tracked, kind, out / "pose_estimation.png")
    PlainConsole().print(f"results in {out}", highlight=False)


def report_starts(starts: RandomStarts, out: Path) -> None:
    """Print what became of random starts about a solution, and add it to the summary in the folder out."""
    PlainConsole().print(str(starts), highlight=False)
    add_to_summary(out / "summary.json", {"random_starts": starts.record()})


def _print(problem: PoseEstimation, estimate: Estimate, errors: Errors, ef: OnFoundation | None, kind: str) -> None:
    console, frames = PlainConsole(), problem.frames
    print_verdict(console, estimate.verdict)
    table = Table(title=f"Pose estimation, {problem.cycle.name}: {frames} frames")
    table.add_column("RMS / max")
    compared = [] if ef is None else [f"EF {ef.grids[grid]} - {kind}" for grid in ("fine", "teacher")]
    for column in (f"{kind} - wanted", *compared):
        table.add_column(column, justify="right")
    for name in problem.wanted.values:
        cells = [rms_and_largest_words(off) for off in errors[name].values()]
        table.add_row(f"{name} ({quantity(name).unit})", *cells)
    console.print(table)
    print_outcome(console, estimate.result)
    if learnable := _learnable(problem, estimate.result):
        console.print(f"{learnable} frames on the contact model fit on the insert: {_REFINE}", highlight=False)


def _learnable(problem: PoseEstimation, result: PoseResult) -> int:
    """How many frames that a surrogate does not know it could be taught; a foundation learns nothing."""
    return int((result.on_model & ~result.on_rim).sum()) if isinstance(problem.model, Surrogate) else 0


def _write_table(path: Path, problem: PoseEstimation, result: PoseResult, tracked: Tracked, verdict: Verdict) -> None:
    cycle = problem.cycle
    columns: dict[str, Any] = {"frame": range(problem.frames), "time_s": cycle.time_s, "cycle_percent": cycle.percent}
    columns |= pose_columns(result.poses)
    ef = tracked.ef
    named = {"wanted": tracked.wanted, "got": tracked.got, **({} if ef is None else {"ef": ef.teacher})}
    for what, values in named.items():
        names = [f"{name}_{what}_{quantity(name).kind.plain_unit}" for name in tracked.names]
        columns |= dict(zip(names, values.T, strict=True))
    if ef is not None:
        columns |= pressure_columns(ef.pressures, problem.model.scene.patch_names)
    columns |= {"converged": result.converged.astype(int), "on_contact_model": result.on_model.astype(int)}
    columns |= {"on_rim": result.on_rim.astype(int)}
    if ef is not None:
        columns |= {f"share_{where}": share for where, share in ef.shares.items()}
    columns |= {"reason": result.reason, "verdict": verdict.words}
    write_columns(path, columns, digits=DIGITS)


def draw(
    problem: PoseEstimation, result: PoseResult, verdict: Verdict, tracked: Tracked, kind: str, path: Path
) -> None:
    """What is wanted (wanted, got, EF) and the poses over the cycle, as a PNG."""
    wide = max(len(tracked.names), len(_PANELS))
    page = new_page(3.5 * wide, 8.5)
    parts = panels(page, 2, wide, {(0, column) for column in range(len(tracked.names))})
    percent, loaded = problem.cycle.percent, problem.wanted.loaded
    failed = ~result.converged & loaded
    for column, name in enumerate(tracked.names):
        unit = quantity(name).unit
        panel, axis = parts[0, column], parts[0, column].curves
        axis.plot(percent, tracked.wanted[:, column], label="wanted", **WANTED)
        axis.plot(percent, tracked.got[:, column], label=kind, **SURROGATE)
        if tracked.ef is not None:
            axis.plot(percent, tracked.ef.teacher[:, column], label="elastic foundation", **FOUNDATION)
        axis.set(title=_TITLES.get(name, ""), ylabel=f"{name} [{unit}]")
        panel.difference(percent, tracked.got[:, column] - tracked.wanted[:, column], f"{kind} - wanted", **SURROGATE)
        if tracked.ef is not None:
            off = tracked.ef.teacher[:, column] - tracked.got[:, column]
            panel.difference(percent, off, f"EF - {kind}", **FOUNDATION)
        panel.differences.set_ylabel(f"off [{unit}]", fontsize=8)
        if result.on_model.any():
            on = result.on_model
            axis.plot(percent[on], tracked.got[on, column], label="on the contact model", **_ON_MODEL)
        if failed.any():
            axis.plot(percent[failed], tracked.got[failed, column], label="not converged", **FAILED)
    parts[0, 0].curves.legend(fontsize=8)
    parts[0, 0].differences.legend(fontsize=6)
    for place, names in enumerate(_PANELS):
        axis = parts[1, place].curves
        for name, colour, line in zip(names, (COLOURS["blue"], COLOURS["vermillion"]), ("-", "--"), strict=False):
            values = result.poses[:, POSE_NAMES.index(name)] * (-1.0 if name == "rz" else 1.0)
            label = "flexion = -rz" if name == "rz" else name
            axis.plot(percent, np.degrees(values) if name[0] == "r" else values, color=colour, ls=line, label=label)
        axis.set_ylabel("[degrees]" if names[0][0] == "r" else "[mm]")
        axis.legend(fontsize=8)
    empty = [parts[0, k] for k in range(len(tracked.names), wide)] + [parts[1, k] for k in range(len(_PANELS), wide)]
    for panel in empty:
        panel.curves.set_visible(False)
    frame((panel.lowest for panel in parts.values() if panel not in empty), "cycle [%]")
    converged = f"{int(result.converged.sum())} of {len(percent)} frames converged"
    converged += f", {int(verdict.differs.sum())} differ on the contact model" if verdict.differs.any() else ""
    converged += "" if loaded.all() else f", {int((~loaded).sum())} bear no load"
    page.suptitle(f"Pose estimation of {problem.cycle.name}: {converged}")
    save_page(page, path, dots_per_inch=110)
