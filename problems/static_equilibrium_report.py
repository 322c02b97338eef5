"""What settling says: a table, a CSV of every row, a JSON summary, a picture, and how many random starts end there."""

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
from casadi_contact.conventions import POSE_NAMES, POSE_UNITS, WRENCH_NAMES, Array, load_unit
from casadi_contact.files import replacing, writable_folder
from casadi_contact.machine import machine_record
from problems.foundation_callback import total_selection
from problems.joint_mechanics import IN_MM
from problems.static_equilibrium import EquilibriumResult, StaticEquilibrium, on_model, solve

LIFTS_MM = (0.5, 2.0, 5.0, 20.0, -0.5, -2.0, -5.0)  # starts out of contact, and too deep
SAME_MM = 0.01  # rotations over 25 mm


@dataclass(frozen=True)
class StartReport:
    """For each lift of `LIFTS_MM`: share of rows (lifts,) that end at the same pose, and median IPOPT iterations."""

    count: int
    shares: Array
    iterations: Array

    def __str__(self) -> str:
        parts = [
            f"{lift:+g} mm: {100 * share:.1f} % ({iterations:.0f} iterations)"
            for lift, share, iterations in zip(LIFTS_MM, self.shares, self.iterations, strict=True)
        ]
        return f"{self.count} random starts that end at the same poses, lifted by up to " + ", ".join(parts)


def random_starts(
    problem: StaticEquilibrium, result: EquilibriumResult, count: int, lifts_mm: tuple[float, ...] = LIFTS_MM
) -> StartReport:
    """Solve again, in turn for every lift, from poses moved by up to the lift along ty, 4 mm along tx and 1 mm along
    tz, and 0.05 rad (rx) and 0.1 rad (ry)."""
    rng = np.random.default_rng(7)
    shares, iterations = [], []
    for lift in lifts_mm:
        same, used = [], []
        for _ in range(count):
            moves = rng.uniform(-1.0, 1.0, result.poses.shape) * [4.0, 0.0, 1.0, 0.05, 0.1, 0.0]
            moves[:, 1] = lift * rng.uniform(0.0, 1.0, len(moves))
            again = solve(problem, result.poses + moves)
            same.append((np.abs((again.poses - result.poses) * IN_MM).max(axis=1) < SAME_MM).mean())
            used.append(again.iterations)
        shares.append(float(np.mean(same)))
        iterations.append(float(np.median(used)))
    return StartReport(count, np.array(shares), np.array(iterations))


def report(problem: StaticEquilibrium, result: EquilibriumResult, out: Path, starts: StartReport | None = None) -> None:
    """Print the table and write static_equilibrium.csv, .json and .png in the folder out."""
    writable_folder(out)
    scene = problem.surrogate.scene
    grids = {name: scene.grids[name] for name in ("fine", "teacher")}
    foundations = {name: ElasticFoundation(scene, grid) for name, grid in grids.items()}
    ef = {
        name: foundation(result.poses) @ total_selection(scene.load_names).T for name, foundation in foundations.items()
    }
    ef_poses = {name: on_model(problem, result, foundation) for name, foundation in foundations.items()}
    console = Console()
    table = Table(title=f"Settling under six loads about the {problem.about} origin, free: {' '.join(problem.free)}")
    table.add_column("flexion [deg]", justify="right")
    shown_names = [name for name in problem.free if name != "rz"]
    for name in shown_names:
        table.add_column(f"{name} [{'deg' if name.startswith('r') else 'mm'}]", justify="right")
    table.add_column("misfit [N]", justify="right")
    for pose, misfit in zip(result.poses, result.misfit_n, strict=True):
        shown = np.concatenate([pose[:3], np.degrees(pose[3:])])
        cells = [f"{shown[POSE_NAMES.index(name)]:.4f}" for name in shown_names]
        table.add_row(f"{-shown[5]:.1f}", *cells, f"{np.abs(misfit).max():.1e}")
    console.print(table)
    console.print(
        f"{int(result.converged.sum())} of {len(result.poses)} in equilibrium; IPOPT: {result.ipopt_status}, "
        f"{result.iterations} iterations, {result.seconds:.2f} s with its start",
        highlight=False,
    )
    for row in np.flatnonzero(~result.converged):
        console.print(f"row {row}: {result.reason[row]}", highlight=False)
    off = {name: np.abs(wrench - result.wrenches) for name, wrench in ef.items()}
    moved = {name: _largest(poses - result.poses) for name, poses in ef_poses.items()}
    for name, difference in off.items():
        found = int(np.isfinite(ef_poses[name][:, 0]).sum())
        console.print(
            f"EF {grids[name][0]}×{grids[name][1]} - surrogate, largest: force {difference[:, :3].max():.2g} N, "
            f"torque {difference[:, 3:].max():.2g} N·mm; its own equilibrium, found in {found} rows, lies "
            f"{moved[name][:3].max():.2g} mm, {np.degrees(moved[name][3:].max()):.2g}° away",
            highlight=False,
        )
    if starts is not None:
        console.print(str(starts), highlight=False)
    _write_csv(out / "static_equilibrium.csv", problem, result, ef["fine"])
    summary: dict[str, Any] = {
        "free": problem.free,
        "about": problem.about,
        "rows": len(result.poses),
        "converged": int(result.converged.sum()),
        "ipopt_status": result.ipopt_status,
        "ipopt_iterations": result.iterations,
        "seconds": result.seconds,
        "ef_off_max": {
            name: dict(zip(WRENCH_NAMES, difference.max(axis=0).tolist(), strict=True))
            for name, difference in off.items()
        },
        "ef_pose_off_max": {name: dict(zip(POSE_NAMES, m.tolist(), strict=True)) for name, m in moved.items()},
        "machine": machine_record(),
    }
    if starts is not None:
        summary["random_starts"] = {
            "count": starts.count,
            "lifts_mm": LIFTS_MM,
            "shares": starts.shares.tolist(),
            "median_iterations": starts.iterations.tolist(),
        }
    with replacing(out / "static_equilibrium.json") as beside:
        beside.write_text(json.dumps(summary, indent=1), "utf-8")
    draw(result, ef_poses["fine"], ef["fine"], out / "static_equilibrium.png")
    console.print(f"results in {out}", highlight=False)


def _largest(moves: Array) -> Array:
    """Largest size (6,) over the rows that hold numbers, 0 where none does."""
    return np.abs(np.nan_to_num(moves)).max(axis=0)


def _write_csv(path: Path, problem: StaticEquilibrium, result: EquilibriumResult, ef: Array) -> None:
    header = ["row", *(f"{name}_{unit}" for name, unit in zip(POSE_NAMES, POSE_UNITS, strict=True))]
    for what in ("wanted", "contact", "ef"):
        header += [f"{name}_{what}_{load_unit(name).replace('·', '')}" for name in WRENCH_NAMES]
    header += ["converged", "reason"]
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for row, numbers in enumerate(np.column_stack([result.poses, problem.loads, result.wrenches, ef])):
            writer.writerow([row, *(f"{v:.9g}" for v in numbers), int(result.converged[row]), result.reason[row]])


def draw(result: EquilibriumResult, ef_poses: Array, ef: Array, path: Path) -> None:
    """The settled poses over flexion and the EF's own; and what the EF says of the loads there, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 4)
    flexion = np.degrees(-result.poses[:, POSE_NAMES.index("rz")])
    colours = ("#0072B2", "#D55E00", "#009E73")
    low_ty = np.floor(result.poses[:, POSE_NAMES.index("ty")].min())
    for axis, names, title in ((axes[0], POSE_NAMES[:3], "pose [mm]"), (axes[1], POSE_NAMES[3:5], "pose [degrees]")):
        for name, colour in zip(names, colours, strict=False):
            column = POSE_NAMES.index(name)
            shift, scale = (low_ty if name == "ty" else 0.0), (180.0 / np.pi if name.startswith("r") else 1.0)
            label = f"{name} - {shift:g}" if shift else name
            axis.plot(flexion, scale * (result.poses[:, column] - shift), "-", color=colour, label=label)
            axis.plot(flexion, scale * (ef_poses[:, column] - shift), "x", color=colour, label=f"{label}, EF")
        axis.set_title(title)
    off = ef - result.wrenches
    for axis, names, title in ((axes[2], WRENCH_NAMES[:3], "force [N]"), (axes[3], WRENCH_NAMES[3:], "torque [N·mm]")):
        for name, colour in zip(names, colours, strict=True):
            axis.plot(flexion, off[:, WRENCH_NAMES.index(name)], "o-", ms=3, color=colour, label=name)
        axis.set_title(f"EF - surrogate, {title}")
    for axis in axes:
        axis.set_xlabel("flexion [degrees]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    figure.suptitle(f"Settling: {int(result.converged.sum())} of {len(flexion)} poses in equilibrium")
    with replacing(path) as beside:
        figure.savefig(beside, dpi=80, format="png")
