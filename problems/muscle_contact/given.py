"""The walk that a command line names by its files, or the built-in one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.optimisation.muscle_walk import ROTATION_MAPS, MuscleWalk, example_walk, read_walk
from casadi_contact.scenes.load_cycle import LoadCycle, read_cycle
from casadi_contact.scenes.opensim.mapping import ColumnMap

InverseDynamicsOption = Annotated[Path | None, typer.Option(help="CSV or .sto; the built-in walk if left out")]
MusclesOption = Annotated[Path | None, typer.Option(help="CSV, or folder of a MuscleAnalysis: lengths and arms")]
ParametersOption = Annotated[Path | None, typer.Option(help="CSV of the muscles' parameters")]
RotationsOption = Annotated[Path | None, typer.Option(help="CSV or .sto with flexion_rz_rad and rotation_ry_rad")]
MapOption = Annotated[list[str] | None, typer.Option("--map", help="other columns of it, such as knee_angle_r=-rz:deg")]


def given_walk(
    rotations: Path | None,
    inverse_dynamics: Path | None,
    muscles: Path | None,
    parameters: Path | None,
    maps: Sequence[str] | None,
) -> MuscleWalk:
    """The walk of all four files (`read_walk`), the built-in one for none; ValueError for some of them, and for maps of
    columns without files."""
    if inverse_dynamics and muscles and parameters and rotations:
        columns = [ColumnMap.parse(text) for text in maps or ()] or ROTATION_MAPS
        return read_walk(rotations, inverse_dynamics, muscles, parameters, columns)
    files = {"inverse-dynamics": inverse_dynamics, "muscles": muscles, "parameters": parameters, "rotations": rotations}
    missing = [f"--{name}" for name, path in files.items() if path is None]
    if len(missing) < len(files) or maps:
        none = "none and no --map" if maps else "none"
        raise ValueError(f"{', '.join(missing)} not given, expected all four files, or {none} for the built-in walk")
    return example_walk()


def measured_cycle(path: Path, walk: MuscleWalk) -> LoadCycle:
    """The cycle of a file that a walk is compared with, known to reach over it before anything is solved."""
    return read_cycle(path)
