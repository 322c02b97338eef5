"""What a picture says better than numbers: starts (row 1), differences (row 4) and time steps (row 6)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.pictures.page import COLOURS, new_page, save_page
from problems.studies.stability.methods import METHODS

# Markers for those who print in grey.
_STYLES = dict(
    zip(
        METHODS,
        (
            (COLOURS["blue"], "s"),
            (COLOURS["orange"], "^"),
            (COLOURS["blue"], "h"),
            (COLOURS["green"], "*"),
            ("#999999", "v"),
            ("#555555", "D"),
            (COLOURS["black"], "o"),
            (COLOURS["sky blue"], "X"),
            (COLOURS["vermillion"], "P"),
            (COLOURS["purple"], "<"),
            (COLOURS["yellow"], ">"),
            ("#7a4419", "d"),
        ),
        strict=True,
    )
)


def draw(curves: Mapping[str, Any], path: Path) -> None:
    """The rows 1, 4 and 6 that curves hold, as in stability.json, as a PNG; nothing where it holds none."""
    shown = [row for row in ("1", "4", "6") if row in curves]
    if not shown:
        return
    page = new_page(4.6 * len(shown) + 1.6, 3.9)
    panels = {"1": _starts, "4": _differences, "6": _steps}
    axes = np.atleast_1d(page.subplots(1, len(shown)))
    for axis, row in zip(axes, shown, strict=True):
        panels[row](axis, curves[row])
        axis.grid(alpha=0.25, which="major", lw=0.5)
    entries = {name: handle for a in axes for handle, name in zip(*a.get_legend_handles_labels(), strict=True)}
    ordered = [method for method in METHODS if method in entries]
    page.legend([entries[m] for m in ordered], ordered, loc="outside right upper", fontsize=8, frameon=False)
    save_page(page, path, dots_per_inch=90)


def _line(axis: Any, method: str, x: Any, y: Any) -> None:
    colour, marker = _STYLES[method]
    size = 11.0 - 0.8 * METHODS.index(method)  # hollow and of different sizes: equal results stay visible
    axis.plot(x, y, color=colour, marker=marker, ms=size, mfc="none", lw=1.2, label=method)


def _starts(axis: Any, row: Mapping[str, Any]) -> None:
    order = np.argsort(row["lifts_mm"])
    labels = [f"{row['lifts_mm'][k]:+g}" for k in order]
    for method, shares in row["shares"].items():
        _line(axis, method, labels, 100.0 * np.asarray(shares)[order])
    axis.set(xlabel="gap of the nearer side at the start [mm]", ylabel="starts solved [%]", ylim=(-4.0, 104.0))
    axis.set_title("1. Starts out of contact and too deep", fontsize=10)


def _differences(axis: Any, row: Mapping[str, Any]) -> None:
    for method, errors in row["errors"].items():
        # A method whose own gradients are differences of this very step agrees with them: no point on a log axis.
        _line(axis, method, row["steps_mm"], np.where(np.asarray(errors) > 0.0, errors, np.nan))
    axis.set(xscale="log", yscale="log", xlabel="step [mm], rotations over 25 mm", ylabel="relative error of Jacobian")
    axis.set_title("4. Central differences of each method", fontsize=10)


def _steps(axis: Any, row: Mapping[str, Any]) -> None:
    for method, curve in row.items():
        _line(axis, method, curve["stiffness"], 1e3 * np.asarray(curve["rk4"]))
    axis.set(
        xlim=(0.0, None), ylim=(0.0, None), xlabel="contact stiffness [N/mm]", ylabel="largest stable step, RK4 [ms]"
    )
    axis.set_title("6. Explicit steps (implicit: 100 ms or more)", fontsize=10)
