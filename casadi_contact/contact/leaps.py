"""Neighbouring frames whose poses lie apart: where several equilibria carry the same loads, each may have its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.core.conventions import Array, pose_index
from casadi_contact.core.quantities import two_digits

LEAP_MM, LEAP_RAD = 2.0, np.radians(3.0)
_TIMES = 4.0  # the usual step beside it: a motion of few frames takes large steps everywhere
_BESIDE = 2  # steps before and behind


def leaps(poses: Array) -> np.ndarray:
    """True (n - 1, 6) where a pose parameter of poses (n, 6) moves from one frame to the next by more than 2 mm or 3
    degrees, and by more than four times the median of the two steps before and the two behind, or, where it comes back
    in the next one, than what is left of it and the median of all."""
    moves = np.diff(poses, axis=0)
    steps = np.abs(moves)
    padded = np.pad(steps, ((_BESIDE, _BESIDE), (0, 0)), constant_values=np.nan)
    count = len(steps)
    beside = np.stack([padded[at : at + count] for at in range(2 * _BESIDE + 1) if at != _BESIDE])
    alone = np.isnan(beside).all(axis=0)  # two frames: nothing tells what is usual
    usual = np.nanmedian(np.where(alone, np.inf, beside), axis=0)
    least = np.array([LEAP_MM] * 3 + [LEAP_RAD] * 3)
    left = np.abs(moves[1:] + moves[:-1])  # of one step and the next
    back = np.full_like(steps, np.inf)
    back[:-1] = left
    back[1:] = np.minimum(back[1:], left)
    back = np.maximum(back, np.median(steps, axis=0)) if count else back
    return np.asarray((steps > least) & (steps > _TIMES * np.minimum(usual, back)))


def leaps_in_words(poses: Array, names: Sequence[str]) -> str:
    """Which of the pose parameters named leap between which frames of poses (n, 6), and how far; "" where none does."""
    steps, leaping, words = np.abs(np.diff(poses, axis=0)), leaps(poses), []
    for name in names:
        column = pose_index(name)
        for k in np.flatnonzero(leaping[:, column]):
            step = steps[k, column]
            far = f"{two_digits(step)} mm" if name.startswith("t") else f"{two_digits(np.degrees(step))} degrees"
            words.append(f"{name} by {far} from frame {k} to {k + 1}")
    return ", ".join(words)
