"""Checks of curves over time: finite numbers, rising times, and the sizes that a joint's angles and lengths have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array


def check_radians(where: str, column: str, angles: Array, largest_rad: float = 3.5) -> None:
    """ValueError for angles (n,) beyond 200 degrees: they are in other units. where: the file or cycle, "" if none."""
    if (reached := float(np.abs(angles).max())) > largest_rad:
        raise ValueError(f"{_before(where)}{column} reaches {reached:g}, expected radians: is it in degrees?")


def check_lengths(where: str, column: str, lengths_mm: Array, largest_mm: float = 1000.0) -> None:
    """ValueError for lengths (n,) [mm] beyond 1 m: the file is in mm already."""
    if (reached := float(np.abs(lengths_mm).max())) > largest_mm:
        raise ValueError(f"{_before(where)}{column} reaches {reached:g} mm, expected a joint's: is the file in mm?")


def check_size(where: str, column: str, numbers: Array, largest: float = 1e15) -> None:
    """ValueError for numbers (n,) beyond 1e15, which other programs write for a missing value."""
    if (large := np.abs(numbers) > largest).any():
        row = int(large.argmax())
        raise ValueError(
            f"{where}: {column} is {numbers[row]:g} in row {row + 1}, expected numbers within {largest:g}: remove "
            "rows of missing values"
        )


def check_rising(where: str, time_s: Array) -> None:
    """ValueError for times (n,) [s] of fewer than 2 frames, or that do not rise."""
    if len(time_s) < 2:
        raise ValueError(f"{where} has {len(time_s)} frames, expected at least 2")
    if np.any(still := np.diff(time_s) <= 0.0):
        frame = int(still.argmax()) + 1
        raise ValueError(
            f"{_before(where)}time does not rise at frame {frame}, {time_s[frame]:g} s after {time_s[frame - 1]:g} s, "
            "expected rows sorted by time, and none twice"
        )


def checked_curves(cycle: str, curves: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Curves (n,) of a cycle by name, time_s [s] among them, as arrays; raises ValueError as the checks above do."""
    count = len(np.atleast_1d(curves["time_s"]))
    checked = {key: np.asarray(curve, dtype=float) for key, curve in curves.items()}
    for key, curve in checked.items():
        if curve.shape != (count,) or not np.isfinite(curve).all():
            raise ValueError(f"cycle {cycle}: {key} is not {count} finite numbers")
        check_size(f"cycle {cycle}", key, curve)
    check_rising(f"cycle {cycle}", checked["time_s"])
    return checked


def _before(where: str) -> str:
    return f"{where}: " if where else ""
