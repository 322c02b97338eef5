"""Sizes that make the variables of a contact problem alike for an optimiser."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.conventions import LEVER_MM, POSE_NAMES, Array

_PRESSING = np.array([0.01] * 3 + [0.01 / LEVER_MM] * 3)
_SLIDING = np.array([0.5, 0.5, 0.3, 0.02, 0.02, 0.02])


def pose_steps(sensitive_pose: Sequence[str]) -> Array:
    """Moves (6,) [mm, rad] that change contact loads about alike, by some 30 N: a pose parameter that presses the
    bodies together (a scene's ``sensitive_pose``) is that much stiffer than one along which they slide or turn.

    Variables scaled by these are alike to IPOPT, whose regularisation then bears on all of them alike.
    """
    return np.where([name in sensitive_pose for name in POSE_NAMES], _PRESSING, _SLIDING)


KNEE_STEPS = pose_steps(("ty", "rx"))
