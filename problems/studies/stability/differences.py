"""Derivatives of loads by differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casadi_contact.core.conventions import POSE_IN_MM, Array


def by_differences(model: Callable[[Array], Array], poses: Array, step_mm: float, *, central: bool) -> Array:
    """d loads / d pose (n, L, 6) by central or one-sided differences; steps of rotations are step_mm over 25 mm."""
    columns = []
    here = None if central else model(poses)
    for axis in np.diag(step_mm / POSE_IN_MM):
        after = model(poses + axis)
        before = model(poses - axis) if here is None else here
        columns.append((after - before) / (axis.sum() * (2.0 if central else 1.0)))
    return np.stack(columns, axis=-1)
