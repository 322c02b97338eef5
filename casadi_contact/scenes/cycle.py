"""Cycles of a loaded joint: measured pose parameters and loads by name, from a CSV file or a scene's own harmonics.

A scene's ``[motion]`` describes a reference motion:

    cycles = 10, duration_s = 1.1, deviation = 0.05
    [motion.harmonics]     c_0, then cosine and sine of 1, 2, ... periods per cycle
    rz_rad = [-0.17, -0.35, 0.0]
    Fy_N = [900.0, 400.0, 300.0]

Each cycle's coefficients are drawn about these; their standard deviation is `deviation` times the curve's largest
harmonic (of its constant, for a curve without harmonics).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array, possible_loads
from casadi_contact.core.files.reading import short
from casadi_contact.core.quantities import quantity
from casadi_contact.scenes.columns import TextColumns, check_reach, checked_curves, write_columns
from casadi_contact.scenes.opensim import UNITS
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import fail, number, numbers, table_of

MOST_CYCLES, MOST_COEFFICIENTS = 1000, 99
CONDYLE_MM = 22.0  # from a knee's middle to either side's force
_LENGTHS_MM = {"cm": 10.0, "inch": 25.4, "m": 1000.0}
_CENTRES = ("cop_x", "cop_y", "cop_z", "cop_ap", "cop_ml")  # the last two are a knee's names
_KNEE_NAMES = {"flexion_rz": "rz", "rotation_ry": "ry"}
KNEE_COLUMNS = ("flexion_rz_rad", "rotation_ry_rad", "Fy_med_N", "Fy_lat_N", "cop_ap_mm", "cop_ml_mm")


class OverTime:
    """One cycle of n frames over time_s (n,) [s]."""

    time_s: Array

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def percent(self) -> Array:
        """Percentage of the cycle (n,), 0 to 100."""
        return 100.0 * (self.time_s - self.time_s[0]) / (self.time_s[-1] - self.time_s[0])


@dataclass(frozen=True)
class Cycle(OverTime):
    """Measured pose parameters [mm, rad], loads [N, N·mm] and centres of pressure [mm] by name over time_s [s], each
    (n,); of a knee rz (flexion is negative) and ry, Fy_med and Fy_lat (compression is negative), cop_ap = Tz/Fy and
    cop_ml = -Tx/Fy. Raises ValueError as `checked_curves` does, for no load, angles too large for radians, lengths
    beyond 1 m, and loads that no knee has (`_check_knee`)."""

    name: str
    time_s: Array
    pose: Mapping[str, Array]
    loads: Mapping[str, Array]
    centres: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        curves = {"time_s": self.time_s, **self.pose, **self.loads, **self.centres}
        checked = checked_curves(self.name, curves)
        object.__setattr__(self, "time_s", checked["time_s"])
        for key in ("pose", "loads", "centres"):
            object.__setattr__(self, key, {name: checked[name] for name in getattr(self, key)})
        if not self.loads and set(self.pose) != set(POSE_NAMES):
            raise ValueError(f"cycle {self.name} has no load, expected those that hold the pose, or all of the pose")
        check_reach(f"cycle {self.name}", {**self.pose, **self.centres})
        if self._of_knee:
            _check_knee(self.name, self.estimation_targets())

    @property
    def _of_knee(self) -> bool:
        return {"Fy_med", "Fy_lat"} <= set(self.loads) and {"cop_ap", "cop_ml"} <= set(self.centres)

    def targets(self) -> dict[str, Array]:
        """The measured loads, and torques [N·mm] of a knee's centre of pressure: Tx = -cop_ml·Fy, Tz = cop_ap·Fy."""
        if not self._of_knee:
            return {**self.loads}
        fy = self.loads["Fy_med"] + self.loads["Fy_lat"]
        return {**self.loads, "Tx": -self.centres["cop_ml"] * fy, "Tz": self.centres["cop_ap"] * fy}

    def estimation_targets(self) -> dict[str, Array]:
        """Targets of pose estimation: the measured loads and centres of pressure."""
        return {**self.loads, **self.centres}


def _check_knee(name: str, values: Mapping[str, Array]) -> None:
    """Raise ValueError for forces that pull on a side, and for a centre of pressure in other units than mm, or on the
    other side of its forces. With m = (Fy_med - Fy_lat)/(Fy_med + Fy_lat), cop_ml is a + b·m, and b half the distance
    of the condyles: of least squares over the frames with 5 % of the largest load, 6 mm at least, where m varies."""
    medial, lateral = values["Fy_med"], values["Fy_lat"]
    for side, force in (("Fy_med", medial), ("Fy_lat", lateral)):
        if force.max() > 0.0:
            said = f"cycle {name}: {side} is {force.max():g} N at frame {force.argmax()}"
            raise ValueError(f"{said}, expected compression as negative numbers (contact cannot pull)")
    loaded = np.abs(medial + lateral) > 0.05 * np.abs(medial + lateral).max()
    m = (medial - lateral)[loaded] / (medial + lateral)[loaded]
    if not len(m) or np.std(m) < 0.05:
        return
    slope_mm = float(np.polyfit(m, values["cop_ml"][loaded], 1)[0])
    if slope_mm < 6.0:
        units = [unit for unit, size in _LENGTHS_MM.items() if 0.5 < slope_mm * size / CONDYLE_MM < 2.0]
        cure = f"is its unit {units[0]}?" if units else "check its unit, sign and sides, and whether it is a left knee"
        got = f"between all load lateral and all medial it moves by {2.0 * slope_mm:.2g} mm"
        expected = f"the distance of the condyles, about {2.0 * CONDYLE_MM:g} mm"
        raise ValueError(f"cycle {name}: cop_ml contradicts Fy_med and Fy_lat: {got}, expected {expected}: {cure}")


def driving_loads(scene: Scene | None) -> tuple[str, ...]:
    """The loads that cycles of a scene (else of a knee) may contain: its own, the normal loads, those of [motion]."""
    if scene is None:
        return possible_loads(("med", "lat"))
    harmonics = scene.motion.get("harmonics")
    columns = {quantity(name).column: name for name in possible_loads(scene.patch_names)}
    own = [columns[column] for column in harmonics if column in columns] if isinstance(harmonics, Mapping) else []
    pressing = [name for normal in scene.controllable_normal_loads for name in normal.loads]
    return tuple(dict.fromkeys((*scene.load_names, *pressing, *own)))


def read_cycle(path: str | Path, scene: Scene | None = None) -> Cycle:
    """Read a cycle of a scene, a knee's if left out, from a CSV file: time_s, and those of the pose parameters,
    `driving_loads` and centres of pressure (cop_x, cop_y, cop_z; cop_ap, cop_ml) that were measured. A column's name
    ends with its unit: rz_rad or rz_deg, tx_mm or tx_m, Fy_N or Fy_kN, Tx_Nmm or Tx_Nm. A file with flexion_rz_rad or
    rotation_ry_rad has all of `KNEE_COLUMNS`, and nothing else of it is read. Other columns are ignored. Raises
    FileNotFoundError, and ValueError naming file, line and column, also for a quantity without a known unit."""
    path, loads = Path(path), driving_loads(scene)
    known, table = {*POSE_NAMES, *loads, *_CENTRES}, TextColumns.read(path, "cycle file")
    curves, header = {"time": table.numbers("time_s")}, table.header
    if set(KNEE_COLUMNS[:2]) & set(header):
        table.require(*KNEE_COLUMNS)
        if beside := [column for column in header if (column.rpartition("_")[0] or column) in POSE_NAMES]:
            cure = f"leave them out, or rename {' and '.join(KNEE_COLUMNS[:2])} to rz_rad and ry_rad"
            raise ValueError(f"{path} has {', '.join(beside)} beside a knee's own columns: {cure}")
        header = KNEE_COLUMNS
    for column in header:
        name, _, unit = (column, "", "") if column in known else column.rpartition("_")
        name = _KNEE_NAMES.get(name, name)
        if name in known:
            units = UNITS[quantity(name).kind]
            if unit not in units:
                expected = ", ".join(f"{name}_{of}" for of in units)
                raise ValueError(f"{path} has the column {column}, expected its unit at the end: {expected}")
            if name in curves:
                raise ValueError(f"{path} has {name} in two columns, {column} and another, expected one: leave one out")
            curves[name] = units[unit] * table.numbers(column)
    if not set(loads) & set(curves) and not set(POSE_NAMES) <= set(curves):
        columns = ", ".join(quantity(name).column for name in loads)
        has = f"it has {short(', '.join(table.header))}"
        raise ValueError(f"{path} has no load of {scene.name if scene else 'a knee'}, expected one of {columns}; {has}")
    try:
        return cycle_from_curves(path.stem, curves, scene)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def cycle_from_curves(name: str, curves: Mapping[str, Array], scene: Scene | None = None) -> Cycle:
    """A cycle from curves by name: time [s], pose parameters [mm, rad], `driving_loads` [N, N·mm] and centres of
    pressure cop_x, cop_y, cop_z, cop_ap, cop_ml [mm]. Raises ValueError for other names, or as `Cycle` does."""
    kinds = (POSE_NAMES, driving_loads(scene), _CENTRES)
    known = ("time", *(each for kind in kinds for each in kind))
    if foreign := [each for each in curves if each not in known]:
        raise ValueError(f"a cycle has no place for {', '.join(foreign)}, expected some of {', '.join(known)}")
    pose, loads, centres = ({each: curves[each] for each in kind if each in curves} for kind in kinds)
    return Cycle(name, curves["time"], pose, loads, centres)


def write_cycle(cycle: Cycle, path: str | Path) -> None:
    """Write a CSV file that `read_cycle` reads back bit by bit."""
    curves = {**cycle.pose, **cycle.loads, **cycle.centres}
    write_columns(path, {"time_s": cycle.time_s, **{quantity(name).column: curve for name, curve in curves.items()}})


def scene_cycles(scene: Scene, *, frames: int = 101, seed: int = 2015) -> list[Cycle]:
    """The reference motion of a scene's [motion], the same for a seed. Raises ValueError without one, or for a key."""
    if not scene.motion:
        raise ValueError(f"scene {scene.name} has no [motion], expected it there or a build around --cycles")
    optional = ("cycles", "duration_s", "deviation")
    motion = table_of("motion", scene.motion, ("harmonics",), complete=True, optional=optional)
    names = (*POSE_NAMES, *possible_loads(scene.patch_names))
    columns = {quantity(name).column: name for name in names}
    count = motion.get("cycles", 10)
    if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= MOST_CYCLES:
        raise fail("motion.cycles", count, f"a whole number from 2 to {MOST_CYCLES}")
    duration = number("motion.duration_s", motion.get("duration_s", 1.0), low=0.0)
    deviation = number("motion.deviation", motion.get("deviation", 0.05))
    if deviation < 0.0:
        raise fail("motion.deviation", deviation, "a number of 0 or more")
    harmonics = table_of("motion.harmonics", motion["harmonics"], (), complete=False, optional=tuple(columns))
    means = {}
    for column, coefficients in harmonics.items():
        key, sizes = f"motion.harmonics.{column}", range(1, MOST_COEFFICIENTS + 1, 2)
        means[columns[column]] = np.array(numbers(key, coefficients, None, quantity(columns[column]).unit))
        if len(coefficients) not in sizes:
            raise fail(key, coefficients, f"1, 3, 5, ... numbers, {MOST_COEFFICIENTS} at most")
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, float(duration), frames)
    cycles = []
    for k in range(count):
        curves = {}
        for name, mean in means.items():
            spread = deviation * np.abs(mean[1:] if len(mean) > 1 else mean).max()
            curves[name] = harmonic_curve(mean + spread * rng.standard_normal(len(mean)), time / duration)
        pose = {name: curve for name, curve in curves.items() if name in POSE_NAMES}
        loads = {name: curve for name, curve in curves.items() if name not in POSE_NAMES}
        cycles.append(Cycle(f"reference {k + 1}", time, pose, loads))
    return cycles


def harmonic_curve(coefficients: Array, share: Array) -> Array:
    """c_0 + Σ_k c_{2k-1} cos(2πkp) + c_{2k} sin(2πkp) over the share p of the cycle."""
    angles = 2.0 * np.pi * np.outer(share, np.arange(1, len(coefficients) // 2 + 1))
    return coefficients[0] + np.cos(angles) @ coefficients[1::2] + np.sin(angles) @ coefficients[2::2]
