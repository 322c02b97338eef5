"""Every setting of muscle_contact that was tried, against measured contact forces: what each rule is worth.

The first 16 were fixed before they met these forces; the combinations after them were put together of what had helped,
and are blind to no more than the size of each rule.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from casadi_contact import load_surrogate
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.knee import COORDINATES, SIDES
from casadi_contact.optimisation.muscle_walk import MuscleWalk, at_times, read_walk
from casadi_contact.scenes.load_cycle import read_cycle
from problems import muscle_contact
from problems.common.command import RESULTS, new_app, run_command
from problems.muscle_contact.problem import LEAST_SQUARES

PRETENSION_N = 100.0  # of each collateral ligament: stiffness 2,000 N at a strain of 0.08 (Blankevoort et al. 1991)
_CHOSEN = {"exponent": 3.0, "margin_mm": 20.0, "share_heads": True, "ankle": True}
SETTINGS: dict[str, dict[str, Any]] = {
    "squared": {},
    "cubed": {"exponent": 3.0},
    "tenth power": {"exponent": 10.0},
    "squared, by volume": {"by_volume": True},
    "squared, all six": {"balanced": tuple(COORDINATES), "free": ("tx", "ty", "tz", "rx")},
    "squared, isometric": {"model": "isometric"},
    "squared, fibres to their optimum": {"longest_fibre": 1.0},
    "squared, heads": {"share_heads": True},
    "squared, tone 0.05": {"least_activation": 0.05},
    "squared, ankle": {"ankle": True},
    "squared, closed 10": {"margin_mm": 10.0},
    "squared, closed 20": {"margin_mm": 20.0},
    "squared, collaterals": {"pretension_n": PRETENSION_N},
    "squared, five synergies": {"synergies": muscle_contact.SYNERGIES},
    "squared, closed 20, ankle, optimum": {"margin_mm": 20.0, "ankle": True, "longest_fibre": 1.0},
    "cubed, closed 20, ankle, optimum": {"exponent": 3.0, "margin_mm": 20.0, "ankle": True, "longest_fibre": 1.0},
    "cubed, closed 20": {"exponent": 3.0, "margin_mm": 20.0},
    "cubed, closed 20, heads": {"exponent": 3.0, "margin_mm": 20.0, "share_heads": True},
    "cubed, closed 30": {"exponent": 3.0, "margin_mm": 30.0},
    "cubed, closed 20, heads, ankle": _CHOSEN,
    "the same, five synergies": {**_CHOSEN, "synergies": muscle_contact.SYNERGIES},
    "the same, activation dynamics": {**_CHOSEN, "activation_dynamics": True},
    "the same, compliant tendons": {**_CHOSEN, "compliant_tendons": True},
    "the same, both": {**_CHOSEN, "activation_dynamics": True, "compliant_tendons": True},
}


def read_walks(folder: Path) -> dict[str, tuple[MuscleWalk, np.ndarray]]:
    """Walks of a folder by name, each with measured compression (n, 2) of `SIDES` [N] at its times.

    Of each NAME it holds NAME_loads.csv, NAME_inverse_dynamics.csv and NAME_muscles.csv; of all muscle_parameters.csv.
    """
    ending = "_inverse_dynamics.csv"
    found = {}
    for path in sorted(folder.glob(f"*{ending}")):
        name = path.name.removesuffix(ending)
        loads, muscles = (folder / f"{name}_{what}.csv" for what in ("loads", "muscles"))
        walk, measured = read_walk(loads, path, muscles, folder / "muscle_parameters.csv"), read_cycle(loads)
        sides = -np.column_stack([measured.fy_med, measured.fy_lat])
        found[name] = (walk, at_times(str(loads), measured.time_s, sides, walk.time_s))
    if not found:
        raise ValueError(f"folder {folder} holds no file *{ending}")
    return found


def prediction_error(
    contact: SymbolicContact, walk: MuscleWalk, measured: np.ndarray, setting: Mapping[str, Any]
) -> dict[str, float]:
    """RMS and mean of predicted less measured compression [N] by side, and how many frames were solved."""
    settings = {**LEAST_SQUARES, **setting}
    if (longest := settings.pop("longest_fibre", None)) is not None:
        walk, settings["fit_lengths"] = replace(walk, muscles=walk.muscles.fitted_to(walk.lengths_m, longest)), False
    pretension_n = 2.0 * settings.pop("pretension_n", 0.0)
    walk = replace(walk, loads={**walk.loads, "knee_ty": walk.loads["knee_ty"] + pretension_n})
    synergies = settings.pop("synergies", 0)
    problem = muscle_contact.build(contact, walk, **settings)
    result = muscle_contact.solve(muscle_contact.driven_by_synergies(problem, synergies) if synergies else problem)
    off = -result.loads[:, : len(SIDES)] - measured
    found = {"solved": float(result.converged.sum()), "frames": float(len(walk))}
    for side, column in zip(SIDES, off.T, strict=True):
        found |= {f"{side}_rms_N": float(np.sqrt(np.mean(column**2))), f"{side}_mean_N": float(column.mean())}
    return found


app = new_app()


@app.command()
def run(
    folder: Annotated[Path, typer.Argument(help="NAME_loads.csv, NAME_inverse_dynamics.csv, NAME_muscles.csv ...")],
    surrogate: Annotated[str, typer.Option(help="a ready surrogate or the path of a .h5 file")] = "knee",
    out: Annotated[Path, typer.Option(help="result file (JSON)")] = RESULTS / "muscle_settings.json",
) -> None:
    """Table of all settings on all cycles of a folder: RMS error (mean) medial, lateral [N]."""
    writable_folder(out.parent)  # before minutes of solving
    walks, contact = read_walks(folder), load_surrogate(surrogate)
    lines: dict[str, dict[str, dict[str, float]]] = {}
    table = Table(title="Predicted less measured compression, medial and lateral: RMS (mean) [N]")
    for title in ("setting", *walks):
        table.add_column(title)
    for name, setting in SETTINGS.items():
        lines[name] = {cycle: prediction_error(contact, *walks[cycle], setting) for cycle in walks}
        table.add_row(name, *(error_cell(error) for error in lines[name].values()))
    write_text(out, json.dumps(lines, indent=1) + "\n")
    console = PlainConsole()
    console.print(table)
    console.print(f"results in {out}", highlight=False)


def error_cell(error: Mapping[str, float]) -> str:
    """88 (+3), 300 (-180): both sides; with the frames solved where not all are."""
    sides = ", ".join(f"{error[f'{side}_rms_N']:.0f} ({error[f'{side}_mean_N']:+.0f})" for side in SIDES)
    return sides if error["solved"] == error["frames"] else f"{sides}; {error['solved']:.0f} of {error['frames']:.0f}"


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, "studies.muscle_settings")


if __name__ == "__main__":
    main()
