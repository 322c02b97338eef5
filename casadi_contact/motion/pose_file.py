"""Files of poses over time: a CSV of this library's (mm, rad), or an OpenSim table as this library writes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from casadi_contact.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.motion.columns import TextColumns, write_columns
from casadi_contact.motion.opensim import ColumnMap, mapped_curves, read_opensim_table
from casadi_contact.quantities import quantity

OPENSIM_ENDINGS = (".mot", ".sto")
_TIME = "time_s"
_COLUMNS = tuple(quantity(name).column for name in POSE_NAMES)  # tx_mm ... rz_rad
_LARGEST_ANGLE_RAD = 2.0 * np.pi  # beyond a whole turn an angle is in other units
_LARGEST_LENGTH_MM = 1000.0  # no joint's bodies are a metre apart: a file in mm was taken for one in m


def read_poses(path: str | Path) -> Array:
    """Poses (n, 6) of a CSV file with the columns tx_mm, ty_mm, tz_mm, rx_rad, ry_rad, rz_rad, also by their names
    alone (tx ... rz), or of a .mot or .sto file with columns tx ... rz in m and rad (degrees where inDegrees=yes);
    other columns are ignored.

    Raises FileNotFoundError, or ValueError naming the file for what `read_columns` and `read_opensim_table` refuse,
    missing columns, angles beyond a whole turn, and lengths beyond 1 m.
    """
    path = Path(path)
    curves = _opensim_curves(path) if path.suffix.lower() in OPENSIM_ENDINGS else _csv_curves(path)
    try:
        return poses_from_curves(curves)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _csv_curves(path: Path) -> dict[str, Array]:
    table = TextColumns.read(path, "pose file")
    bare = set(POSE_NAMES) <= set(table.header) and not set(_COLUMNS) <= set(table.header)
    columns = POSE_NAMES if bare else _COLUMNS
    table.require(*columns)
    return {name: table.numbers(column) for name, column in zip(POSE_NAMES, columns, strict=True)}


def _opensim_curves(path: Path) -> dict[str, Array]:
    table = read_opensim_table(path)
    missing = [name for name in POSE_NAMES if name not in table.columns]
    if missing:
        raise ValueError(
            f"{path} lacks the columns {', '.join(missing)}; it has {', '.join(table.columns)}: "
            "name them with casadi-contact cycle --map"
        )
    return mapped_curves(table, [ColumnMap(name, name) for name in POSE_NAMES])


def poses_from_curves(curves: Mapping[str, Array]) -> Array:
    """Poses (n, 6) of curves by name: tx, ty, tz [mm], rx, ry, rz [rad], each (n,).

    Raises ValueError naming the curves that lack, for no pose, for NaN, for angles beyond a whole turn, and lengths
    beyond 1 m.
    """
    missing = [name for name in POSE_NAMES if name not in curves]
    if missing:
        raise ValueError(
            f"without loads these are poses, which need the curves {', '.join(missing)}; there are {', '.join(curves)}"
        )
    poses = as_poses(np.stack([curves[name] for name in POSE_NAMES], axis=1))
    if not len(poses):
        raise ValueError("there is no row, expected a pose in each")
    largest = np.abs(poses).max(axis=0, initial=0.0)
    for name, size in zip(POSE_NAMES[3:], largest[3:], strict=True):
        if size > _LARGEST_ANGLE_RAD:
            raise ValueError(f"{name} reaches {size:g}, expected radians: is it in degrees?")
    for name, size in zip(POSE_NAMES[:3], largest[:3], strict=True):
        if size > _LARGEST_LENGTH_MM:
            raise ValueError(f"{name} reaches {size:g} mm, expected a joint's: is the file in mm, and not in m?")
    return poses


def write_poses(time_s: Array, poses: Array, path: str | Path) -> None:
    """Write poses (n, 6) and their times (n,) as a CSV file, time_s, tx_mm ... rz_rad, that `read_poses` reads back bit
    by bit."""
    write_columns(path, {_TIME: time_s, **dict(zip(_COLUMNS, as_poses(poses).T, strict=True))})
