"""What curves over time have to be, whatever they are of: in SI units but mm, finite, and in the order of time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array

_LARGEST = 1e15  # squares of more drown all else; 1e20, 1e30 and the like stand for a missing value in other programs
_LARGEST_LENGTH_MM = 1000.0  # no joint's bodies are a metre apart: a file in mm was taken for one in m
_LARGEST_ANGLE_RAD = 3.5  # beyond 200 degrees of flexion an angle is in other units


def check_radians(where: str, column: str, angles: Array) -> None:
    """ValueError for angles (n,) of a column beyond 200 degrees, too large for radians; where: what it is of, "" if the
    caller says so."""
    if (largest := float(np.abs(angles).max())) > _LARGEST_ANGLE_RAD:
        raise ValueError(f"{_before(where)}{column} reaches {largest:g}, expected radians: is it in degrees?")


def check_lengths(where: str, column: str, lengths_mm: Array) -> None:
    """ValueError for lengths (n,) [mm] of a column beyond 1 m; where: as in `check_radians`."""
    if (largest := float(np.abs(lengths_mm).max())) > _LARGEST_LENGTH_MM:
        raise ValueError(
            f"{_before(where)}{column} reaches {largest:g} mm, expected a joint's: is the file in mm, and not in m?"
        )


def check_size(where: str, column: str, numbers: Array) -> None:
    """ValueError for numbers (n,) of a column beyond 1e15; where: what the column is of."""
    if (large := np.abs(numbers) > _LARGEST).any():
        row = int(large.argmax())
        raise ValueError(
            f"{where}: {column} is {numbers[row]:g} in row {row + 1}, expected numbers within {_LARGEST:g}: remove "
            "rows of missing values"
        )


def check_rising(where: str, time_s: Array) -> None:
    """ValueError for times (n,) [s] of fewer than 2 frames, or that do not rise; where: what they are of, "" if the
    caller says so."""
    if len(time_s) < 2:
        raise ValueError(f"{where} has {len(time_s)} frames, expected at least 2")
    if np.any(held := np.diff(time_s) <= 0.0):
        frame = int(held.argmax()) + 1
        raise ValueError(
            f"{_before(where)}time does not rise at frame {frame}, {time_s[frame]:g} s after {time_s[frame - 1]:g} s, "
            "expected rows sorted by time, and none twice"
        )


def _before(where: str) -> str:
    return f"{where}: " if where else ""


def checked_curves(cycle: str, curves: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Curves (n,) of a cycle by name, time_s [s] among them. Raises ValueError for other shapes, numbers that are not
    finite or beyond 1e15, fewer than 2 frames, and a time that does not rise."""
    count = len(np.atleast_1d(curves["time_s"]))
    checked = {key: np.asarray(curve, dtype=float) for key, curve in curves.items()}
    for key, curve in checked.items():
        if curve.shape != (count,) or not np.isfinite(curve).all():
            raise ValueError(f"cycle {cycle}: {key} is not {count} finite numbers")
        check_size(f"cycle {cycle}", key, curve)
    check_rising(f"cycle {cycle}", checked["time_s"])
    return checked
