"""What pose estimation says: a table, a CSV of every frame, a JSON summary and a picture."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import POSE_NAMES, POSE_UNITS, Array
from casadi_contact.files import replacing, writable_folder
from casadi_contact.machine import machine_record
from casadi_contact.motion.opensim import poses_table, write_table
from problems.pose_estimation import LOADS, PoseEstimation, PoseResult, cop
from problems.pose_estimation_starts import StartReport

QUANTITIES = ("Fy_med", "Fy_lat", "cop_ap", "cop_ml")
UNITS = ("N", "N", "mm", "mm")
COMPARISONS = ("tracking", "fine_ef", "teacher_ef")


@dataclass(frozen=True)
class Tracked:
    """Values of `QUANTITIES`, each (n, 4): wanted, got (surrogate), on the fine EF grid, and on the teacher grid,
    which has next to no error of its own."""

    wanted: Array
    got: Array
    ef: Array
    teacher: Array

    @classmethod
    def of(cls, problem: PoseEstimation, result: PoseResult) -> Tracked:
        """Re-evaluate the solution on the scene's fine and teacher EF grids."""
        cycle, scene = problem.cycle, problem.surrogate.scene
        wanted = np.column_stack([cycle.fy_med, cycle.fy_lat, cycle.cop_ap_mm, cycle.cop_ml_mm])
        columns = [scene.load_names.index(name) for name in LOADS]
        grids = [ElasticFoundation(scene, scene.grids[grid])(result.poses)[:, columns] for grid in ("fine", "teacher")]
        return cls(wanted, *(np.column_stack([loads[:, :2], cop(loads)]) for loads in (result.loads, *grids)))


def report(problem: PoseEstimation, result: PoseResult, out: Path, starts: StartReport | None = None) -> None:
    """Print the table and write pose_estimation.csv, poses.sto (OpenSim), summary.json and .png in the folder out."""
    writable_folder(out)
    tracked = Tracked.of(problem, result)
    grids = {name: "×".join(map(str, problem.surrogate.scene.grids[name])) for name in ("fine", "teacher")}
    console = Console()
    table = Table(title=f"Pose estimation, {problem.cycle.name}: {len(problem.cycle)} frames")
    table.add_column("RMS / max")
    for column in ("surrogate - wanted", f"EF {grids['fine']} - surrogate", f"EF {grids['teacher']} - surrogate"):
        table.add_column(column, justify="right")
    errors = _errors(tracked)
    for name, unit in zip(QUANTITIES, UNITS, strict=True):
        cells = [f"{errors[name][key]['rms']:.2g} / {errors[name][key]['max']:.2g}" for key in COMPARISONS]
        table.add_row(f"{name} ({unit})", *cells)
    console.print(table)
    frames = len(problem.cycle)
    console.print(
        f"{int(result.converged.sum())} of {frames} frames converged; IPOPT: {result.ipopt_status}, "
        f"{result.iterations} iterations, {result.seconds:.2f} s with its start",
        highlight=False,
    )
    for frame in np.flatnonzero(~result.converged):
        console.print(f"frame {frame}: {result.reason[frame]}", highlight=False)
    if starts is not None:
        console.print(str(starts), highlight=False)
    _write_csv(out / "pose_estimation.csv", problem, result, tracked)
    write_table(poses_table(problem.cycle.time_s, result.poses, f"{problem.cycle.name} poses"), out / "poses.sto")
    summary: dict[str, Any] = {
        "cycle": problem.cycle.name,
        "frames": frames,
        "converged": int(result.converged.sum()),
        "ipopt_status": result.ipopt_status,
        "ipopt_iterations": result.iterations,
        "seconds": result.seconds,
        "errors": errors,
        "ef_grids": grids,
        "structure": problem.surrogate.structure,
        "scene": problem.surrogate.scene.name,
        "machine": machine_record(),
    }
    if starts is not None:
        summary["random_starts"] = {
            "count": len(starts.reached),
            "reached": int(starts.reached.sum()),
            "share_of_frames": float(starts.frames_reached.mean()),
            "median_iterations": float(np.median(starts.iterations)),
        }
    with replacing(out / "summary.json") as beside:
        beside.write_text(json.dumps(summary, indent=1), "utf-8")
    draw(problem, result, tracked, out / "pose_estimation.png")
    console.print(f"results in {out}", highlight=False)


def _errors(tracked: Tracked) -> dict[str, dict[str, dict[str, float]]]:
    """RMS and largest difference by quantity: surrogate - wanted, fine EF - surrogate, teacher EF - surrogate."""
    pairs = zip(
        COMPARISONS,
        (tracked.got - tracked.wanted, tracked.ef - tracked.got, tracked.teacher - tracked.got),
        strict=True,
    )
    errors: dict[str, dict[str, dict[str, float]]] = {name: {} for name in QUANTITIES}
    for key, off in pairs:
        for name, column in zip(QUANTITIES, off.T, strict=True):
            errors[name][key] = {"rms": float(np.sqrt(np.mean(column**2))), "max": float(np.abs(column).max())}
    return errors


def _write_csv(path: Path, problem: PoseEstimation, result: PoseResult, tracked: Tracked) -> None:
    header = ["frame", "time_s", "cycle_percent"]
    header += [f"{name}_{unit}" for name, unit in zip(POSE_NAMES, POSE_UNITS, strict=True)]
    for what in ("wanted", "got", "ef"):
        header += [f"{name}_{what}_{unit}" for name, unit in zip(QUANTITIES, UNITS, strict=True)]
    header += ["converged", "reason"]
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        numbers = [problem.cycle.time_s[:, None], problem.cycle.percent[:, None], result.poses]
        numbers += [tracked.wanted, tracked.got, tracked.ef]
        for frame, row in enumerate(np.column_stack(numbers)):
            writer.writerow([frame, *(f"{v:.9g}" for v in row), int(result.converged[frame]), result.reason[frame]])


def draw(problem: PoseEstimation, result: PoseResult, tracked: Tracked, path: Path) -> None:
    """Forces and centres of pressure (wanted, got, EF) and the poses over the cycle, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 4)
    percent = problem.cycle.percent
    for axis, column in zip(axes[0], range(4), strict=True):
        axis.plot(percent, tracked.wanted[:, column], color="black", lw=4, alpha=0.25, label="wanted")
        axis.plot(percent, tracked.got[:, column], color="#0072B2", lw=1.6, label="surrogate")
        axis.plot(percent, tracked.ef[:, column], color="#D55E00", lw=1.2, ls="--", label="elastic foundation")
        axis.set_title(f"{QUANTITIES[column]} [{UNITS[column]}]")
        failed = ~result.converged
        if failed.any():
            axis.plot(percent[failed], tracked.got[failed, column], "x", color="#CC79A7", label="not converged")
    axes[0, 0].legend(fontsize=8)
    panels = ((("tx", "tz"), 0), (("ty",), 1), (("rx", "ry"), 2), (("rz",), 3))
    styles = (("#0072B2", "-"), ("#D55E00", "--"))
    for names, place in panels:
        axis = axes[1, place]
        for name, (color, line) in zip(names, styles, strict=False):
            values = result.poses[:, POSE_NAMES.index(name)]
            turn = name.startswith("r")
            axis.plot(percent, np.degrees(values) if turn else values, color=color, ls=line, label=name)
        axis.set_title(f"{', '.join(names)} [{'degrees' if names[0].startswith('r') else 'mm'}]")
        axis.legend(fontsize=8)
    for axis in axes.ravel():
        axis.set_xlabel("cycle [%]")
        axis.grid(alpha=0.3)
    converged = f"{int(result.converged.sum())} of {len(percent)} frames converged"
    figure.suptitle(f"Pose estimation of {problem.cycle.name}: {converged}")
    with replacing(path) as beside:
        figure.savefig(beside, dpi=110, format="png")
