"""What structures take from samples: the rows that are fitted, checked, and what the record says of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.samples.samples import DOMAINS, TEST, TRAIN, VALIDATION, Samples


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


def samples_record(samples: Samples) -> dict[str, Any]:
    """The record's ``drawn_from``, ``samples``, ``test_samples``, ``dropped`` and ranges of a surrogate trained on the
    samples that are not held back."""
    used = samples.select(role=(TRAIN, VALIDATION))
    names, drawn_from = samples.scene.load_names, samples.provenance.get("models")
    return {
        **({"drawn_from": drawn_from} if drawn_from else {}),
        "samples": {d: int(((samples.domain == k) & (samples.role != TEST)).sum()) for k, d in enumerate(DOMAINS, 1)},
        "test_samples": {d: held for d, count in samples.counts().items() if (held := count["test"])},
        "dropped": samples.dropped_shares(),
        "pose_range": _ranges(POSE_NAMES, used.poses),
        "load_range": _ranges(names, used.loads(names)),
    }


def _ranges(names: Sequence[str], columns: Array) -> dict[str, list[float]]:
    return {name: [float(column.min()), float(column.max())] for name, column in zip(names, columns.T, strict=True)}
