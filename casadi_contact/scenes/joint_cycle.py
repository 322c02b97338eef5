"""Cycles of any joint: measured pose parameters and loads by name, from a CSV file or a scene's own harmonics.

A scene's ``[motion]`` describes a reference motion:

    cycles = 10, duration_s = 1.1, deviation = 0.05
    [motion.harmonics]     c_0, then cosine and sine of 1, 2, ... periods per cycle
    rz_rad = [-0.17, -0.35, 0.0]
    Fy_N = [900.0, 400.0, 300.0]

Each cycle's coefficients are drawn about these; their standard deviation is `deviation` times the curve's largest
harmonic (of its constant, for a curve without harmonics).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array, possible_loads
from casadi_contact.core.files.reading import short
from casadi_contact.core.quantities import quantity
from casadi_contact.scenes.columns import TextColumns, check_reach, checked_curves, write_columns
from casadi_contact.scenes.load_cycle import OverTime, check_centre
from casadi_contact.scenes.opensim import UNITS
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import fail, number, numbers, table_of

MOST_CYCLES, MOST_COEFFICIENTS = 1000, 99
_CENTRES = ("cop_x", "cop_y", "cop_z", "cop_ap", "cop_ml")  # the last two are the names of a knee's load cycle


@dataclass(frozen=True)
class JointCycle(OverTime):
    """Measured pose parameters [mm, rad], loads [N, N·mm] and centres of pressure [mm] by name over time_s [s], each
    (n,). Raises ValueError as `checked_curves` does, for no load, for angles too large for
    radians, and for lengths beyond 1 m."""

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
        if not self.loads:
            raise ValueError(f"cycle {self.name} has no load, expected those that hold the pose")
        check_reach(f"cycle {self.name}", {**self.pose, **self.centres})
        check_centre(self.name, self.estimation_targets())

    def measured_pose(self) -> Mapping[str, Array]:
        """The measured pose parameters."""
        return self.pose

    def targets(self) -> Mapping[str, Array]:
        """The measured loads."""
        return self.loads

    def estimation_targets(self) -> Mapping[str, Array]:
        """Targets of pose estimation: the measured loads and centres of pressure."""
        return {**self.loads, **self.centres}


def column_names(load_names: Sequence[str]) -> dict[str, str]:
    """Name of a pose parameter or load -> its column in a CSV file, with the unit: tx_mm, rz_rad, Fy_med_N, Tx_Nmm."""
    return {name: quantity(name).column for name in (*POSE_NAMES, *load_names)}


def driving_loads(scene: Scene) -> tuple[str, ...]:
    """The loads that a scene's cycles may contain: its own loads, the normal loads, and those of its [motion]."""
    harmonics = scene.motion.get("harmonics")
    columns = {quantity(name).column: name for name in possible_loads(scene.patch_names)}
    own = [columns[column] for column in harmonics if column in columns] if isinstance(harmonics, Mapping) else []
    pressing = [name for normal in scene.controllable_normal_loads for name in normal.loads]
    return tuple(dict.fromkeys((*scene.load_names, *pressing, *own)))


def read_joint_cycle(path: str | Path, scene: Scene) -> JointCycle:
    """Read a cycle from a CSV file: time_s, and those of the scene's pose parameters, `driving_loads` and centres of
    pressure (cop_x, cop_y, cop_z; cop_ap, cop_ml) that were measured. A column's name ends with its unit: rz_rad or
    rz_deg, tx_mm or tx_m, Fy_N or Fy_kN, Tx_Nmm or Tx_Nm. Other columns are ignored. Raises FileNotFoundError, and
    ValueError naming file, line and column, also for a column with a quantity's name without a known unit."""
    path = Path(path)
    known = driving_loads(scene)
    table = TextColumns.read(path, "cycle file")
    curves, used = {"time": table.numbers("time_s")}, {"time_s"}
    for name in (*POSE_NAMES, *known, *_CENTRES):
        for unit, scale in UNITS[quantity(name).kind].items():
            if (column := f"{name}_{unit}") in table.header:
                curves[name] = scale * table.numbers(column)
                used.add(column)
    for column in table.header:
        name = column if column in (*POSE_NAMES, *known, *_CENTRES) else column.rpartition("_")[0]
        if column not in used and name in (*POSE_NAMES, *known, *_CENTRES):
            units = ", ".join(f"{name}_{unit}" for unit in UNITS[quantity(name).kind])
            raise ValueError(f"{path} has the column {column}, expected its unit at the end: {units}")
    if not any(name in curves for name in known):
        raise ValueError(
            f"{path} has no load of scene {scene.name}, expected some of "
            f"{', '.join(quantity(name).column for name in known)}; it has {short(', '.join(table.header))}"
        )
    try:
        return joint_cycle_from_curves(path.stem, curves, scene)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def joint_cycle_from_curves(name: str, curves: Mapping[str, Array], scene: Scene) -> JointCycle:
    """A cycle of a scene from curves by name: time [s], pose parameters [mm, rad], `driving_loads` [N, N·mm] and
    centres of pressure cop_x, cop_y, cop_z, cop_ap, cop_ml [mm]. Raises ValueError for other names, or as `JointCycle`
    does."""
    kinds = (POSE_NAMES, driving_loads(scene), _CENTRES)
    known = ("time", *(each for kind in kinds for each in kind))
    if foreign := [each for each in curves if each not in known]:
        raise ValueError(
            f"a cycle of scene {scene.name} has no place for {', '.join(foreign)}, expected some of {', '.join(known)}"
        )
    pose, loads, centres = ({each: curves[each] for each in kind if each in curves} for kind in kinds)
    return JointCycle(name, curves["time"], pose, loads, centres)


def write_joint_cycle(cycle: JointCycle, path: str | Path) -> None:
    """Write a CSV file that `read_joint_cycle` reads back bit by bit."""
    curves = {**cycle.pose, **cycle.loads, **cycle.centres}
    write_columns(path, {"time_s": cycle.time_s, **{quantity(name).column: curve for name, curve in curves.items()}})


def scene_cycles(scene: Scene, *, frames: int = 101, seed: int = 2015) -> list[JointCycle]:
    """The reference motion of a scene's [motion], the same for a seed. Raises ValueError for a scene without one, and
    for a bad value with its key."""
    if not scene.motion:
        raise ValueError(f"scene {scene.name} has no [motion], expected it there or a cycle file")
    optional = ("cycles", "duration_s", "deviation")
    motion = table_of("motion", scene.motion, ("harmonics",), complete=True, optional=optional)
    columns = {column: name for name, column in column_names(possible_loads(scene.patch_names)).items()}
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
        cycles.append(JointCycle(f"reference {k + 1}", time, pose, loads))
    return cycles


def harmonic_curve(coefficients: Array, share: Array) -> Array:
    """c_0 + Σ_k c_{2k-1} cos(2πkp) + c_{2k} sin(2πkp) over the share p of the cycle."""
    angles = 2.0 * np.pi * np.outer(share, np.arange(1, len(coefficients) // 2 + 1))
    return coefficients[0] + np.cos(angles) @ coefficients[1::2] + np.sin(angles) @ coefficients[2::2]
