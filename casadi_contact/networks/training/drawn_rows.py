"""Rows that a preconditioner is assembled from: a weighted random subset."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.core.conventions import Array


def draw_rows(weights: Array, wanted: int, seed: Sequence[int]) -> tuple[np.ndarray, Array]:
    """About `wanted` rows drawn with probability ∝ their weight, and a scale for each, so that JᵀJ of the scaled rows
    has the expectation of JᵀJ of all; all rows, where no more are there."""
    if wanted >= len(weights) or not weights.sum() > 0.0:
        return np.arange(len(weights)), np.ones(len(weights))
    chance = np.minimum(1.0, weights * (wanted / weights.sum()))
    drawn = np.flatnonzero(np.random.default_rng(seed).random(len(weights)) < chance)
    return drawn, 1.0 / np.sqrt(chance[drawn])
