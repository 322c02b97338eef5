"""Files of poses over time: a CSV of this library's (mm, rad), or an OpenSim table as this library writes it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.core.quantities import quantity
from casadi_contact.scenes.columns import TextColumns, check_reach, check_rising, write_columns
from casadi_contact.scenes.opensim import TIME, ColumnMap, mapped_curves, read_opensim_table

OPENSIM_ENDINGS = (".mot", ".sto")
_TIME = "time_s"
_COLUMNS = tuple(quantity(name).column for name in POSE_NAMES)  # tx_mm ... rz_rad


def read_poses(path: str | Path) -> Array:
    """Poses (n, 6) of a CSV file with the columns tx_mm, ty_mm, tz_mm, rx_rad, ry_rad, rz_rad, also by their names
    alone (tx ... rz), or of a .mot or .sto file with columns tx ... rz in m and rad (degrees where inDegrees=yes); a
    CSV file may have times, time_s or time. Other columns are ignored.

    Raises FileNotFoundError, or ValueError naming the file for what `read_columns` and `read_opensim_table` refuse,
    missing columns, times that do not rise, angles beyond 200 degrees, and lengths beyond 1 m.
    """
    return read_poses_over_time(path)[1]


def read_poses_over_time(path: str | Path) -> tuple[Array | None, Array]:
    """Times (n,) [s] of a file, None where it has none, and its poses as `read_poses` returns them; raises likewise."""
    path = Path(path)
    curves = _opensim_curves(path) if path.suffix.lower() in OPENSIM_ENDINGS else _csv_curves(path)
    try:
        return curves.get(TIME), poses_from_curves(curves)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _csv_curves(path: Path) -> dict[str, Array]:
    """Curves of the pose by name, with `TIME` where the file has times."""
    table = TextColumns.read(path, "pose file")
    times = next((column for column in (_TIME, TIME) if column in table.header), None)
    bare = set(POSE_NAMES) <= set(table.header) and not set(_COLUMNS) <= set(table.header)
    columns = POSE_NAMES if bare else _COLUMNS
    table.require(*columns)
    named = dict(zip(POSE_NAMES, columns, strict=True)) | ({} if times is None else {TIME: times})
    return {name: table.numbers(column) for name, column in named.items()}


def _opensim_curves(path: Path) -> dict[str, Array]:
    table = read_opensim_table(path)
    missing = [name for name in POSE_NAMES if name not in table.columns]
    if missing:
        there = ", ".join(table.columns)
        raise ValueError(f"{path} lacks {', '.join(missing)}; it has {there}: map them by casadi-contact cycle --map")
    return mapped_curves(table, [ColumnMap(name, name) for name in POSE_NAMES])


def poses_from_curves(curves: Mapping[str, Array]) -> Array:
    """Poses (n, 6) of curves by name: tx, ty, tz [mm], rx, ry, rz [rad], each (n,); there may be their time [s]. Raises
    ValueError naming the curves that lack, for no pose, for NaN, for times of several poses that do not rise, for
    angles beyond 200 degrees, and lengths beyond 1 m."""
    missing = [name for name in POSE_NAMES if name not in curves]
    if missing:
        need = f"poses need the curves {', '.join(missing)}, and there are no loads"
        raise ValueError(f"{need}; there are {', '.join(curves)}")
    poses = as_poses(np.stack([curves[name] for name in POSE_NAMES], axis=1))
    if not len(poses):
        raise ValueError("there is no row, expected a pose in each")
    if TIME in curves and len(poses) > 1:
        check_rising("poses", curves[TIME])
    check_reach("poses", dict(zip(POSE_NAMES, poses.T, strict=True)))
    return poses


def write_poses(time_s: Array, poses: Array, path: str | Path) -> None:
    """Write poses (n, 6) and times (n,) as a CSV file, time_s, tx_mm ... rz_rad; `read_poses` reads the same bits."""
    write_columns(path, {_TIME: time_s, **dict(zip(_COLUMNS, as_poses(poses).T, strict=True))})
