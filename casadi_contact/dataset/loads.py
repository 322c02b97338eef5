"""Loads that cannot be learned: of the wrong sign, or in other units than N."""

from __future__ import annotations

import numpy as np

from casadi_contact.dataset.samples import Samples
from casadi_contact.scenes.normal_load import normal_forces

_ROUNDING = 0.01  # of the boundary load: so far a model that extrapolates may pull
_SMALL = 0.01  # of the reference load


def refuse_pulling(samples: Samples, what: str) -> None:
    """ValueError, naming the row that pulls hardest, for samples in which a part pulls by more than rounding. what
    names the samples in the message."""
    scene = samples.scene
    normal = normal_forces([part.normal for part in scene.parts], samples.wrenches)
    pulls = normal < -_ROUNDING * scene.boundary_load
    if not pulls.any():
        return
    row, p = np.unravel_index(int(np.nanargmin(normal)), normal.shape)
    part, count = scene.parts[int(p)], int(pulls.any(axis=1).sum())
    reversed_ = 2 * pulls[:, p].sum() > (normal[:, p] != 0.0).sum()
    cure = (
        "turn the signs of all loads, which are those on the fixed body"
        if reversed_
        else "set loads out of contact to 0, mend or remove other rows"
    )
    raise ValueError(
        f"{what}, row {row + 1}: {part.name} pulls with {-normal[row, p]:.3g} N, expected {part.normal.component} "
        f"{'>' if part.normal.sign > 0.0 else '<'}= 0 ({count} such rows): {cure}"
    )


def refuse_small_forces(samples: Samples, what: str) -> None:
    """ValueError for samples whose normal loads all lie below a hundredth of the scene's reference load, as they do in
    kN; none is refused where nothing presses. what names the samples in the message."""
    scene = samples.scene
    largest = float(np.abs(normal_forces([part.normal for part in scene.parts], samples.wrenches)).max(initial=0.0))
    if 0.0 < largest < _SMALL * scene.reference_load:
        raise ValueError(
            f"{what}: no normal load is larger than {largest:.3g} N, expected some above a hundredth of the scene's "
            f"reference_load of {scene.reference_load:g} N: turn kN into N, or lower reference_load"
        )
