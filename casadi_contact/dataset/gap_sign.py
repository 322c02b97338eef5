"""Gaps of the wrong sign: a negative one where a patch carries no load would be learned as contact."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.model import overlaps_without_load
from casadi_contact.dataset.samples import Samples

_ROUNDING_MM = 1e-6


def refuse_wrong_gaps(samples: Samples, what: str, cure: str) -> None:
    """ValueError, naming the first row, for samples of which a part carries no load and has a negative gap.

    Load and gap may change their signs at slightly different poses: as far as `overlaps_without_load` allows, and in
    half of the rows without load at most. what names the samples in the message, cure ends it.
    """
    free = (samples.wrenches == 0.0).all(axis=2) & ~np.isnan(samples.gaps)
    negative = free & (samples.gaps < -_ROUNDING_MM)
    wrong = overlaps_without_load(samples.wrenches, samples.gaps) | (
        negative & (2 * negative.sum(axis=0) > free.sum(axis=0))
    )
    if not wrong.any():
        return
    row, part = np.argwhere(wrong)[0]
    count = int(wrong.any(axis=1).sum())
    raise ValueError(
        f"{what}, row {row + 1}: {samples.scene.parts[part].name} carries no load and has the gap "
        f"{samples.gaps[row, part]:g} mm, expected one above 0 out of contact ({count} such rows): {cure}"
    )
