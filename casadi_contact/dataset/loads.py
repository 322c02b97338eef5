"""Loads that cannot be learned: of the wrong sign, or in other units than N."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import Array, rotation
from casadi_contact.dataset.samples import Samples
from casadi_contact.quantities import three_digits
from casadi_contact.scenes.normal_load import normal_forces

_ROUNDING = 0.01  # of the boundary load: so far a model that extrapolates may pull
_SMALL = 0.01  # of the reference load
_LEAST_ROWS = 40  # of fewer no correlation is judged
_REVERSED = -0.2  # correlation of force and way: 0.3 to 0.95 of tables whose loads are those on the fixed body


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
        f"{what}, row {row + 1}: {part.name} pulls with {three_digits(-normal[row, p])} N, expected "
        f"{part.normal.component} {'>' if part.normal.sign > 0.0 else '<'}= 0 ({count} such rows): {cure}"
    )


def refuse_reversed(samples: Samples, what: str) -> None:
    """ValueError for loads on the moving body instead of the fixed one, of parts that are pressed along no single
    direction; `refuse_pulling` tells them of the others. what names the samples in the message.

    A force F on the fixed body grows as the moving one goes its way, for contact resists: with x the place of the
    part's anchor, and what follows rotations linearly taken from both, Σ δx·δF / √(Σ|δx|² Σ|δF|²) is above 0.
    """
    for p, part in enumerate(samples.scene.parts):
        force = samples.wrenches[:, p, :3]
        pressed = (force != 0.0).any(axis=1)
        if part.normal.component is not None or pressed.sum() < _LEAST_ROWS:
            continue
        poses = samples.poses[pressed]
        way = _without(poses[:, 3:], poses[:, :3] + rotation(poses[:, 3:]) @ part.anchor_mm)
        change = _without(poses[:, 3:], force[pressed])
        size = float(np.linalg.norm(way) * np.linalg.norm(change))
        if size > 0.0 and (correlation := float(np.sum(way * change)) / size) < _REVERSED:
            raise ValueError(
                f"{what}: the force of {part.name} falls as the moving body goes its way (correlation "
                f"{correlation:.2f}), expected the loads on the fixed body: turn the signs of all loads"
            )


def _without(angles: Array, values: Array) -> Array:
    """Values (n, 3) less their mean and what follows angles (n, 3) linearly."""
    terms = np.column_stack([np.ones(len(angles)), angles])
    return np.asarray(values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0])


def refuse_small_forces(samples: Samples, what: str) -> None:
    """ValueError for samples whose normal loads all lie below a hundredth of the scene's reference load, as they do in
    kN; none is refused where nothing presses. what names the samples in the message."""
    scene = samples.scene
    largest = float(np.abs(normal_forces([part.normal for part in scene.parts], samples.wrenches)).max(initial=0.0))
    if 0.0 < largest < _SMALL * scene.reference_load:
        raise ValueError(
            f"{what}: no normal load is larger than {three_digits(largest)} N, expected some above a hundredth of the "
            f"scene's reference_load of {scene.reference_load:g} N: turn kN into N, or lower reference_load"
        )
