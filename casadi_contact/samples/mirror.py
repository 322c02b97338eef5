"""Samples of a joint that is its own mirror image in the plane z = 0.

With S = diag(1, 1, -1, -1, -1, 1) the mirror image of a pose x is S·x, and of a wrench too, so that patch a of a pair
(a, b) has the wrench of b in the mirror: W_a(x) = S·W_b(S·x), and the same normal load and gap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casadi_contact.core.conventions import REFLECTION
from casadi_contact.samples.samples import Samples


def mirrored(samples: Samples) -> Samples:
    """The samples in the mirror, sides exchanged; for a scene of two parts that mirror each other."""
    return replace(
        samples,
        poses=samples.poses * REFLECTION,
        wrenches=samples.wrenches[:, ::-1] * REFLECTION,
        gaps=samples.gaps[:, ::-1],
    )


def either_side(samples: Samples) -> Samples:
    """Half of the samples, chosen at random, in the mirror, so that one side knows what both have seen.

    Those in which a side bears nothing come as they are and in the mirror: a false contact may lie on either side, and
    a surrogate that never saw it there predicts thousands of newtons.
    """
    reflected, chosen = mirrored(samples), np.random.default_rng(0).random(len(samples)) < 0.5
    free = (samples.wrenches == 0.0).all(axis=2).any(axis=1)
    return samples.rows(~chosen | free).join_samples(reflected.rows(chosen | free))
