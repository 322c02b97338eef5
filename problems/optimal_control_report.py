"""What optimal control says: tracking and EF errors, a CSV of every point, a JSON summary and a picture."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import POSE_NAMES, POSE_UNITS, WRENCH_NAMES, Array, load_unit
from casadi_contact.files import replacing, writable_folder
from casadi_contact.machine import machine_record
from problems.optimal_control import ControlResult, OptimalControl


def report(problem: OptimalControl, result: ControlResult, out: Path) -> None:
    """Print the table and write optimal_control.csv, .json and .png in the folder out."""
    writable_folder(out)
    scene = problem.surrogate.scene
    grids = {"fine": scene.grids["fine"], "teacher": scene.grids["teacher"]}
    columns = [scene.load_names.index(name) for name in problem.surrogate.load_names]
    ef = {name: ElasticFoundation(scene, grid)(result.poses)[:, columns] for name, grid in grids.items()}
    off = {"surrogate - wanted": result.load_error}
    off |= {f"EF {nx}×{nz} - surrogate": ef[name] - result.loads for name, (nx, nz) in grids.items()}
    console = Console()
    table = Table(title=f"Optimal control: {problem.intervals} intervals, {len(problem.times)} collocation points")
    table.add_column("RMS / max")
    for what in off:
        table.add_column(what, justify="right")
    for column, name in enumerate(problem.surrogate.load_names):
        cells = [f"{_rms(error[:, column]):.2g} / {np.abs(error[:, column]).max():.2g}" for error in off.values()]
        table.add_row(f"{name} ({load_unit(name)})", *cells)
    flexion = result.flexion_error_deg
    table.add_row("flexion (deg)", f"{_rms(flexion):.2g} / {np.abs(flexion).max():.2g}", "", "")
    console.print(table)
    console.print(
        f"IPOPT: {result.ipopt_status}, {result.iterations} iterations, {result.seconds:.2f} s with its start, "
        f"{problem.nlp['x'].numel()} variables, {problem.nlp['g'].numel()} constraints",
        highlight=False,
    )
    _write_csv(out / "optimal_control.csv", problem, result)
    summary: dict[str, Any] = {
        "intervals": problem.intervals,
        "degree": problem.degree,
        "variables": problem.nlp["x"].numel(),
        "constraints": problem.nlp["g"].numel(),
        "ipopt_status": result.ipopt_status,
        "ipopt_iterations": result.iterations,
        "seconds": result.seconds,
        "errors": {
            what: {
                name: {"rms": _rms(error[:, column]), "max": float(np.abs(error[:, column]).max())}
                for column, name in enumerate(problem.surrogate.load_names)
            }
            for what, error in off.items()
        },
        "flexion_error_deg": {"rms": _rms(flexion), "max": float(np.abs(flexion).max())},
        "machine": machine_record(),
    }
    with replacing(out / "optimal_control.json") as beside:
        beside.write_text(json.dumps(summary, indent=1, ensure_ascii=False), "utf-8")
    draw(problem, result, ef["fine"], out / "optimal_control.png")
    console.print(f"results in {out}", highlight=False)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _write_csv(path: Path, problem: OptimalControl, result: ControlResult) -> None:
    header = ["time_s", *(f"{name}_{unit}" for name, unit in zip(POSE_NAMES, POSE_UNITS, strict=True))]
    header += [f"actuator_{name}_{load_unit(name).replace('·', '')}" for name in WRENCH_NAMES]
    names = problem.surrogate.load_names
    for what in ("contact", "error"):
        header += [f"{name}_{what}_{load_unit(name).replace('·', '')}" for name in names]
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        numbers = [problem.times, result.poses, result.actuators, result.loads, result.load_error]
        writer.writerows([f"{value:.9g}" for value in row] for row in np.column_stack(numbers))


def draw(problem: OptimalControl, result: ControlResult, ef: Array, path: Path) -> None:
    """Contact loads wanted, got and on the EF, the pose, and the actuator loads found, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 7), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 4)
    time_s = problem.times
    names = problem.surrogate.load_names
    wanted = result.loads - result.load_error
    for axis, name in zip(axes[0], ("Fy_med", "Fy_lat", "Fx", "Ty"), strict=True):
        column = names.index(name)
        axis.plot(time_s, wanted[:, column], color="black", lw=4, alpha=0.25, label="wanted")
        axis.plot(time_s, result.loads[:, column], color="#0072B2", label="surrogate")
        axis.plot(time_s, ef[:, column], color="#D55E00", ls="--", label="elastic foundation")
        axis.set_title(f"contact {name} [{load_unit(name)}]")
    axes[0, 0].legend(fontsize=8)
    colours = ("#0072B2", "#D55E00", "#009E73")
    ty = POSE_NAMES.index("ty")
    shift = np.zeros(6)
    shift[ty] = np.round(result.poses[:, ty].mean())
    for axis, picked, title in ((axes[1, 0], POSE_NAMES[:3], "pose [mm]"), (axes[1, 1], POSE_NAMES[3:], "[degrees]")):
        for name, colour in zip(picked, colours, strict=True):
            column = POSE_NAMES.index(name)
            values = result.poses[:, column] - shift[column]
            label = f"{name} - {shift[column]:g}" if shift[column] else name
            if name == "rz":
                values, label = values / 10.0, "rz / 10"
            axis.plot(time_s, np.degrees(values) if name.startswith("r") else values, color=colour, label=label)
        axis.set_title(title)
        axis.legend(fontsize=8)
    for axis, picked, unit in ((axes[1, 2], WRENCH_NAMES[:3], "N"), (axes[1, 3], WRENCH_NAMES[3:], "N·mm")):
        for name, colour in zip(picked, colours, strict=True):
            axis.plot(time_s, result.actuators[:, WRENCH_NAMES.index(name)], color=colour, label=name)
        axis.set_title(f"actuators [{unit}]")
        axis.legend(fontsize=8)
    for axis in axes.ravel():
        axis.set_xlabel("time [s]")
        axis.grid(alpha=0.3)
    figure.suptitle(f"Optimal control: {result.ipopt_status}, {result.iterations} iterations")
    with replacing(path) as beside:
        figure.savefig(beside, dpi=72, format="png")
