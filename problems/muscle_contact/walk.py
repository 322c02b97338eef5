"""What a muscle problem is given: inverse dynamics, the muscles' geometry and the joint's rotations over a cycle.

Arms are those of `knee_coordinates`: arm = -∂length/∂coordinate, m for rotations, direction cosines for
translations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.conventions import Array
from casadi_contact.motion.checks import check_radians, check_rising
from casadi_contact.motion.columns import TextColumns, read_columns
from casadi_contact.motion.load_cycle import OverTime
from casadi_contact.motion.opensim import ColumnMap, Table, mapped_curves, read_opensim_table
from problems.muscle_contact.knee_coordinates import COORDINATES, coordinate_unit
from problems.muscle_contact.muscle import MuscleParameters
from problems.muscle_contact.plausible import (
    check_arms,
    check_flexion_arms,
    check_lengths,
    check_loads,
    check_sides,
    check_velocities,
)
from problems.muscle_contact.times import at_times, check_covers

# How the rotations stand in the measured cycles' files (`casadi_contact.motion.load_cycle`).
ROTATION_MAPS = (ColumnMap("flexion_rz_rad", "rz", unit="rad"), ColumnMap("rotation_ry_rad", "ry", unit="rad"))
PARAMETER_COLUMNS = ("max_isometric_force_N", "optimal_fibre_length_m", "tendon_slack_length_m", "pennation_rad")


@dataclass(frozen=True)
class MuscleWalk(OverTime):
    """One cycle of n frames and m muscles: time_s, rz, ry (n,); loads (n,) [N, N·m] and arms (n, m) by coordinate;
    lengths_m and velocities_m_per_s (n, m) of the musculotendons; the muscles' parameters.

    Raises ValueError for shapes that do not fit, NaN, unsorted time, a coordinate without both loads and arms, and
    numbers that are not of a knee in these units and signs (`plausible`).
    """

    name: str
    time_s: Array
    rz: Array
    ry: Array
    loads: Mapping[str, Array]
    arms: Mapping[str, Array]
    lengths_m: Array
    velocities_m_per_s: Array
    muscles: MuscleParameters

    def __post_init__(self) -> None:
        frames, count = len(self.time_s), len(self.muscles.names)
        expected: dict[str, tuple[Array, tuple[int, ...]]] = {
            "time": (self.time_s, (frames,)),
            "rz": (self.rz, (frames,)),
            "ry": (self.ry, (frames,)),
            "lengths": (self.lengths_m, (frames, count)),
            "velocities": (self.velocities_m_per_s, (frames, count)),
        }
        expected |= {f"loads of {key}": (curve, (frames,)) for key, curve in self.loads.items()}
        expected |= {f"arms about {key}": (table, (frames, count)) for key, table in self.arms.items()}
        for what, (values, shape) in expected.items():
            if values.shape != shape:
                raise ValueError(f"walk {self.name}: {what} have shape {values.shape}, expected {shape}")
            if not np.isfinite(values).all():
                frame = int(np.argwhere(~np.isfinite(values))[0][0])
                raise ValueError(f"walk {self.name}: {what} hold NaN at frame {frame}, expected finite numbers")
        check_rising(f"walk {self.name}", self.time_s)
        odd = (set(self.loads) | set(self.arms)) - set(COORDINATES)
        odd |= set(self.loads) ^ set(self.arms)
        if odd:
            raise ValueError(
                f"walk {self.name}: coordinates {', '.join(sorted(odd))} lack loads or arms, or are none of "
                f"{', '.join(COORDINATES)}"
            )
        names = self.muscles.names
        check_lengths(f"walk {self.name}", names, self.lengths_m)
        check_arms(self.name, names, self.arms)
        check_sides(self.name, names, self.arms)
        check_loads(self.name, self.loads)
        check_velocities(self.name, names, self.time_s, self.lengths_m, self.velocities_m_per_s)
        if "knee_flexion" in self.arms:
            check_flexion_arms(self.name, names, self.time_s, self.rz, self.lengths_m, self.arms["knee_flexion"])

    def check_has(self, coordinates: Sequence[str], cure: str = "") -> None:
        """ValueError for coordinates of which the walk has no loads and arms; cure: what else would do."""
        missing = [name for name in coordinates if name not in self.loads]
        if missing:
            columns = [f"{name}_{coordinate_unit(name)}" for name in missing if name in COORDINATES]
            arms = [f"arm_{name}" for name in missing if name in COORDINATES]
            files = f"give {', '.join(columns)} in inverse dynamics and {', '.join(arms)} of the muscles"
            cures = [text for text in (files if columns else "", cure) if text]
            raise ValueError(
                f"walk {self.name} has no loads and arms of {', '.join(missing)}; it has {', '.join(self.loads)}"
                + (f": {', or '.join(cures)}" if cures else "")
            )


def read_walk(
    rotations: Path,
    inverse_dynamics: Path,
    muscles: Path,
    parameters: Path,
    maps: Sequence[ColumnMap] = ROTATION_MAPS,
) -> MuscleWalk:
    """Read a walk; all curves are taken at the times of inverse dynamics, which they must reach over (`at_times`).

    rotations: CSV or .sto with time (``time_s`` or ``time``) and the columns that maps turn into rz and ry.
    inverse_dynamics: CSV or .sto with time and coordinates of `COORDINATES` (``knee_ty`` or ``knee_ty_N``, N, N·m).
    muscles: a CSV with ``frame, muscle, length_m, velocity_m_per_s, arm_knee_ty, ...``, a frame for each row of
    inverse dynamics; or a folder of OpenSim's MuscleAnalysis (``*_Length.sto``, ``*_MomentArm_knee_ty.sto``, ...),
    velocities then come from the lengths. parameters: CSV with ``muscle`` and `PARAMETER_COLUMNS`; it must name every
    muscle of a CSV, and of a folder, which lists the whole body, those that count.

    Raises FileNotFoundError for no file and ValueError, naming file, line, column or muscle, for what cannot be used.
    """
    turns = _table(rotations, required=[item.column for item in maps])
    labels = {label: name for name in COORDINATES for label in (name, f"{name}_{coordinate_unit(name)}")}
    dynamics = _table(inverse_dynamics, optional=list(labels)).columns
    time_s = dynamics["time"]
    loads = {name: dynamics[label] for label, name in labels.items() if label in dynamics}
    if not loads:
        raise ValueError(f"{inverse_dynamics} has none of the columns {', '.join(COORDINATES)}")
    known = _parameters(parameters)
    lengths, velocities, arms = (_analysis if muscles.is_dir() else _geometry)(muscles, known.names, time_s)
    try:
        curves = mapped_curves(turns, maps)
    except ValueError as error:
        raise ValueError(f"{rotations}: {error}") from None
    if not {"rz", "ry"} <= set(curves):
        raise ValueError(f"{rotations} is mapped to {', '.join(curves)}, expected columns for rz and ry")
    for item in maps:
        if item.name in ("rz", "ry"):
            check_radians(str(rotations), item.column, curves[item.name])
    turned = np.column_stack([curves["rz"], curves["ry"]])
    rz, ry = at_times(str(rotations), curves["time"], turned, time_s).T
    shared = [name for name in COORDINATES if name in loads and name in arms]
    return MuscleWalk(
        inverse_dynamics.stem.removesuffix("_inverse_dynamics"),
        time_s,
        rz,
        ry,
        {name: loads[name] for name in shared},
        {name: arms[name] for name in shared},
        lengths,
        velocities,
        known,
    )


def read_length_range(path: Path, names: Sequence[str]) -> Array:
    """Shortest and longest length (2, m) [m] of each muscle in a further cycle of the same person.

    path: a CSV or a folder, as `read_walk` takes for muscles. Raises like it.
    """
    if path.is_dir():
        table = read_opensim_table(_length_file(path))
        curves = [table.column(name) for name in names]
    else:
        text = TextColumns.read(path)
        muscle, length = np.array(text.text("muscle")), text.numbers("length_m")
        curves = [length[muscle == name] for name in names]
        missing = [name for name, curve in zip(names, curves, strict=True) if not len(curve)]
        if missing:
            raise ValueError(f"{path} lacks the muscles {', '.join(missing)}")
    lengths = np.array([[curve.min() for curve in curves], [curve.max() for curve in curves]])
    check_lengths(str(path), names, lengths)
    return lengths


def _table(path: Path, required: Sequence[str] = (), optional: Sequence[str] = ()) -> Table:
    """These columns of a CSV file, or a whole OpenSim file, as a table whose time [s] rises."""
    if path.suffix.lower() in (".sto", ".mot"):
        table = read_opensim_table(path)
    else:
        columns = read_columns(path, required=("time_s", *required), optional=optional)
        table = Table(path.stem, {"time": columns.pop("time_s"), **columns})
    check_rising(str(path), table.column("time"))
    return table


def _parameters(path: Path) -> MuscleParameters:
    table = TextColumns.read(path)
    numbers = [table.numbers(column) for column in PARAMETER_COLUMNS]
    try:
        return MuscleParameters(tuple(table.text("muscle")), *numbers)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _geometry(path: Path, names: tuple[str, ...], time_s: Array) -> tuple[Array, Array, dict[str, Array]]:
    """Lengths, velocities (n, m) and arms by coordinate from a CSV with one line for each frame and muscle."""
    table = TextColumns.read(path)
    table.require("length_m")
    table.require("velocity_m_per_s")
    muscle, frame = table.text("muscle"), table.numbers("frame")
    if unknown := [name for name in dict.fromkeys(muscle) if name not in names]:
        raise ValueError(
            f"{path} has the muscles {', '.join(unknown)}, of which the parameters file has no row, expected one for "
            "each: add their rows to it, or leave these muscles out of the muscles file"
        )
    odd = np.flatnonzero((frame < 0.0) | (frame != np.floor(frame)))
    if len(odd):
        raise ValueError(
            f"{path} line {table.rows[odd[0]][0]}: frame is {frame[odd[0]]:g}, expected a whole number of 0 or more: "
            "the row of inverse dynamics, counted from 0"
        )
    place: dict[tuple[int, str], int] = {}
    for k, key in enumerate(zip(frame.astype(int), muscle, strict=True)):
        if key in place:
            raise ValueError(f"{path} line {table.rows[k][0]}: muscle {key[1]} at frame {key[0]} is there twice")
        place[key] = k
    missing = [(k, name) for k in range(len(time_s)) for name in names if (k, name) not in place]
    if missing:
        raise ValueError(f"{path} lacks muscle {missing[0][1]} at frame {missing[0][0]} of {len(time_s)}")
    last = int(frame.max())
    if last >= len(time_s):
        raise ValueError(f"{path} has frame {last}, but inverse dynamics has {len(time_s)} frames, counted from 0")
    order = np.array([[place[k, name] for name in names] for k in range(len(time_s))])
    arms = {name: table.numbers(f"arm_{name}")[order] for name in COORDINATES if f"arm_{name}" in table.header}
    return table.numbers("length_m")[order], table.numbers("velocity_m_per_s")[order], arms


def _analysis(folder: Path, names: tuple[str, ...], time_s: Array) -> tuple[Array, Array, dict[str, Array]]:
    """The same from the files that OpenSim's MuscleAnalysis writes, a column for each muscle."""

    def at(path: Path, order: int = 0) -> Array:
        table = read_opensim_table(path)
        known_s = table.column("time")
        check_covers(str(path), known_s, time_s)
        spline = CubicSpline(known_s, np.column_stack([table.column(name) for name in names]))
        return np.asarray(spline(np.clip(time_s, known_s[0], known_s[-1]), order))

    length = _length_file(folder)
    files = {name: _only(folder, f"MomentArm_{name}") for name in COORDINATES}
    arms = {name: at(path) for name, path in files.items() if path is not None}
    return at(length), at(length, 1), arms


def _length_file(folder: Path) -> Path:
    path = _only(folder, "Length")
    if path is None:
        raise FileNotFoundError(f"folder {folder} holds no file *_Length.sto")
    return path


def _only(folder: Path, ending: str) -> Path | None:
    """The one file of a MuscleAnalysis that ends so, None if there is none."""
    found = sorted(folder.glob(f"*_{ending}.sto"))
    if len(found) > 1:
        raise ValueError(f"{folder} holds {len(found)} files *_{ending}.sto, expected one")
    return found[0] if found else None
