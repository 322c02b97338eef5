"""What the drop says: a verdict, how far both simulations are apart, a CSV of both, a JSON summary and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.core.conventions import POSE_NAMES, POSE_UNITS
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.pictures.page import SURROGATE, WANTED, new_page, panels, save_page
from casadi_contact.scenes.columns import write_columns
from problems.common.learned_range import reasons
from problems.common.outcome import print_reasons, print_verdict
from problems.common.records import DIGITS, pose_columns, write_summary
from problems.opensim_drop.compare import Comparison
from problems.opensim_drop.problem import Drop


def report(drop: Drop, compared: Comparison, verdict: Verdict, out: Path) -> None:
    """Print the table and write opensim_drop.csv, .json and .png in the folder out; verdict: on CasADi's poses."""
    writable_folder(out)
    console = PlainConsole()
    print_verdict(console, verdict)
    table = Table(title=f"The same drop by OpenSim {compared.version} and by CVODES")
    for title in ("pose parameter", "travel", "largest difference"):
        table.add_column(title, justify="left" if title.startswith("pose") else "right")
    travel = np.ptp(compared.casadi, axis=0)
    for name, unit, far, off in zip(POSE_NAMES, POSE_UNITS, travel, compared.difference, strict=True):
        table.add_row(f"{name} ({unit})", f"{far:.3g}", f"{off:.1e}")
    console.print(table)
    reason = reasons(drop.surrogate, compared.casadi, verdict)
    print_reasons(console, reason)
    columns: dict[str, Any] = {
        "frame": range(len(drop.times_s)),
        "time_s": drop.times_s,
        **pose_columns(compared.casadi),
    }
    columns |= {f"opensim_{name}": values for name, values in pose_columns(compared.opensim).items()}
    columns |= {"reason": reason, "verdict": verdict.words}
    write_columns(out / "opensim_drop.csv", columns, digits=DIGITS)
    write_summary(
        out / "opensim_drop.json",
        {
            "verdict": str(verdict),
            "opensim": compared.version,
            "settings": drop.settings(),
            "largest_difference": dict(zip(POSE_NAMES, compared.difference.tolist(), strict=True)),
        },
    )
    _draw(drop, compared, out / "opensim_drop.png")
    console.print(f"results in {out}", highlight=False)


def _draw(drop: Drop, compared: Comparison, path: Path) -> None:
    page = new_page(12.0, 6.5)
    places = [(row, column) for row in range(2) for column in range(3)]
    parts = panels(page, 2, 3, places)
    time_ms = 1e3 * drop.times_s
    for column, (name, unit, place) in enumerate(zip(POSE_NAMES, POSE_UNITS, places, strict=True)):
        panel = parts[place]
        panel.curves.plot(time_ms, compared.opensim[:, column], label="OpenSim", **WANTED)
        panel.curves.plot(time_ms, compared.casadi[:, column], label="CVODES", **SURROGATE)
        panel.curves.set(title=name, ylabel=f"{name} [{unit}]")
        panel.difference(time_ms, (compared.opensim - compared.casadi)[:, column], "OpenSim - CVODES", **SURROGATE)
        panel.differences.set_ylabel(f"off [{unit}]", fontsize=8)
        panel.lowest.set_xlabel("time [ms]")
    parts[0, 0].curves.legend(fontsize=8)
    save_page(page, path)
