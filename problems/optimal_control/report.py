"""What optimal control says: tracking and EF errors, a CSV of every point, a JSON summary and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.conventions import POSE_NAMES, WRENCH_NAMES, Array, load_unit
from casadi_contact.files import writable_folder
from casadi_contact.motion.columns import write_columns
from casadi_contact.page import COLOURS, FOUNDATION, SURROGATE, WANTED, frame, new_page, panels, save_page
from casadi_contact.quantities import two_digits
from casadi_contact.terminal import PlainConsole
from casadi_contact.verification import Verdict
from problems.common.contact import grids_in_words, models_on_grids
from problems.common.learned_range import reasons
from problems.common.outcome import ended_in_words, print_reasons, print_verdict, solver_record
from problems.common.records import (
    DIGITS,
    load_columns,
    pose_columns,
    rms_and_largest,
    rms_and_largest_words,
    write_summary,
)
from problems.optimal_control.forward import forward_load_errors
from problems.optimal_control.problem import OptimalControl
from problems.optimal_control.solve import ControlResult


def report(
    problem: OptimalControl,
    result: ControlResult,
    verdict: Verdict,
    out: Path,
    kind: str = "surrogate",
    forward: Array | None = None,
    unsolved: str = "",
) -> None:
    """Print the table and write optimal_control.csv, .json and .png in the folder out; kind: what to call the model;
    forward: poses (points, 6) of `forward_poses`; unsolved: why it is no answer, "" where it is."""
    writable_folder(out)
    scene = problem.model.scene
    models = models_on_grids(scene)
    columns = [scene.load_names.index(name) for name in problem.model.load_names]
    ef = {name: foundation(result.poses)[:, columns] for name, foundation in models.items()}
    off = {f"{kind} - wanted": result.load_error}
    off |= {f"EF {grid} - {kind}": ef[name] - result.loads for name, grid in grids_in_words(models).items()}
    console = PlainConsole()
    print_verdict(console, verdict)
    held = _held_errors(problem, result)
    console.print(_table(problem, off, held))
    console.print(
        f"IPOPT: {result.ipopt_status}, {result.iterations} iterations, {result.seconds:.2f} s with its start, "
        f"{problem.nlp['x'].numel()} variables, {problem.nlp['g'].numel()} constraints",
        highlight=False,
    )
    moved = {} if forward is None else _forward_errors(result, forward)
    strayed = {} if forward is None else forward_load_errors(problem, result, forward)
    said = _forward_text(moved, strayed)
    console.print(f"forward in time under these actuators: {said}", highlight=False, soft_wrap=True)
    reason = reasons(problem.model, result.poses, verdict)
    print_reasons(console, reason, "point")
    _write_table(out / "optimal_control.csv", problem, result, verdict, reason)
    summary: dict[str, Any] = {
        "verdict": str(verdict),
        "reason": unsolved,
        "intervals": problem.intervals,
        "degree": problem.degree,
        "variables": problem.nlp["x"].numel(),
        "constraints": problem.nlp["g"].numel(),
        **solver_record(result),
        "errors": {
            what: {name: rms_and_largest(error[:, column]) for column, name in enumerate(problem.model.load_names)}
            for what, error in off.items()
        },
        "held_errors": {what: rms_and_largest(error) for what, error in held.items()},
        "forward_largest_error": moved,
        "forward_rms_load_error": strayed,
    }
    write_summary(out / "optimal_control.json", summary)
    draw(problem, result, ef.get("fine"), kind, out / "optimal_control.png")
    console.print(f"results in {out}", highlight=False)


def _table(problem: OptimalControl, off: Mapping[str, Array], held: Mapping[str, Array]) -> Table:
    """Errors of the loads (n, L) and of what is held (n,), by what they are of."""
    table = Table(title=f"Optimal control: {problem.intervals} intervals, {len(problem.times)} collocation points")
    table.add_column("RMS / max")
    for what in off:
        table.add_column(what, justify="right")
    for column, name in enumerate(problem.model.load_names):
        cells = [_rms_and_largest(error[:, column]) for error in off.values()]
        table.add_row(f"{name} ({load_unit(name)})", *cells)
    for what, error in held.items():
        table.add_row(what, _rms_and_largest(error))
    return table


def _forward_text(moved: Mapping[str, float], strayed: Mapping[str, float]) -> str:
    if not moved:
        return "not simulated: not solved, or the integrator gave up"
    largest = " and ".join(f"{most:.2g} {unit}" for unit, most in moved.items())
    loads = ", ".join(f"{name} {two_digits(error)} {load_unit(name)}" for name, error in strayed.items())
    return f"poses off by {largest} at most; loads off (RMS): {loads}"


def _forward_errors(result: ControlResult, forward: Array) -> dict[str, float]:
    """Largest difference of poses by unit."""
    off = np.abs(forward - result.poses)
    return {"mm": float(off[:, :3].max()), "deg": float(np.degrees(off[:, 3:].max()))}


def _held_errors(problem: OptimalControl, result: ControlResult) -> dict[str, Array]:
    """Errors (points,) of what is held, by name and unit: mm, and angles in degrees."""
    return {
        f"{name} (deg)" if name.startswith("r") else f"{name} (mm)": np.degrees(error)
        if name.startswith("r")
        else error
        for name, error in zip(problem.wanted.held, result.held_error.T, strict=True)
    }


def _rms_and_largest(errors: Array) -> str:
    return rms_and_largest_words(rms_and_largest(errors))


def _write_table(
    path: Path, problem: OptimalControl, result: ControlResult, verdict: Verdict, reason: np.ndarray
) -> None:
    names = problem.model.load_names
    columns: dict[str, Any] = {"time_s": problem.times, **pose_columns(result.poses)}
    columns |= {f"actuator_{name}": column for name, column in load_columns(WRENCH_NAMES, result.actuators).items()}
    columns |= load_columns(names, result.loads, "contact") | load_columns(names, result.load_error, "error")
    write_columns(path, {**columns, "reason": reason, "verdict": verdict.words}, digits=DIGITS)


def draw(problem: OptimalControl, result: ControlResult, ef: Array | None, kind: str, path: Path) -> None:
    """Contact loads wanted, got and on the EF where there is one, the pose, and the actuator loads found, as a PNG."""
    page = new_page(14.0, 8.5)
    parts = panels(page, 2, 4, {(0, column) for column in range(4)})
    time_s = problem.times
    names = problem.model.load_names
    wanted = result.loads - result.load_error
    pressing = [name for name in problem.model.scene.sensitive_loads if name in names]
    shown = [*pressing, *(name for name in names if name not in pressing)][:4]
    for place, name in enumerate(shown):
        panel, axis, column = parts[0, place], parts[0, place].curves, names.index(name)
        axis.plot(time_s, wanted[:, column], label="wanted", **WANTED)
        axis.plot(time_s, result.loads[:, column], label=kind, **SURROGATE)
        if ef is not None:
            axis.plot(time_s, ef[:, column], label="elastic foundation", **FOUNDATION)
        axis.set(title=f"contact {name}", ylabel=f"{name} [{load_unit(name)}]")
        panel.difference(time_s, result.loads[:, column] - wanted[:, column], f"{kind} - wanted", **SURROGATE)
        if ef is not None:
            panel.difference(time_s, ef[:, column] - result.loads[:, column], f"EF - {kind}", **FOUNDATION)
        panel.differences.set_ylabel(f"off [{load_unit(name)}]", fontsize=8)
    parts[0, 0].curves.legend(fontsize=8)
    parts[0, 0].differences.legend(fontsize=6)
    axes = {place: panel.curves for place, panel in parts.items()}
    colours = [COLOURS[name] for name in ("blue", "vermillion", "green")]
    shift = np.round(result.poses.mean(axis=0))
    shift[3:] = 0.0
    for axis, picked, title in ((axes[1, 0], POSE_NAMES[:3], "[mm]"), (axes[1, 1], POSE_NAMES[3:], "[degrees]")):
        for name, colour in zip(picked, colours, strict=True):
            column = POSE_NAMES.index(name)
            values = result.poses[:, column] - shift[column]
            label = f"{name} {-shift[column]:+g}" if shift[column] else name
            axis.plot(time_s, np.degrees(values) if name.startswith("r") else values, color=colour, label=label)
        axis.set(title="pose", ylabel=title)
        axis.legend(fontsize=8)
    for axis, picked, unit in ((axes[1, 2], WRENCH_NAMES[:3], "N"), (axes[1, 3], WRENCH_NAMES[3:], "N·mm")):
        for name, colour in zip(picked, colours, strict=True):
            axis.plot(time_s, result.actuators[:, WRENCH_NAMES.index(name)], color=colour, label=name)
        axis.set(title="actuators", ylabel=f"[{unit}]")
        axis.legend(fontsize=8)
    frame((panel.lowest for panel in parts.values()), "time [s]")
    page.suptitle(f"Optimal control: {ended_in_words(result)}")
    save_page(page, path, dots_per_inch=72)
