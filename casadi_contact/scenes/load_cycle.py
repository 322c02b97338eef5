"""Measured cycles of a loaded joint: what a cycle holds, and how it is read from a CSV file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.scenes.columns import check_reach, checked_curves, read_columns, write_columns

# Column of the file for each curve of a cycle; other columns are ignored.
COLUMNS = {
    "time_s": "time_s",
    "rz": "flexion_rz_rad",
    "ry": "rotation_ry_rad",
    "fy_med": "Fy_med_N",
    "fy_lat": "Fy_lat_N",
    "cop_ap_mm": "cop_ap_mm",
    "cop_ml_mm": "cop_ml_mm",
}
KNEE_POSE_COLUMNS = frozenset({COLUMNS["rz"], COLUMNS["ry"]})  # by which a file is a knee's


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
class LoadCycle(OverTime):
    """Loads and measured rotations over one cycle, each (n,): time_s [s]; rz (flexion is negative) and ry [rad];
    fy_med, fy_lat [N], compression negative; centre of pressure cop_ap_mm = Tz/Fy, cop_ml_mm = -Tx/Fy."""

    name: str
    time_s: Array
    rz: Array
    ry: Array
    fy_med: Array
    fy_lat: Array
    cop_ap_mm: Array
    cop_ml_mm: Array

    def __post_init__(self) -> None:
        for key, curve in checked_curves(self.name, {key: getattr(self, key) for key in COLUMNS}).items():
            object.__setattr__(self, key, curve)
        for key in ("fy_med", "fy_lat"):
            if getattr(self, key).max() > 0.0:
                frame = int(np.argmax(getattr(self, key)))
                what = f"cycle {self.name}: {COLUMNS[key]} is {getattr(self, key)[frame]:g} at frame {frame}"
                raise ValueError(f"{what}, expected compression as negative numbers (contact cannot pull)")
        centres = {"cop_ap": self.cop_ap_mm, "cop_ml": self.cop_ml_mm}
        check_reach(f"cycle {self.name}", {**self.measured_pose(), **centres})
        check_centre(self.name, self.estimation_targets())

    def targets(self) -> dict[str, Array]:
        """Loads that hold the cycle's forces and centre of pressure: Tx = -cop_ml·Fy, Tz = cop_ap·Fy [N·mm]."""
        fy = self.fy_med + self.fy_lat
        return {
            "Fy_med": self.fy_med,
            "Fy_lat": self.fy_lat,
            "Tx": -self.cop_ml_mm * fy,
            "Tz": self.cop_ap_mm * fy,
        }

    def estimation_targets(self) -> dict[str, Array]:
        """Targets of pose estimation: the forces, and the centre of pressure itself."""
        return {"Fy_med": self.fy_med, "Fy_lat": self.fy_lat, "cop_ap": self.cop_ap_mm, "cop_ml": self.cop_ml_mm}

    def measured_pose(self) -> dict[str, Array]:
        """Pose parameters that fluoroscopy gives well enough to lock them [EF15 §3.3]."""
        return {"ry": self.ry, "rz": self.rz}


CONDYLE_MM = 22.0  # from a knee's middle to either side's force
_LENGTHS_MM = {"cm": 10.0, "inch": 25.4, "m": 1000.0}


def check_centre(name: str, values: Mapping[str, Array]) -> None:
    """Raise ValueError for a knee's centre of pressure in other units than mm, or on the other side of its forces. With
    m = (Fy_med - Fy_lat)/(Fy_med + Fy_lat), cop_ml is a + b·m, and b half the distance of the condyles: of least
    squares over the frames with 5 % of the largest load, 6 mm at least. Where m hardly varies nothing is known."""
    if not {"Fy_med", "Fy_lat", "cop_ml"} <= set(values):
        return
    medial, lateral = values["Fy_med"], values["Fy_lat"]
    loaded = np.abs(medial + lateral) > 0.05 * np.abs(medial + lateral).max()
    m = (medial - lateral)[loaded] / (medial + lateral)[loaded]
    if not len(m) or np.std(m) < 0.05:
        return
    slope_mm = float(np.polyfit(m, values["cop_ml"][loaded], 1)[0])
    if slope_mm < 6.0:
        units = [unit for unit, size in _LENGTHS_MM.items() if 0.5 < slope_mm * size / CONDYLE_MM < 2.0]
        cure = f"is its unit {units[0]}?" if units else "check its unit, sign and sides, and whether it is a left knee"
        raise ValueError(
            f"cycle {name}: cop_ml contradicts Fy_med and Fy_lat: between all load lateral and all medial it moves by "
            f"{2.0 * slope_mm:.2g} mm, expected the distance of the condyles, about {2.0 * CONDYLE_MM:g} mm: {cure}"
        )


def read_cycle(path: str | Path) -> LoadCycle:
    """Read a cycle from a CSV file with at least the columns of `COLUMNS`, in any order. Raises FileNotFoundError for
    no file, and ValueError naming file, line and column for missing columns, text among the numbers, ragged rows, NaN,
    fewer than 2 frames, unsorted time, pulling forces or suspected wrong units."""
    path = Path(path)
    columns = read_columns(path, required=tuple(COLUMNS.values()), what="cycle file")
    try:
        return LoadCycle(path.stem, **{key: columns[column] for key, column in COLUMNS.items()})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_cycle(cycle: LoadCycle, path: str | Path) -> None:
    """Write a CSV file that `read_cycle` reads back bit by bit."""
    write_columns(path, {column: getattr(cycle, key) for key, column in COLUMNS.items()})


def cycle_from_curves(name: str, curves: Mapping[str, Array]) -> LoadCycle:
    """A cycle from curves by name: time [s], rz, ry [rad], Fy_med, Fy_lat [N], and for each centre of pressure either
    itself (cop_ap, cop_ml [mm]) or the torque that gives it (cop_ap = Tz/Fy, cop_ml = -Tx/Fy [N·mm]). Raises ValueError
    for other curves, or as `LoadCycle` does."""
    chosen = ({"cop_ap", "Tz"}, {"cop_ml", "Tx"})
    needed = {"time", "rz", "ry", "Fy_med", "Fy_lat"}
    if set(curves) - chosen[0] - chosen[1] != needed or any(len(either & set(curves)) != 1 for either in chosen):
        raise ValueError(
            "a load cycle needs time, rz, ry, Fy_med, Fy_lat, cop_ap (or Tz), cop_ml (or Tx), poses tx ... rz "
            f"alone, another joint's cycle its scene (--scene); there are {', '.join(curves)}"
        )
    fy = curves["Fy_med"] + curves["Fy_lat"]
    if not {"cop_ap", "cop_ml"} <= set(curves) and not np.all(fy < 0.0):
        frame = int(np.argmax(fy >= 0.0))
        raise ValueError(f"frame {frame} has no compression, so that torques give no centre of pressure there")
    cop_ap = curves["cop_ap"] if "cop_ap" in curves else curves["Tz"] / fy
    cop_ml = curves["cop_ml"] if "cop_ml" in curves else -curves["Tx"] / fy
    time_s, rz, ry, fy_med, fy_lat = (curves[key] for key in ("time", "rz", "ry", "Fy_med", "Fy_lat"))
    return LoadCycle(name, time_s, rz, ry, fy_med, fy_lat, cop_ap, cop_ml)
