"""Calibration: stiffness, thickness and placement of an insert from measured poses and loads: build, solve.

Run ``python -m problems.calibration --help``.
"""

from problems.calibration.measurement import Measurement, read_measurement, synthetic_measurement
from problems.calibration.problem import DEFAULT, Calibration, build
from problems.calibration.solve import CalibrationResult, random_starts, solve

__all__ = [
    "DEFAULT",
    "Calibration",
    "CalibrationResult",
    "Measurement",
    "build",
    "random_starts",
    "read_measurement",
    "solve",
    "synthetic_measurement",
]
