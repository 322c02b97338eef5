"""Hammersley points: an evenly spread, deterministic filling of a box [EF15 §2.2]."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array


def hammersley(count: int, dimensions: int, shift: Array | None = None) -> Array:
    """Hammersley points (count, dimensions) in [0, 1)^d: x_i = (i/n, φ_2(i), φ_3(i), φ_5(i), ...).

    φ_b is the radical inverse in base b (SciPy's unscrambled Halton sequence). With a shift u (dimensions,) every
    point moves to (x_i + u) mod 1, the Cranley-Patterson rotation: equally even, but another set of points.
    Raises ValueError for a negative count or no dimension.
    """
    if count < 0 or dimensions < 1:
        raise ValueError(
            f"got {count} Hammersley points in {dimensions} dimensions, expected count >= 0, dimensions >= 1"
        )
    from scipy.stats import qmc  # a second of import that nothing but sampling needs

    points = np.empty((count, dimensions))
    points[:, 0] = np.arange(count) / max(count, 1)
    if dimensions > 1:
        points[:, 1:] = qmc.Halton(dimensions - 1, scramble=False).random(count)
    return points if shift is None else (points + shift) % 1.0
