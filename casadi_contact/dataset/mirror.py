"""Samples of a joint that is its own mirror image in the plane z = 0.

With S = diag(1, 1, -1, -1, -1, 1) the mirror image of a pose x is S·x, and of a wrench too, so that patch a of a pair
(a, b) has the wrench of b in the mirror: W_a(x) = S·W_b(S·x), and the same normal load and gap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casadi_contact.conventions import REFLECTION
from casadi_contact.dataset.samples import COLUMNS, Samples


def mirrored(samples: Samples) -> Samples:
    """The samples in the mirror, sides exchanged; for a scene of two parts that mirror each other."""
    return replace(
        samples,
        poses=samples.poses * REFLECTION,
        wrenches=samples.wrenches[:, ::-1] * REFLECTION,
        gaps=samples.gaps[:, ::-1],
    )


def either_side(samples: Samples, seed: int = 0) -> Samples:
    """As many samples, half of them, chosen at random, in the mirror: one side then knows what both have seen."""
    reflected, chosen = mirrored(samples), np.random.default_rng(seed).random(len(samples)) < 0.5
    columns = {}
    for name in COLUMNS:
        column, image = getattr(samples, name), getattr(reflected, name)
        columns[name] = np.where(chosen.reshape(-1, *[1] * (column.ndim - 1)), image, column)
    return replace(samples, **columns)
