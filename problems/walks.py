"""Walks with muscles: read from CSV or OpenSim files, or made up."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.knee import COORDINATES, coordinate_unit
from casadi_contact.optimisation.muscle import MuscleParameters, MuscleWalk
from casadi_contact.scenes.columns import TextColumns, check_reach, check_rising, read_columns
from casadi_contact.scenes.opensim import ColumnMap, Table, mapped_curves, read_opensim_table
from casadi_contact.scenes.walking import reference_cycle

# How the rotations stand in the measured cycles' files (`casadi_contact.scenes.cycle`).
ROTATION_MAPS = (ColumnMap("flexion_rz_rad", "rz", unit="rad"), ColumnMap("rotation_ry_rad", "ry", unit="rad"))
PARAMETER_COLUMNS = ("max_isometric_force_N", "optimal_fibre_length_m", "tendon_slack_length_m", "pennation_rad")


def read_walk(
    rotations: Path, inverse_dynamics: Path, muscles: Path, parameters: Path, maps: Sequence[ColumnMap] = ROTATION_MAPS
) -> MuscleWalk:
    """Read a walk; all curves are taken at the times of inverse dynamics.

    rotations: CSV or .sto with time and the columns that maps turn into rz and ry.
    inverse_dynamics: CSV or .sto with time and coordinates of `COORDINATES` (``knee_ty`` or ``knee_ty_N``, N, N·m).
    muscles: CSV with ``frame, muscle, length_m, velocity_m_per_s, arm_knee_ty, ...``, a frame for each row of
    inverse dynamics; or a folder of OpenSim's MuscleAnalysis (``*_Length.sto``, ``*_MomentArm_knee_ty.sto``, ...).
    parameters: CSV with ``muscle`` and `PARAMETER_COLUMNS`, one row for each muscle that counts."""
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
    check_reach(str(rotations), {name: turns[name] for name in ("rz", "ry")})
    rz, ry = at_times(str(rotations), turns["time"], np.column_stack([turns["rz"], turns["ry"]]), time_s).T
    shared = [name for name in COORDINATES if name in loads and name in arms]
    loads, arms = ({name: each[name] for name in shared} for each in (loads, arms))
    title = inverse_dynamics.stem.removesuffix("_inverse_dynamics")
    return MuscleWalk(title, time_s, rz, ry, loads, arms, lengths, velocities, known)


def at_times(what: str, time_s: Array, curves: Array, needed_s: Array) -> Array:
    """Curves (k, c) at the times needed_s, (n, c), by straight lines; ValueError where these reach beyond them."""
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if needed_s[0] < time_s[0] - step or needed_s[-1] > time_s[-1] + step:
        needed = f"{needed_s[0]:g} to {needed_s[-1]:g} s as inverse dynamics: cut both to the same times"
        raise ValueError(f"{what} reaches from {time_s[0]:g} to {time_s[-1]:g} s, expected {needed}")
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
        wanted = f"expected one line for each of {len(time_s)} frames, from 0, and of {', '.join(names)}"
        raise ValueError(f"{path}: muscle {name} at frame {frame:g} is missing, twice there, or not known: {wanted}")
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


# muscle: greatest force [N], optimal fibre [m], pennation [rad], arms of adduction, rotation and flexion [m], pull
# along x, y and z. Sizes after Arnold et al., Ann Biomed Eng 38 (2010) 269-279, rounded; arms are constant here.
_MUSCLES = {
    "bflh": (700.0, 0.10, 0.20, -0.030, 0.020, -0.035, -0.15, -0.98, -0.13),
    "bfsh": (320.0, 0.11, 0.21, -0.035, 0.015, -0.030, -0.10, -0.99, -0.09),
    "gaslat": (610.0, 0.06, 0.21, -0.020, -0.018, -0.018, 0.62, -0.78, 0.08),
    "gasmed": (1310.0, 0.05, 0.17, 0.020, 0.013, -0.024, 0.52, -0.85, -0.06),
    "grac": (140.0, 0.23, 0.14, 0.035, -0.015, -0.040, -0.15, -0.99, 0.00),
    "recfem": (850.0, 0.08, 0.24, 0.000, 0.000, 0.045, 0.24, -0.97, -0.03),
    "sart": (110.0, 0.40, 0.02, 0.044, 0.008, -0.025, 0.10, -0.98, -0.14),
    "semimem": (1160.0, 0.07, 0.26, 0.020, -0.013, -0.042, -0.15, -0.99, 0.03),
    "semiten": (300.0, 0.19, 0.22, 0.018, -0.012, -0.050, -0.15, -0.99, 0.00),
    "tfl": (160.0, 0.10, 0.05, -0.041, 0.000, 0.008, 0.00, -1.00, 0.03),
    "vasint": (1020.0, 0.10, 0.08, -0.004, 0.000, 0.042, 0.26, -0.97, 0.00),
    "vaslat": (2260.0, 0.10, 0.32, -0.018, -0.001, 0.041, 0.22, -0.97, 0.04),
    "vasmed": (1440.0, 0.10, 0.52, 0.010, 0.000, 0.041, 0.28, -0.96, -0.07),
}


def example_walk(frames: int = 101) -> MuscleWalk:
    """A made-up walk of the usual size, at the rotations of the built-in reference cycle: knee_ty is the ground's push
    (two humps) less the shank's weight in swing; length = length0 - arm·rz, velocities follow from lengths."""
    cycle, slack_over_fibre = reference_cycle(frames), 2.0
    rz = cycle.pose["rz"]
    share = (cycle.time_s - cycle.time_s[0]) / (cycle.time_s[-1] - cycle.time_s[0])
    stance = 1.0 / (1.0 + np.exp((share - 0.62) / 0.02))
    early, late = _bump(share, 0.17, 0.11), _bump(share, 0.47, 0.11)
    loads = {
        "knee_tx": stance * 60.0 * (early + 2.0 * late) - 30.0,
        "knee_ty": stance * (250.0 + 320.0 * early + 330.0 * late) - 50.0,
        "knee_tz": 40.0 * stance * (early + late),
        "knee_adduction": -stance * (4.0 + 18.0 * early + 13.0 * late),
        "knee_rotation": stance * (1.0 + 6.0 * late),
        "knee_flexion": 20.0 * early - 16.0 * late + 14.0 * _bump(share, 0.61, 0.07) - 20.0 * _bump(share, 0.95, 0.06),
    }
    names, table = tuple(_MUSCLES), np.array(list(_MUSCLES.values()))
    force, fibre, pennation, adduction, rotation, flexion, *pulls = table.T
    arms = dict(zip(COORDINATES, (*pulls, adduction, rotation, flexion), strict=True))
    lengths = (slack_over_fibre + np.cos(pennation)) * fibre - np.outer(rz - rz.mean(), flexion)
    tables = {name: np.tile(arm, (frames, 1)) for name, arm in arms.items()}
    velocities = np.gradient(lengths, cycle.time_s, axis=0)
    muscles = MuscleParameters(names, force, fibre, slack_over_fibre * fibre, pennation)
    ry = cycle.pose["ry"]
    return MuscleWalk("built-in walk", cycle.time_s, rz, ry, loads, tables, lengths, velocities, muscles)


def _bump(share: Array, place: float, width: float) -> Array:
    """A bell of height 1 on the circle of the cycle."""
    away = (share - place + 0.5) % 1.0 - 0.5
    return np.exp(-((away / width) ** 2))
