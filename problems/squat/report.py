"""What the squat says: the trade-off as a table, CSVs of it and of every moment, a JSON summary and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.contact import ContactModel
from casadi_contact.motion.columns import write_columns
from casadi_contact.optimisation.knee import SIDES
from casadi_contact.page import COLOURS, frame, new_page, save_page
from casadi_contact.report.figure import log_scale
from casadi_contact.terminal import PlainConsole
from casadi_contact.verification import Verdict
from problems.common.outcome import print_verdict
from problems.common.records import DIGITS, load_columns, pose_columns, write_summary
from problems.squat.muscles import MUSCLES
from problems.squat.problem import SEGMENTS, Squat
from problems.squat.solve import SquatResult


def report(squat: Squat, results: Sequence[SquatResult], verdict: Verdict, fine: ContactModel | str, out: Path) -> None:
    """Print the trade-off and write squat.csv (a row for each weight), moments.csv, .json and .png in the folder out.

    verdict: on the moments of all results, one after the other; fine: the contact model it was made on.
    """
    console = PlainConsole()
    print_verdict(console, verdict)
    columns = _trade_off(squat, results, verdict)
    depth, variables = squat.depth_deg, squat.nlp["x"].numel()
    table = Table(
        title=f"Squat to {depth:g}° of knee flexion: activation against medial contact force, {variables} variables"
    )
    shown = {name: column for name, column in columns.items() if name not in ("ipopt_status", "at_bounds")}
    for name in shown:
        table.add_column(name.replace("_", " "), justify="right")
    for row in zip(*shown.values(), strict=True):
        table.add_row(*(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row))
    console.print(table)
    solved = sum(r.solved for r in results)
    console.print(
        f"{solved} of {len(results)} solved, {variables} variables, {squat.nlp['g'].numel()} constraints",
        highlight=False,
    )
    for r in results:
        if not r.solved:
            weak = f", where no force is left in {', '.join(r.exhausted)}: ask less, by --depth, --mass or --duration"
            said = f"weight {r.weight:g}: not solved, {r.ipopt_status}{weak if r.exhausted else ''}"
            console.print(said, highlight=False, soft_wrap=True)
        if r.at_bounds:
            why = ", and muscles may have no force left because of them" if r.exhausted else ""
            beyond = f"a squat may need to go beyond them{why}: give a smaller --depth"
            beyond = "the cost could be lower beyond them" if r.solved else beyond
            held = f"weight {r.weight:g}: the search's bounds hold {r.at_bounds}; {beyond}"
            console.print(held, highlight=False, soft_wrap=True)
    write_columns(out / "squat.csv", columns, digits=DIGITS)
    write_columns(out / "moments.csv", _moments(squat, results, verdict), digits=DIGITS)
    summary: dict[str, Any] = {
        "verdict": str(verdict),
        "depth_deg": depth,
        "intervals": squat.grid.intervals,
        "degree": squat.grid.degree,
        "variables": variables,
        "constraints": squat.nlp["g"].numel(),
        "weight_n": squat.mechanics.body.weight_n,
        "points": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
    }
    write_summary(out / "squat.json", summary)
    draw(squat, results, fine, out / "squat.png")
    console.print(f"results in {out}", highlight=False)


def _trade_off(squat: Squat, results: Sequence[SquatResult], verdict: Verdict) -> dict[str, Any]:
    """Columns with a row for each weight."""
    names, body = squat.model.load_names, squat.mechanics.body.weight_n
    medial, lateral = map(names.index, SIDES)
    errors = np.abs(verdict.errors[:, medial].reshape(len(results), -1)).max(axis=1)
    return {
        "weight": [r.weight for r in results],
        "mean_squared_activation": [r.effort for r in results],
        "rms_medial_BW": [r.medial_bw for r in results],
        "peak_medial_BW": [float(-r.loads[:, medial].min()) / body for r in results],
        "peak_lateral_BW": [float(-r.loads[:, lateral].min()) / body for r in results],
        "medial_off_EF_N": errors.tolist(),
        "ipopt_status": [r.ipopt_status for r in results],
        "at_bounds": [r.at_bounds for r in results],
        "iterations": [r.iterations for r in results],
        "seconds": [r.seconds for r in results],
    }


def _moments(squat: Squat, results: Sequence[SquatResult], verdict: Verdict) -> dict[str, Any]:
    """Columns with a row for each moment of each squat."""
    joined = {name: np.concatenate([getattr(r, name) for r in results]) for name in ("phi", "poses", "loads", "time_s")}
    columns: dict[str, Any] = {
        "frame": np.arange(len(verdict.words)),  # as the verdict names them
        "weight": np.concatenate([np.full(len(r.time_s), r.weight) for r in results]),
        "time_s": joined["time_s"],
        **{f"{name}_lean_deg": np.degrees(joined["phi"][:, k]) for k, name in enumerate(SEGMENTS)},
        **pose_columns(joined["poses"]),
        **load_columns(squat.model.load_names, joined["loads"], "contact"),
    }
    for what in ("activations", "muscle_forces_n"):
        values = np.concatenate([getattr(r, what) for r in results])
        unit = "activation" if what == "activations" else "N"
        columns |= {f"{name.replace(' ', '_')}_{unit}": values[:, k] for k, name in enumerate(MUSCLES)}
    return {**columns, "verdict": verdict.words}


def draw(squat: Squat, results: Sequence[SquatResult], fine: ContactModel | str, path: Path) -> None:
    """The trade-off, contact forces and muscle forces with least and largest weight, and the leg, as a PNG."""
    page = new_page(13.0, 8.0)
    axes = page.subplots(2, 2)
    body = squat.mechanics.body
    results = sorted(results, key=lambda r: r.weight)
    axes[0, 0].plot([r.effort for r in results], [r.medial_bw for r in results], "o-", color=COLOURS["blue"])
    for r in results:
        axes[0, 0].annotate(f" {r.weight:g}", (r.effort, r.medial_bw), fontsize=8)
    axes[0, 0].set(title="trade-off, by weight of the contact term")
    axes[0, 0].set(xlabel="mean squared activation [-]", ylabel="RMS medial contact force [BW]")
    log_scale(axes[0, 0], "x")
    ends = results[0], results[-1]
    colours = [COLOURS["blue"], COLOURS["vermillion"]]
    names = list(squat.model.load_names)
    for r, colour in zip(ends, colours, strict=True):
        for load, style in zip(SIDES, ("-", "--"), strict=True):
            force = -r.loads[:, names.index(load)] / body.weight_n
            axes[0, 1].plot(r.time_s, force, style, color=colour, label=f"{load}, weight {r.weight:g}")
        if not isinstance(fine, str):
            checked = -fine(r.poses)[:, list(fine.load_names).index("Fy_med")] / body.weight_n
            axes[0, 1].plot(r.time_s, checked, ".", color=colour, ms=3, label="Fy_med on the EF")
    axes[0, 1].set(title="contact forces", ylabel="compression [BW]")
    places, width = np.arange(len(MUSCLES)), 0.4
    for k, (r, colour) in enumerate(zip(ends, colours, strict=True)):
        bars = r.muscle_forces_n.max(axis=0) / body.weight_n
        axes[1, 0].bar(places + (k - 0.5) * width, bars, width, color=colour, label=f"weight {r.weight:g}")
    axes[1, 0].set_xticks(places, list(MUSCLES), rotation=40, ha="right", fontsize=8)
    axes[1, 0].set(title="largest muscle forces", ylabel="force [BW]")
    for r, colour in zip(ends, colours, strict=True):
        deepest = int(r.poses[:, 5].argmin())
        for moment, alpha in ((0, 0.35), (deepest, 1.0)):
            x = np.concatenate([[0.0], np.cumsum(body.lengths_m * np.sin(r.phi[moment]))])
            y = body.ankle_height_m + np.concatenate([[0.0], np.cumsum(body.lengths_m * np.cos(r.phi[moment]))])
            axes[1, 1].plot(x, y, "o-", lw=3, color=colour, alpha=alpha)
    axes[1, 1].plot([body.heel_m, 0.0, body.toe_m], [0.0, body.ankle_height_m, 0.0], color="0.3", lw=3)
    axes[1, 1].set(title="standing (pale), and deepest", aspect="equal", xlabel="forward [m]", ylabel="up [m]")
    frame([axes[0, 1]], "time [s]")
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    for axis in (axes[0, 1], axes[1, 0]):
        axis.legend(fontsize=8)
    page.suptitle("A squat with contact in the cost")
    save_page(page, path, dots_per_inch=80)
