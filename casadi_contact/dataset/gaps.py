"""Gaps that cannot be learned: of the wrong sign, where a negative one would be learned as contact, or missing."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.model import overlaps_without_load
from casadi_contact.dataset.samples import Samples
from casadi_contact.scenes.normal_load import normal_forces

_ROUNDING_MM = 1e-6


def refuse_missing_gaps(samples: Samples, what: str) -> None:
    """ValueError, naming the first row, for samples of which a part does not press and has no gap: root loads learn it
    there. what names the samples in the message."""
    pressed = normal_forces([part.normal for part in samples.scene.parts], samples.wrenches) > 0.0
    missing = ~pressed & np.isnan(samples.gaps)
    if missing.any():
        row, part = np.argwhere(missing)[0]
        raise ValueError(
            f"{what}, row {row + 1}: {samples.scene.parts[part].name} does not press and has no gap, expected one "
            f"above 0 mm out of contact ({int(missing.any(axis=1).sum())} such rows): add a column of gaps"
        )


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
