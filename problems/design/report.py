"""What the design says: first and best dish, checked on the EF, a CSV of the frames, a JSON summary and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.contact.polar.dish_slopes import RADII
from casadi_contact.core.conventions import ANATOMY, Array
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.pictures.page import COLOURS, frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from problems.common.outcome import solver_record
from problems.common.records import DIGITS, write_summary
from problems.design.problem import LAXITY_PUSHES, Design, at_bounds
from problems.design.solve import DesignResult, DishState

ALLOWED_MPA, ALLOWED_MM = 0.1, 0.01  # how far the EF may be from the best dish's peak pressure and travels


def agrees(best: DishState, on_ef: DishState) -> bool:
    """Whether the EF, settled by itself, finds the same peak pressure and travels."""
    off = np.abs(on_ef.laxity_mm - best.laxity_mm).max()
    return bool(abs(on_ef.peak_mpa - best.peak_mpa) <= ALLOWED_MPA and off <= ALLOWED_MM)


def unsettled(checked: Mapping[str, DishState]) -> list[str]:
    """The dishes by name that do not settle on the EF, each with the first reason."""
    return [f"the {name} dish does not settle on the EF: {s.reason}" for name, s in checked.items() if s.reason]


def report(design: Design, result: DesignResult, checked: Mapping[str, DishState], out: Path) -> None:
    """Print the table and write design.csv, .json and .png in the folder out; checked: "first" and "best" on the EF."""
    console = PlainConsole()
    states = {"first": result.first, "best": result.best}
    table = Table(title=f"Dish of {design.contact.scene.name} over {design.frames} frames of walking")
    for name in ("dish", "radii (mm)", "peak (MPa)", "on the EF", "AP, ML travel (mm)", "on the EF"):
        table.add_column(name, justify="left" if name == "dish" else "right")
    for name, state in states.items():
        ef = checked[name]
        travel, travel_ef = (", ".join(map(_cell, s.laxity_mm)) for s in (state, ef))
        radii = ", ".join(f"{x:.2f}" for x in state.radii_mm)
        table.add_row(name, radii, _cell(state.peak_mpa), _cell(ef.peak_mpa), travel, travel_ef)
    console.print(table)
    same = agrees(result.best, checked["best"])
    console.print(
        f"IPOPT: {result.ipopt_status}, {result.iterations} iterations, {result.seconds:.1f} s, "
        f"{design.nlp['x'].numel()} variables; the EF {'agrees' if same else 'differs'}",
        highlight=False,
    )
    for said in unsettled(checked):
        console.print(said, highlight=False, soft_wrap=True)
    held = at_bounds(design, result.best.radii_mm)
    if held:
        said = f"the search's bounds hold {held}; the peak could be lower beyond them"
        console.print(said, highlight=False, soft_wrap=True)
    columns: dict[str, Any] = {"frame": np.arange(design.frames)}
    for name, state in states.items():
        for p, patch in enumerate(design.contact.patch_names):
            columns[f"peak_pressure_{patch}_{name}_MPa"] = state.peaks_mpa[:, p]
            columns[f"peak_pressure_{patch}_{name}_EF_MPa"] = checked[name].peaks_mpa[:, p]
    write_columns(out / "design.csv", columns, digits=DIGITS)
    summary: dict[str, Any] = {
        **_head(design, result, ""),
        "ef_agrees": same,
        "ef_unsettled": unsettled(checked),
        "at_bounds": held,
        **{name: _record(state) for name, state in states.items()},
        **{f"{name}_on_ef": _record(state) for name, state in checked.items()},
    }
    write_summary(out / "design.json", summary)
    draw(design, result, checked, out / "design.png")
    console.print(f"results in {out}", highlight=False)


def report_unsolved(design: Design, result: DesignResult, reason: str, out: Path) -> None:
    """Write design.json, with the reason, in the folder out, and remove the table and picture of an earlier dish."""
    writable_folder(out)
    for name in ("design.csv", "design.png"):
        (out / name).unlink(missing_ok=True)
    write_summary(out / "design.json", _head(design, result, reason))


def _head(design: Design, result: DesignResult, reason: str) -> dict[str, Any]:
    bounds = {"ap": design.bounds.ap_mm, "ml": design.bounds.ml_mm}
    return {"reason": reason, "bounds_mm": bounds, **solver_record(result)}


def _cell(number: float) -> str:
    return "-" if np.isnan(number) else f"{number:.3f}"


def _record(state: DishState) -> dict[str, Any]:
    return {
        **{f"{name}_mm": float(radius) for name, radius in zip(RADII, state.radii_mm, strict=True)},
        "peak_mpa": state.peak_mpa,
        **{f"{name}_travel_mm": float(x) for name, x in zip(LAXITY_PUSHES, state.laxity_mm, strict=True)},
    }


def draw(design: Design, result: DesignResult, checked: Mapping[str, DishState], path: Path) -> None:
    """Peak pressures over walking, and sections of both dishes, as a PNG."""
    page = new_page(13.0, 4.2)
    axes = page.subplots(1, 3, width_ratios=(1.3, 1.0, 1.0))
    states = {"first": result.first, "best": result.best}
    colours = {"first": COLOURS["blue"], "best": COLOURS["vermillion"]}
    percent = np.linspace(0.0, 100.0, design.frames)
    for name, state in states.items():
        for p, (patch, style) in enumerate(zip(design.contact.patch_names, ("-", "--"), strict=True)):
            axes[0].plot(percent, state.peaks_mpa[:, p], style, color=colours[name], label=f"{patch}, {name}")
            axes[0].plot(percent, checked[name].peaks_mpa[:, p], ".", color=colours[name])
    axes[0].set(title="both sides over walking (dots: elastic foundation)", ylabel="peak pressure [MPa]")
    axes[0].legend(fontsize=8)
    geometry = design.contact.scene.geometry
    for which, (plane, extent, across) in enumerate(
        (("sagittal", "plateau_length", "x"), ("frontal", "plateau_width", "z"))
    ):
        axis = axes[1 + which]
        along = np.linspace(-0.5, 0.5, 101) * geometry[extent]
        for name, state in states.items():
            axis.plot(along, _section(state.radii_mm[which], along), color=colours[name], label=name)
        axis.set(title=f"{plane} section of the dish", ylabel="height [mm]")
        axis.set_xlabel(f"{across} from the dish's middle [mm], {ANATOMY[across][0]} to the right", fontsize=8)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    frame([axes[0]], "cycle [%]")
    change = result.best.peak_mpa / result.first.peak_mpa - 1.0
    page.suptitle(
        f"Dish design: peak {result.first.peak_mpa:.1f} to {result.best.peak_mpa:.1f} MPa ({100.0 * change:+.0f} %)"
    )
    save_page(page, path, dots_per_inch=90)


def _section(radius: float, along: Array) -> Array:
    return np.asarray(radius - np.sqrt(radius**2 - along**2))
