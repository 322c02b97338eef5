"""Cycles whose forces may be in another unit than N: far below or above what their scene is made for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.quantities import FORCE, of_kind, two_digits
from casadi_contact.scenes.scene import Scene

_LEAST, _MOST = 0.01, 20.0  # of the scene's reference load


def force_unit_warning(scene: Scene, wanted: Mapping[str, Array]) -> str:
    """A line where the largest force of a cycle is below a hundredth of the scene's reference load or above 20 times
    it; "" where it is not, and where all are zero. Pounds-force and percent of body weight, 4 and 7 times as small
    numbers, lie within what joints carry.

    wanted: loads and centres of pressure by name, each (n,).
    """
    largest = max((float(np.abs(wanted[name]).max()) for name in of_kind(tuple(wanted), FORCE)), default=0.0)
    share = largest / scene.reference_load
    if largest == 0.0 or _LEAST <= share <= _MOST:
        return ""
    made_for = f"where the scene's reference load is {scene.reference_load:.4g} N"
    if share < _LEAST:
        return (
            f"the largest force is {two_digits(largest)} N, {made_for}: are forces in kN or body weights? Multiply "
            "them by 1000 or by the weight in N"
        )
    return (
        f"the largest force is {float(two_digits(largest)):,.0f} N, {made_for}: are forces in mN, or converted twice? "
        "Give them in N"
    )
