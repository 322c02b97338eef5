"""From OpenSim files to cycles and poses: ``cycle``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.cli.arguments import console
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.scenes.joint_cycle import joint_cycle_from_curves, write_joint_cycle
from casadi_contact.scenes.load_cycle import cycle_from_curves, write_cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.opensim.mapping import ColumnMap, mapped_curves
from casadi_contact.scenes.opensim.table import TIME, read_opensim_table
from casadi_contact.scenes.pose_file import poses_from_curves, write_poses
from casadi_contact.workflow.project import has_gait


def cycle(
    file: Annotated[Path, typer.Argument(help="an OpenSim .mot or .sto file")],
    maps: Annotated[
        list[str], typer.Option("--map", help="COLUMN=NAME:UNIT, such as knee_angle_r=-rz:deg; once per curve")
    ],
    out: Annotated[
        Path | None, typer.Option(help="CSV file to write; cycle.csv or poses.csv in this folder if left out")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="scene (name or file) that the cycle is of; a knee's if left out")
    ] = None,
) -> None:
    """Turn columns of an OpenSim file into a load cycle, for --cycles and the problems: rz, ry, Fy_med, Fy_lat, and
    cop_ap or Tz, cop_ml or Tx; of another joint's --scene the pose parameters that were measured and a load for each
    other one; or into poses, for show --poses: tx, ty, tz, rx, ry, rz.
    """
    own = None if scene is None else load_scene(scene)
    table = read_opensim_table(file)
    try:
        columns = [ColumnMap.parse(text) for text in maps]
        curves = mapped_curves(table, columns)
        if set(curves) <= {TIME, *POSE_NAMES}:
            poses, path = poses_from_curves(curves), out or Path("poses.csv")
            write_poses(curves[TIME], poses, path)
            console.print(f"{len(poses)} poses in {path}", highlight=False)
            return
        path = out or Path("cycle.csv")
        if own is None or has_gait(own):
            write_cycle(cycle_from_curves(path.stem, curves), path)
        else:
            write_joint_cycle(joint_cycle_from_curves(path.stem, curves, own), path)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    console.print(f"cycle of {len(curves[TIME])} frames in {path}", highlight=False)
