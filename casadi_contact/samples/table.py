"""A user's own table of samples, from any contact model or measurement, in CSV or HDF5.

Columns (HDF5: data sets of one dimension) by name, one row per pose:

    tx ty tz rx ry rz     pose [mm, rad]
    Fx ... Tz             wrench on the fixed body [N, N·mm]; Fx_med ... for scenes of several patches. Needed are
                          those that the scene's loads and normal loads are made of.
    gap, gap_med ...      distance of each patch [mm], above 0 in rows out of contact; may be left out
    domain, role          numbers of domain (1 for D1) and role (0 train, 1 validation, 2 test, some rows of each);
                          may be left out
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, Array, load_selection
from casadi_contact.core.files.containers import open_hdf5
from casadi_contact.core.files.reading import existing_file, sha256_of, short
from casadi_contact.samples.check_table import check_table
from casadi_contact.samples.samples import DOMAINS, ROLES, TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.checks import check_size
from casadi_contact.scenes.columns import read_columns
from casadi_contact.scenes.scene import Scene

_LEAST_ROWS = 10
_HELD_BACK = 0.1  # of the poses, for validation and for the test each


def read_sample_table(path: str | Path, scene: Scene) -> Samples:
    """Samples from a table; of rows without a role a tenth each, at random, is for validation and for the test.

    Raises FileNotFoundError, and ValueError for a missing column, values that are not finite numbers or beyond 1e15,
    columns of different length, too few rows, a role without rows, and wrong units, signs or origins (`check_table`).
    """
    path = Path(path)
    wrench_columns = _wrench_columns(scene)
    needed: np.ndarray = np.any(load_selection(scene.load_names, scene.patch_names) != 0.0, axis=0)
    for p, normal in enumerate(scene.normal_loads):
        needed[p, range(3) if normal.index is None else [normal.index]] = True
    required = [*POSE_NAMES, *(wrench_columns[p][k] for p, k in np.argwhere(needed))]
    gap_columns = [_of_patch("gap", patch, scene) for patch in scene.patch_names]
    rest = [column for columns in wrench_columns for column in columns if column not in required]
    read = _read_hdf5 if path.suffix.lower() in (".h5", ".hdf5") else _read_csv
    table = read(path, required, [*rest, *gap_columns, "domain", "role"])
    count = len(table[POSE_NAMES[0]])
    if count < _LEAST_ROWS:
        raise ValueError(f"{path} has {count} rows, expected at least {_LEAST_ROWS}")
    for name, column in table.items():
        check_size(str(path), name, column)
    zero, unknown = np.zeros(count), np.full(count, np.nan)
    wrenches = np.stack(
        [np.stack([table.get(column, zero) for column in columns], axis=1) for columns in wrench_columns], axis=1
    )
    role = table.get("role")
    poses = np.stack([table[name] for name in POSE_NAMES], axis=1)
    samples = Samples(
        scene,
        poses=poses,
        wrenches=wrenches,
        gaps=np.stack([table.get(column, unknown) for column in gap_columns], axis=1),
        domain=_whole(path, "domain", table.get("domain", np.ones(count))),
        role=_split(poses) if role is None else _whole(path, "role", role),
        provenance={"table": str(path), "table_digest": sha256_of(path)},
    )
    missing = [f"{number} ({name})" for number, name in enumerate(ROLES) if not (samples.role == number).any()]
    if missing and role is None:
        raise ValueError(
            f"{path} has {len(np.unique(poses, axis=0))} poses, expected hundreds: no row is left to train on"
        )
    if missing:
        raise ValueError(f"{path}: no row has role {', '.join(missing)}, expected some of each, or no column role")
    check_table(samples, str(path))
    return samples


def _of_patch(name: str, patch: str, scene: Scene) -> str:
    return name if len(scene.patch_names) == 1 else f"{name}_{patch}"


def _wrench_columns(scene: Scene) -> list[list[str]]:
    """Column of each wrench component of each patch."""
    return [[_of_patch(component, patch, scene) for component in WRENCH_NAMES] for patch in scene.patch_names]


def _read_csv(path: Path, required: list[str], optional: list[str]) -> dict[str, Array]:
    return read_columns(path, required=required, optional=optional)


def _read_hdf5(path: Path, required: list[str], optional: list[str]) -> dict[str, Array]:
    with open_hdf5(existing_file(path), foreign=True) as file:
        missing = [column for column in required if column not in file]
        if missing:
            raise ValueError(f"{path} lacks the columns {', '.join(missing)}; it has {short(', '.join(file))}")
        columns = {}
        for name in (c for c in (*required, *optional) if c in file):
            if not isinstance(file[name], h5py.Dataset) or file[name].dtype.kind not in "biuf":
                raise ValueError(f"{path}: {name} is not a data set of numbers")
            columns[name] = np.asarray(file[name][()], dtype=float)
    count = columns[required[0]].size
    for name, column in columns.items():
        if column.shape != (count,) or not np.isfinite(column).all():
            raise ValueError(f"{path}: {name} of shape {column.shape} is not {count} finite numbers")
    return columns


def _whole(path: Path, name: str, column: Array) -> np.ndarray:
    """A column of whole numbers, 1 to 7 of a domain and 0 to 2 of a role; ValueError for others."""
    least, most = (1, len(DOMAINS)) if name == "domain" else (0, len(ROLES) - 1)
    if np.any(wrong := (column != np.round(column)) | (column < least) | (column > most)):
        row = int(wrong.argmax())
        raise ValueError(
            f"{path}: {name} is {column[row]:g} in row {row + 1}, expected a whole number from {least} to {most}"
        )
    return column.astype(np.uint8)


def _split(poses: Array) -> np.ndarray:
    """Roles (n,) of poses (n, 6) drawn at random, at least one pose of each; repeated poses have the same role, or
    networks would be judged by what they learned."""
    distinct, pose_of_row = np.unique(poses, axis=0, return_inverse=True)
    order = np.random.default_rng(0).permutation(len(distinct))
    held_back = max(1, round(_HELD_BACK * len(distinct)))
    role = np.full(len(distinct), TRAIN, dtype=np.uint8)
    role[order[:held_back]] = TEST
    role[order[held_back : 2 * held_back]] = VALIDATION
    return np.asarray(role[pose_of_row.ravel()])
