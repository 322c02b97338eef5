"""What calibration says: estimates with their uncertainty, a CSV, a JSON summary and a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.contact.parameters import PLACEMENT
from casadi_contact.core.conventions import load_unit
from casadi_contact.core.quantities import quantity
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.verification.verdict import Verdict, judge, own_model
from casadi_contact.pictures.page import COLOURS, frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from problems.calibration.measurement import in_fixed_body
from problems.calibration.problem import Calibration
from problems.calibration.solve import CalibrationResult
from problems.calibration.uncertainty import degrees_of_freedom
from problems.common.outcome import ended_in_words, solver_record
from problems.common.records import DIGITS, add_to_summary, rms_and_largest, write_summary

_SAME = 1e-3  # standard deviations: starts that end closer together found the same estimate
_MATERIAL_UNITS = {"youngs_modulus": "MPa", "poissons_ratio": "-", "thickness": "mm"}
WANTED_SHARE = 0.01


def unit_of(parameter: str) -> str:
    """MPa, -, mm or rad."""
    return _MATERIAL_UNITS.get(parameter) or quantity(parameter.removeprefix("fixed_")).unit


def same_estimate(result: CalibrationResult, other: CalibrationResult) -> bool:
    """Whether another start found the same identifiable parameters."""
    known = result.uncertainty.identifiable
    away = np.abs(other.values - result.values)[known] / result.uncertainty.deviation[known]
    return other.solved and bool((away < _SAME).all())


def rivals(
    problem: Calibration, result: CalibrationResult, others: Sequence[CalibrationResult]
) -> list[CalibrationResult]:
    """Solutions that explain the data as well (a sum of squares no larger by 4, two standard deviations), with an
    identifiable parameter more than one deviation away: the covariance knows of its own minimum alone."""
    known, deviation = result.uncertainty.identifiable, result.uncertainty.deviation
    most = result.misfit + 4.0 * max(result.misfit, 1.0) / degrees_of_freedom(problem)
    apart = [(np.abs(other.values - result.values)[known] > deviation[known]).any() for other in others]
    return [other for other, far in zip(others, apart, strict=True) if far and other.solved and other.misfit <= most]


def needed_noise(problem: Calibration, result: CalibrationResult) -> dict[str, float]:
    """By how much the measurement's deviations must be multiplied to know each material parameter to 1 %."""
    return {
        name: WANTED_SHARE * value / deviation
        for name, value, deviation in zip(problem.parameters, result.values, result.uncertainty.deviation, strict=True)
        if name not in PLACEMENT and np.isfinite(deviation)
    }


def report(
    problem: Calibration,
    result: CalibrationResult,
    truth: Mapping[str, float] | None,
    out: Path,
) -> None:
    """Print the table and write calibration.csv, .json and .png in the folder out."""
    console = PlainConsole()
    relative = in_fixed_body(result.poses, result.place)
    solved = np.full(len(relative), result.solved)
    verdict = judge(problem.model, relative, solved, own_model(problem.model.scene))
    columns = _columns(problem, result, truth)
    table = Table(title=f"Calibration of {problem.model.scene.name}, {len(relative)} frames")
    for name in columns:
        table.add_column(name.replace("_", " "), justify="left" if name in ("parameter", "unit") else "right")
    for row in zip(*columns.values(), strict=True):
        table.add_row(*(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row))
    console.print(table)
    for group in result.uncertainty.tied:
        console.print(f"not identifiable{' together' if len(group) > 1 else ''}: {', '.join(group)}", highlight=False)
    if result.explained:
        for name, factor in needed_noise(problem, result).items():
            console.print(f"{name} to 1 %: measure with {factor:.2g} times these deviations", highlight=False)
    console.print(
        f"IPOPT: {result.ipopt_status}, {result.iterations} iterations, {result.seconds:.2f} s with its start; "
        f"sum of squares over degrees of freedom {result.misfit:.3g}, at most {result.largest_misfit:.3g} expected",
        highlight=False,
    )
    if not result.explained:
        console.print("standard deviations are scaled by its root: the stated ones do not explain it", highlight=False)
    console.print(f"relative poses, scene's own material: {verdict}", highlight=False)
    write_columns(out / "calibration.csv", columns, digits=DIGITS)
    write_summary(out / "calibration.json", _summary(problem, result, verdict, columns))
    draw(problem, result, [], truth, out / "calibration.png")
    console.print(f"results in {out}", highlight=False)


def report_starts(
    problem: Calibration,
    result: CalibrationResult,
    others: Sequence[CalibrationResult],
    truth: Mapping[str, float] | None,
    out: Path,
) -> None:
    """Print how many random starts reach the estimate; add them to the summary and the picture in the folder out."""
    same, as_good = sum(same_estimate(result, other) for other in others), rivals(problem, result, others)
    PlainConsole().print(f"{same} of {len(others)} random starts reach it", highlight=False)
    record = {"tried": len(others), "same": same, "others_as_good": [other.values.tolist() for other in as_good]}
    add_to_summary(out / "calibration.json", {"random_starts": record})
    draw(problem, result, others, truth, out / "calibration.png")


def _columns(problem: Calibration, result: CalibrationResult, truth: Mapping[str, float] | None) -> dict[str, Any]:
    names = problem.parameters
    columns: dict[str, Any] = {
        "parameter": names,
        "unit": [unit_of(name) for name in names],
        "estimate": result.values.tolist(),
        "standard_deviation": result.uncertainty.deviation.tolist(),
    }
    if truth is not None:
        known, deviation = np.array([truth[name] for name in names]), result.uncertainty.deviation
        columns["truth"] = known.tolist()
        over = (result.values - known) / deviation
        over[np.isinf(deviation)] = np.nan  # what the data leave open is not 0 deviations off
        columns["error_over_deviation"] = over.tolist()
    return columns


def _summary(
    problem: Calibration,
    result: CalibrationResult,
    verdict: Verdict,
    columns: Mapping[str, Any],
) -> dict[str, Any]:
    return {
        "verdict": str(verdict),
        "parameters": {key: list(column) for key, column in columns.items()},
        "correlation": result.uncertainty.correlation.tolist(),
        "not_identifiable_together": result.uncertainty.tied,
        "at_bound": result.uncertainty.at_bound,
        "noise_for_one_percent": needed_noise(problem, result) if result.explained else {},
        "misfit": result.misfit,
        "largest_misfit": result.largest_misfit,
        "explained": result.explained,
        **solver_record(result),
        "load_error": {
            name: rms_and_largest(error)
            for name, error in zip(problem.measured.load_names, result.load_error.T, strict=True)
        },
    }


def draw(
    problem: Calibration,
    result: CalibrationResult,
    others: Sequence[CalibrationResult],
    truth: Mapping[str, float] | None,
    path: Path,
) -> None:
    """Normal loads measured and fitted, load residuals, estimates against the truth, and correlations, as a PNG."""
    page = new_page(12.0, 7.5)
    axes = page.subplots(2, 2)
    measured, names = problem.measured, problem.measured.load_names
    frames = np.arange(len(measured.poses))
    colours = list(COLOURS.values())
    for name, colour in zip(problem.model.scene.sensitive_loads, colours, strict=False):
        column = names.index(name)
        axes[0, 0].plot(frames, measured.loads[:, column], "o", ms=4, color=colour, label=f"{name} measured")
        fitted = measured.loads[:, column] + result.load_error[:, column]
        axes[0, 0].plot(frames, fitted, color=colour, label=f"{name} fitted")
    axes[0, 0].set(title="normal loads", ylabel=f"force [{load_unit('Fy')}]")
    for name, error, deviation, colour in zip(
        names, result.load_error.T, measured.load_deviation, colours, strict=False
    ):
        axes[0, 1].plot(frames, error / deviation, ".-", lw=0.6, color=colour, label=name)
    axes[0, 1].set(title="loads, fitted minus measured", ylabel="standard deviations [-]")
    frame(axes[0], "frame")
    places = np.arange(len(problem.parameters))
    spread = np.where(result.uncertainty.identifiable, result.uncertainty.deviation, np.nan)
    centre = result.values if truth is None else np.array([truth[name] for name in problem.parameters])
    axes[1, 0].errorbar(places, (result.values - centre) / spread, yerr=1.0, fmt="o", capsize=4, label="estimate ± 1 σ")
    for k, other in enumerate(others):
        label = "from random starts" if k == 0 else None
        axes[1, 0].plot(places + 0.15, (other.values - centre) / spread, "x", color=COLOURS["vermillion"], label=label)
    axes[1, 0].axhline(0.0, color="0.5", lw=0.8)
    axes[1, 0].set_xticks(places, problem.parameters, rotation=30, ha="right", fontsize=8)
    axes[1, 0].set(title=f"estimates minus {'truth' if truth else 'estimate'}", ylabel="standard deviations [-]")
    axes[1, 0].grid(alpha=0.3)
    image = axes[1, 1].imshow(result.uncertainty.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    axes[1, 1].set_xticks(places, problem.parameters, rotation=30, ha="right", fontsize=8)
    axes[1, 1].set_yticks(places, problem.parameters, fontsize=8)
    axes[1, 1].set_title("correlation of the estimates")
    page.colorbar(image, ax=axes[1, 1])
    for axis in (axes[0, 0], axes[1, 0]):
        axis.legend(fontsize=7)
    axes[0, 1].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))  # beside curves that fill the panel
    page.suptitle(f"Calibration: {ended_in_words(result)}")
    save_page(page, path, dots_per_inch=80)
