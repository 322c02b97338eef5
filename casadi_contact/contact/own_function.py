"""A user's own function of poses: asked with a copy of them, its answer checked, what it raises told with the pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.conventions import Array, pose_text

Function = Callable[[Array], ArrayLike]


def asked(what: str, function: Function, poses: Array, columns: tuple[int, ...], patch_names: Sequence[str]) -> Array:
    """What a user's function returns at poses (n, 6), as real numbers (n, *columns); what is its name in messages.

    An exception of the function goes on, with a note of a pose that raises it: asked again, with halves of the poses,
    it costs as many evaluations once more at most. Raises ValueError for another shape, and for complex numbers.
    """
    try:
        array = function(poses.copy())
    except Exception as error:
        error.add_note(f"raised by the contact model's {what}(poses) {_culprit(function, poses, patch_names)}")
        raise
    if np.iscomplexobj(array):
        raise ValueError(f"the contact model returned complex {what}, expected real ones")
    numbers = np.asarray(array, dtype=float)
    expected = (len(poses), *columns)
    if numbers.shape != expected:
        raise ValueError(f"the contact model returned {what} of shape {numbers.shape}, expected {expected}")
    return numbers


def _culprit(function: Function, poses: Array, patch_names: Sequence[str]) -> str:
    """A pose at which the function raises alone, in words."""
    left = poses
    while len(left) > 1:
        first, second = np.array_split(left, 2)
        left = first if _raises(function, first) else second
    if len(left) and _raises(function, left):
        return f"at {pose_text(left[0], patch_names)}"
    return f"for {len(poses)} poses at once, and not again for one of them alone"


def _raises(function: Function, poses: Array) -> bool:
    try:
        function(poses.copy())
    except Exception:  # whatever a user's function may raise
        return True
    return False
