"""One cycle of inverse dynamics and muscle geometry: what it holds and how it is read.

Moment arms are arm = -∂length/∂coordinate: metres for rotations, direction cosines for translations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.knee import COORDINATES, coordinate_unit, is_translation
from casadi_contact.optimisation.muscle import MuscleParameters
from casadi_contact.scenes.columns import TextColumns, check_radians, check_rising, read_columns
from casadi_contact.scenes.load_cycle import OverTime
from casadi_contact.scenes.opensim import ColumnMap, Table, mapped_curves, read_opensim_table

# How the rotations stand in the measured cycles' files (`casadi_contact.scenes.load_cycle`).
ROTATION_MAPS = (ColumnMap("flexion_rz_rad", "rz", unit="rad"), ColumnMap("rotation_ry_rad", "ry", unit="rad"))
PARAMETER_COLUMNS = ("max_isometric_force_N", "optimal_fibre_length_m", "tendon_slack_length_m", "pennation_rad")


@dataclass(frozen=True)
class MuscleWalk(OverTime):
    """One cycle of n frames and m muscles.

    time_s, rz, ry (n,); loads (n,) [N, N·m] and arms (n, m) by coordinate of `COORDINATES`; lengths_m and
    velocities_m_per_s (n, m) of the musculotendons, lengthening positive; parameters of the muscles.
    Raises ValueError for wrong shapes, numbers that are not finite, unsorted time, and units or signs that no knee has.
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
        curves = {"rz": self.rz, "ry": self.ry, **{f"load {name}": curve for name, curve in self.loads.items()}}
        tables = {"lengths": self.lengths_m, "velocities": self.velocities_m_per_s}
        tables |= {f"arms about {name}": table for name, table in self.arms.items()}
        for shape, named in (((frames,), curves), ((frames, count), tables)):
            for what, values in named.items():
                if values.shape != shape or not np.isfinite(values).all():
                    raise ValueError(
                        f"walk {self.name}: {what} has shape {values.shape}, expected finite numbers of shape {shape}"
                    )
        check_rising(f"walk {self.name}", self.time_s)
        if set(self.loads) != set(self.arms) or not set(self.loads) <= set(COORDINATES):
            raise ValueError(
                f"walk {self.name}: got loads of {', '.join(self.loads)} and arms about {', '.join(self.arms)}, "
                f"expected the same coordinates in both, of {', '.join(COORDINATES)}"
            )
        _check_units_and_signs(self)

    def check_has(self, coordinates: Iterable[str]) -> None:
        """ValueError for coordinates of which the walk has no loads and arms."""
        if missing := [name for name in coordinates if name not in self.loads]:
            raise ValueError(
                f"walk {self.name} has loads and arms of {', '.join(self.loads)}, expected {', '.join(missing)} too: "
                "add their columns to inverse dynamics (knee_ty_N) and muscles (arm_knee_ty)"
            )


def _check_units_and_signs(walk: MuscleWalk) -> None:
    """ValueError for lengths and arms in mm, loads over body weight, and reversed signs of arms or velocities."""

    def fail(got: str, expected: str, cure: str) -> ValueError:
        return ValueError(f"walk {walk.name}: {got}, expected {expected}: {cure}")

    if walk.lengths_m.min() <= 0.0 or walk.lengths_m.max() > 2.0:
        raise fail(f"lengths reach {walk.lengths_m.max():g} m", "above 0, at most 2 m", "is their unit mm?")
    for name, table in walk.arms.items():
        limit, unit = (1.5, "direction cosines") if is_translation(name) else (0.3, "m")
        if np.abs(table).max() > limit:
            raise fail(f"arms about {name} reach {np.abs(table).max():g}", f"{unit} up to {limit:g}", "check the unit")
    for unit, least, most in (("N", 10.0, np.inf), ("Nm", 1.5, 1e3)):
        curves = [np.abs(curve).max() for name, curve in walk.loads.items() if coordinate_unit(name) == unit]
        if curves and not (max(curves) == 0.0 or least <= max(curves) <= most):
            raise fail(f"loads reach {max(curves):g} {unit}", "those of a body", "check the unit (body weight? N·mm?)")
    if "knee_ty" in walk.arms and walk.arms["knee_ty"].mean() > 0.0:
        raise fail(
            "mean arm about knee_ty is positive", "arm = -dlength/dcoordinate, negative", "turn the sign of arms"
        )
    rates = np.gradient(walk.lengths_m, walk.time_s, axis=0)
    if len(walk.time_s) >= 10 and (rates * walk.velocities_m_per_s).sum() < 0.0:  # fewer do not tell rates
        raise fail("muscles lengthen at negative velocity", "v = dlength/dt", "turn the sign of velocities")


def read_walk(
    rotations: Path,
    inverse_dynamics: Path,
    muscles: Path,
    parameters: Path,
    maps: Sequence[ColumnMap] = ROTATION_MAPS,
) -> MuscleWalk:
    """Read a walk; all curves are taken at the times of inverse dynamics.

    rotations: CSV or .sto with time and the columns that maps turn into rz and ry.
    inverse_dynamics: CSV or .sto with time and coordinates of `COORDINATES` (``knee_ty`` or ``knee_ty_N``, N, N·m).
    muscles: CSV with ``frame, muscle, length_m, velocity_m_per_s, arm_knee_ty, ...``, a frame for each row of
    inverse dynamics; or a folder of OpenSim's MuscleAnalysis (``*_Length.sto``, ``*_MomentArm_knee_ty.sto``, ...).
    parameters: CSV with ``muscle`` and `PARAMETER_COLUMNS`, one row for each muscle that counts.
    Raises FileNotFoundError for no file and ValueError for what cannot be used.
    """
    labels = {label: name for name in COORDINATES for label in (name, f"{name}_{coordinate_unit(name)}")}
    dynamics = _table(inverse_dynamics, optional=list(labels)).columns
    time_s = dynamics["time"]
    loads = {name: dynamics[label] for label, name in labels.items() if label in dynamics}
    if not loads:
        raise ValueError(f"{inverse_dynamics} has none of the columns {', '.join(COORDINATES)}")
    text = TextColumns.read(parameters)
    numbers = [text.numbers(column) for column in PARAMETER_COLUMNS]
    known = MuscleParameters(tuple(text.text("muscle")), *numbers)
    lengths, velocities, arms = (_analysis if muscles.is_dir() else _geometry)(muscles, known.names, time_s)
    turns = mapped_curves(_table(rotations, required=[item.column for item in maps]), maps)
    if not {"rz", "ry"} <= set(turns):
        raise ValueError(f"{rotations} is mapped to {', '.join(turns)}, expected columns for rz and ry")
    for name in ("rz", "ry"):
        check_radians(str(rotations), name, turns[name])
    rz, ry = at_times(str(rotations), turns["time"], np.column_stack([turns["rz"], turns["ry"]]), time_s).T
    shared = [name for name in COORDINATES if name in loads and name in arms]
    return MuscleWalk(
        name=inverse_dynamics.stem.removesuffix("_inverse_dynamics"),
        time_s=time_s,
        rz=rz,
        ry=ry,
        loads={name: loads[name] for name in shared},
        arms={name: arms[name] for name in shared},
        lengths_m=lengths,
        velocities_m_per_s=velocities,
        muscles=known,
    )


def at_times(what: str, time_s: Array, curves: Array, needed_s: Array) -> Array:
    """Curves (k, c) at the times needed_s, (n, c), by straight lines.

    Raises ValueError where they leave out more than one of their own steps at an end.
    """
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if needed_s[0] < time_s[0] - step or needed_s[-1] > time_s[-1] + step:
        raise ValueError(
            f"{what} reaches from {time_s[0]:g} to {time_s[-1]:g} s, expected {needed_s[0]:g} to {needed_s[-1]:g} s as "
            "inverse dynamics: cut both to the same times"
        )
    return np.column_stack([np.interp(needed_s, time_s, curve) for curve in curves.T])


def _table(path: Path, required: Sequence[str] = (), optional: Sequence[str] = ()) -> Table:
    """These columns of a CSV file, or a whole OpenSim file, as a table whose time [s] rises."""
    if path.suffix.lower() in (".sto", ".mot"):
        table = read_opensim_table(path)
    else:
        columns = read_columns(path, required=("time_s", *required), optional=optional)
        table = Table(path.stem, {"time": columns.pop("time_s"), **columns})
    check_rising(str(path), table.column("time"))
    return table


def _geometry(path: Path, names: tuple[str, ...], time_s: Array) -> tuple[Array, Array, dict[str, Array]]:
    """Lengths, velocities (n, m) and arms by coordinate from a CSV with one line for each frame and muscle."""
    table = TextColumns.read(path)
    table.require("frame", "muscle", "length_m", "velocity_m_per_s")
    rows = {key: k for k, key in enumerate(zip(table.numbers("frame"), table.text("muscle"), strict=True))}
    expected = {(float(frame), name) for frame in range(len(time_s)) for name in names}
    if set(rows) != expected or len(rows) != len(table.rows):
        frame, name = min(set(rows) ^ expected or {(0.0, names[0])})
        raise ValueError(
            f"{path}: muscle {name} at frame {frame:g} is missing, twice there, or not expected: expected one line for "
            f"each of {len(time_s)} frames, from 0, and each of the muscles {', '.join(names)}"
        )
    order = np.array([[rows[float(frame), name] for name in names] for frame in range(len(time_s))])
    arms = {name: table.numbers(f"arm_{name}")[order] for name in COORDINATES if f"arm_{name}" in table.header}
    return table.numbers("length_m")[order], table.numbers("velocity_m_per_s")[order], arms


def _analysis(folder: Path, names: tuple[str, ...], time_s: Array) -> tuple[Array, Array, dict[str, Array]]:
    """The same from the files that OpenSim's MuscleAnalysis writes; velocities are derivatives of the lengths."""

    def curves(ending: str, order: int = 0) -> Array | None:
        found = sorted(folder.glob(f"*_{ending}.sto"))
        if not found:
            return None
        table = read_opensim_table(found[0])
        known_s, values = table.column("time"), np.column_stack([table.column(name) for name in names])
        at_times(str(found[0]), known_s, values, time_s)
        return np.asarray(CubicSpline(known_s, values)(np.clip(time_s, known_s[0], known_s[-1]), order))

    lengths, velocities = curves("Length"), curves("Length", 1)
    if lengths is None or velocities is None:
        raise FileNotFoundError(f"folder {folder} holds no file *_Length.sto")
    arms = {name: curves(f"MomentArm_{name}") for name in COORDINATES}
    return lengths, velocities, {name: table for name, table in arms.items() if table is not None}
