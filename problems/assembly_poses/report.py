"""What the poses of an assembly come to: verdicts, a CSV of every frame, a JSON summary and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.core.quantities import FORCE
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.pictures.page import frame, new_page, panels, save_page
from casadi_contact.scenes.columns import write_columns
from problems.assembly_poses.problem import AssemblyPoses
from problems.assembly_poses.solve import AssemblyResult
from problems.common.outcome import print_outcome, solver_record
from problems.common.records import DIGITS, assembly_columns, pose_columns, write_summary


def report(
    problem: AssemblyPoses,
    result: AssemblyResult,
    verdicts: Mapping[str, Verdict],
    out: Path,
) -> None:
    """Print what became of it and write assembly_poses.csv, .png and summary.json in the folder out.

    verdicts: of each contact by name.
    """
    console = PlainConsole()
    for name, verdict in verdicts.items():
        console.print(f"{name}: {verdict}", highlight=False, soft_wrap=True)
    print_outcome(console, result)
    _write_table(out / "assembly_poses.csv", problem, result)
    summary = {
        "assembly": problem.assembly.name,
        "cycle": problem.cycle.name,
        "verdicts": {name: str(verdict) for name, verdict in verdicts.items()},
        "frames": len(result.converged),
        "converged": int(result.converged.sum()),
        "on_contact_model": int(result.on_model.sum()),
        "largest_residual_N": float(result.residual_n.max()),
        **solver_record(result),
    }
    write_summary(out / "summary.json", summary)
    draw(problem, result, out / "assembly_poses.png")
    console.print(f"results in {out}", highlight=False)


def _write_table(path: Path, problem: AssemblyPoses, result: AssemblyResult) -> None:
    columns = {"time_s": problem.cycle.time_s, "cycle_percent": problem.cycle.percent}
    for k, body in enumerate(problem.assembly.bodies):
        columns |= {f"{body}_{name}": curve for name, curve in pose_columns(result.poses[:, k]).items()}
    columns |= {f"{pull}_N": curve for pull, curve in problem.cycle.tensions.items()}
    columns |= assembly_columns(problem.assembly.load_kinds, result.loads)
    columns |= {"residual_N": result.residual_n, "converged": result.converged.astype(int)}
    columns |= {"on_contact_model": result.on_model.astype(int)}
    write_columns(path, columns, digits=DIGITS)


def draw(problem: AssemblyPoses, result: AssemblyResult, path: Path) -> None:
    """Forces of contacts, ligaments and pulls, and the bodies' poses over the cycle, as a PNG."""
    assembly, percent = problem.assembly, problem.cycle.percent
    wide = len(assembly.bodies) + 1
    page = new_page(5.0 * wide, 7.0)
    parts = panels(page, 2, wide, set())
    for (name, kind), curve in zip(assembly.load_kinds.items(), result.loads.T, strict=True):
        contact = next((part.name for part in assembly.contacts if name.startswith(f"{part.name}_")), "")
        if kind == FORCE:
            label = name.removeprefix(f"{contact}_").replace("_", " ")
            parts[int(not contact), 0].curves.plot(percent, curve, label=f"{contact} {label}".strip())
    for pull, curve in problem.cycle.tensions.items():
        parts[1, 0].curves.plot(percent, curve, ls="--", label=pull.replace("_", " "))
    parts[0, 0].curves.set(title="contact", ylabel="force on the fixed body [N]")
    parts[1, 0].curves.set(title="lines", ylabel="tension [N]")
    for k, body in enumerate(assembly.bodies):
        for i, name in enumerate(POSE_NAMES):
            values = result.poses[:, k, i]
            parts[i // 3, k + 1].curves.plot(percent, np.degrees(values) if i >= 3 else values, label=name)
        parts[0, k + 1].curves.set(title=body, ylabel="translation [mm]")
        parts[1, k + 1].curves.set(ylabel="rotation [degrees]")
    for panel in parts.values():
        panel.curves.margins(y=0.4)  # room for the legend above or below the curves
        panel.curves.legend(fontsize=6.5)
    frame((panel.lowest for panel in parts.values()), "cycle [%]")
    solved = f"{int(result.converged.sum())} of {len(percent)} frames solved"
    page.suptitle(f"{assembly.name.replace('_', ' ')}, {problem.cycle.name}: {solved}")
    save_page(page, path, dots_per_inch=110)
