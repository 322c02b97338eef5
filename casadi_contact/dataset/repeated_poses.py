"""Rows of a table that contradict each other: one pose with different loads, as from hysteresis, another model, or a
repeated measurement. No function of the pose fits them."""

from __future__ import annotations

import numpy as np

from casadi_contact.dataset.samples import Samples
from casadi_contact.quantities import quantity, three_digits


def contradictions_text(samples: Samples) -> str:
    """One line that counts the poses whose rows differ by more than a load's tolerance, and names the two rows that lie
    furthest apart by their numbers (from 1); empty for none."""
    scene, loads = samples.scene, samples.loads()
    distinct, pose_of_row = np.unique(samples.poses, axis=0, return_inverse=True)
    pose_of_row = pose_of_row.ravel()
    least, most = np.full((len(distinct), loads.shape[1]), np.inf), np.full((len(distinct), loads.shape[1]), -np.inf)
    np.minimum.at(least, pose_of_row, loads)
    np.maximum.at(most, pose_of_row, loads)
    times = (most - least) / [scene.tolerances[name] for name in scene.load_names]
    if not (count := int((times > 1.0).any(axis=1).sum())):
        return ""
    pose, load = np.unravel_index(int(times.argmax()), times.shape)
    rows, name = np.flatnonzero(pose_of_row == pose), scene.load_names[load]
    values = loads[rows, load]
    said = (f"row {rows[at] + 1} {three_digits(values[at])}" for at in sorted((values.argmin(), values.argmax())))
    return (
        f"poses whose rows differ by more than a tolerance, keep one row of each or their mean: {count} "
        f"({name} of {' and '.join(said)} {quantity(name).unit})"
    )
