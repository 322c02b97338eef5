"""What settling says: a table, a CSV of every row, a JSON summary and a picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, Array
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.quantities import two_digits
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.joint_mechanics import total_selection
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.pictures.page import COLOURS, frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from problems.common.contact import grids_in_words, models_on_grids
from problems.common.outcome import print_outcome, print_verdict, solver_record
from problems.common.records import DIGITS, add_to_summary, load_columns, pose_columns, write_summary
from problems.static_equilibrium.on_model import on_model
from problems.static_equilibrium.problem import StaticEquilibrium
from problems.static_equilibrium.solve import EquilibriumResult
from problems.static_equilibrium.starts import LiftedStarts


def report(
    problem: StaticEquilibrium,
    result: EquilibriumResult,
    verdict: Verdict,
    out: Path,
    kind: str = "surrogate",
) -> None:
    """Print the table and write static_equilibrium.csv, .json and .png in the folder out; kind: what to call
    the model there. All torques are about the origin that the problem's loads are about."""
    writable_folder(out)
    scene = problem.model.scene
    foundations = models_on_grids(scene)
    grids = grids_in_words(foundations)
    total = total_selection(scene.load_names, scene.patch_names).T
    result = replace(result, wrenches=_about(problem, result.poses, result.wrenches))
    ef = {
        name: _about(problem, result.poses, foundation(result.poses) @ total)
        for name, foundation in foundations.items()
    }
    ef_poses = {name: on_model(problem, result, foundation) for name, foundation in foundations.items()}
    console = PlainConsole()
    print_verdict(console, verdict)
    console.print(_poses_table(problem, result))
    print_outcome(console, result, "in equilibrium", "row")
    solved = result.converged
    off = {name: np.abs(wrench - result.wrenches)[solved].max(axis=0) for name, wrench in ef.items() if solved.any()}
    moved = {name: _largest(poses - result.poses) for name, poses in ef_poses.items()}
    found = {name: int(np.isfinite(poses[:, 0]).sum()) for name, poses in ef_poses.items()}
    for name, largest in off.items():
        console.print(f"EF {grids[name]} - {kind}, {_difference(largest, moved[name], found[name])}", highlight=False)
    _write_table(out / "static_equilibrium.csv", problem, result, ef.get("fine"), verdict)
    summary = {
        "verdict": str(verdict),
        "free": problem.free,
        "about": problem.about,
        "rows": len(result.poses),
        "converged": int(result.converged.sum()),
        "verified": int(verdict.verified.sum()),
        **solver_record(result),
        "ef_off_max": {name: dict(zip(WRENCH_NAMES, m.tolist(), strict=True)) for name, m in off.items()},
        "ef_pose_off_max": {name: dict(zip(POSE_NAMES, m.tolist(), strict=True)) for name, m in moved.items()},
        "ef_rows_with_equilibrium": found,
    }
    write_summary(out / "static_equilibrium.json", summary)
    draw(result, ef_poses.get("fine"), ef.get("fine"), kind, out / "static_equilibrium.png")
    console.print(f"results in {out}", highlight=False)


def report_starts(starts: LiftedStarts, out: Path) -> None:
    """Print what became of lifted starts about a solution, and add it to the summary in the folder out."""
    PlainConsole().print(str(starts), highlight=False)
    add_to_summary(out / "static_equilibrium.json", {"random_starts": starts.record()})


def _difference(wrench: Array, moved: Array, found: int) -> str:
    """Largest difference (6,) of the EF's wrench [N, N·mm], and how far [mm, rad] its own equilibrium lies (6,) in the
    rows in which it was found."""
    force, torque = two_digits(wrench[:3].max()), two_digits(wrench[3:].max())
    millimetres, degrees = moved[:3].max(), np.degrees(moved[3:].max())
    place = (
        f", found in {found} rows, lies {millimetres:.2g} mm, {degrees:.2g}° away" if found else " was found in no row"
    )
    return f"largest: force {force} N, torque {torque} N·mm; its own equilibrium{place}"


def _poses_table(problem: StaticEquilibrium, result: EquilibriumResult) -> Table:
    """A row for each pose, and how far its loads are off balance."""
    table = Table(title=f"Settling under six loads about the {problem.about} origin, free: {' '.join(problem.free)}")
    table.add_column("flexion [deg]", justify="right")
    names = [name for name in problem.free if name != "rz"]
    for name in names:
        table.add_column(f"{name} [{'deg' if name.startswith('r') else 'mm'}]", justify="right")
    table.add_column("misfit [N]", justify="right")
    for pose, misfit in zip(result.poses, result.misfit_n, strict=True):
        shown = np.concatenate([pose[:3], np.degrees(pose[3:])])
        cells = [f"{shown[POSE_NAMES.index(name)]:.4f}" for name in names]
        table.add_row(f"{-shown[5]:.1f}", *cells, f"{np.abs(misfit).max():.1e}")
    return table


def _about(problem: StaticEquilibrium, poses: Array, wrenches: Array) -> Array:
    """Wrenches (n, 6) about the fixed origin, at poses (n, 6), about the origin of the problem's loads."""
    if problem.about == "fixed":
        return wrenches
    shift = np.cross(poses[:, :3], wrenches[:, :3])
    return np.column_stack([wrenches[:, :3], wrenches[:, 3:] - shift])


def _largest(moves: Array) -> Array:
    """Largest size (6,) over the rows of moves (n, 6) that hold numbers; NaN where none does."""
    known = np.abs(moves[np.isfinite(moves).all(axis=1)])
    return known.max(axis=0) if len(known) else np.full(moves.shape[1], np.nan)


def _write_table(
    path: Path, problem: StaticEquilibrium, result: EquilibriumResult, ef: Array | None, verdict: Verdict
) -> None:
    columns: dict[str, Any] = {"row": range(len(result.poses)), **pose_columns(result.poses)}
    for what, wrenches in (("wanted", problem.loads), ("contact", result.wrenches), ("ef", ef)):
        if wrenches is not None:
            columns |= load_columns(WRENCH_NAMES, wrenches, what)
    columns |= {"converged": result.converged.astype(int), "reason": result.reason, "verdict": verdict.words}
    write_columns(path, columns, digits=DIGITS)


def draw(result: EquilibriumResult, ef_poses: Array | None, ef: Array | None, kind: str, path: Path) -> None:
    """The settled poses over flexion, and where there is an EF its own, and what it says of the loads there, as a
    PNG."""
    page = new_page(13.0, 3.6)
    axes = page.subplots(1, 2 if ef is None else 4)
    flexion = np.degrees(-result.poses[:, POSE_NAMES.index("rz")])
    colours = [COLOURS[name] for name in ("blue", "vermillion", "green")]
    low_ty = np.floor(result.poses[:, POSE_NAMES.index("ty")].min())
    for axis, names, title in ((axes[0], POSE_NAMES[:3], "pose [mm]"), (axes[1], POSE_NAMES[3:5], "pose [degrees]")):
        for name, colour in zip(names, colours, strict=False):
            column = POSE_NAMES.index(name)
            shift, scale = (low_ty if name == "ty" else 0.0), (180.0 / np.pi if name.startswith("r") else 1.0)
            label = f"{name} - {shift:g}" if shift else name
            axis.plot(flexion, scale * (result.poses[:, column] - shift), "-", color=colour, label=label)
            if ef_poses is not None:
                axis.plot(flexion, scale * (ef_poses[:, column] - shift), "x", color=colour, label=f"{label}, EF")
        axis.set_ylabel(title)
        axis.legend(fontsize=7)
    if ef is not None:
        off = ef - result.wrenches
        for axis, first, title in ((axes[2], 0, "force [N]"), (axes[3], 3, "torque [N·mm]")):
            for column, colour in enumerate(colours, start=first):
                axis.plot(flexion, off[:, column], "o-", ms=3, color=colour, label=WRENCH_NAMES[column])
            axis.set_ylabel(f"EF - {kind}, {title}")
            axis.legend(fontsize=7)
    frame(axes, "flexion = -rz [degrees]")
    page.suptitle(f"Settling: {int(result.converged.sum())} of {len(flexion)} poses in equilibrium")
    save_page(page, path, dots_per_inch=80)
