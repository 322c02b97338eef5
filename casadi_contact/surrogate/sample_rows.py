"""Checks on samples before they become training targets."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.samples.samples import TEST, VALIDATION, Samples


def fitted_rows(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Mask (n,) of training and validation rows, and among these the mask of validation rows."""
    role = np.asarray(samples.role)
    rows = role != TEST
    nonempty("training", rows & (role != VALIDATION))
    return rows, role[rows] == VALIDATION


def nonempty(what: str, rows: np.ndarray) -> None:
    """Raises ValueError if no row is left."""
    if not rows.any():
        raise ValueError(f"samples hold no row for {what}, expected at least one: draw them, or add them to the table")


def finite(name: str, values: Array) -> Array:
    """Pass finite values through; raises ValueError naming the first bad row otherwise."""
    bad = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if bad.any():
        raise ValueError(f"samples hold NaN or infinity in {name} at row {int(np.argmax(bad))}, expected numbers")
    return values
