"""Numbers of any size cut off, so that what is made of them is finite for every finite pose (in C: `trust.h`)."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array

_FAR = 1e8  # of pose parameters and root loads, scaled or not; its square is finite by far


def cut_off(values: Array) -> Array:
    """Values within ±1e8."""
    return np.clip(values, -_FAR, _FAR)


def cut_off_expression(values: ca.MX) -> ca.MX:
    """The same as a CasADi expression."""
    return ca.fmin(ca.fmax(values, -_FAR), _FAR)
