"""The work of forces on a body that moves with a twist (v, ω): of velocity v at its origin, turning with ω."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import Array


def twist(force: Array, arm: Array) -> Array:
    """(f, arm × f) (..., 6) of forces and arms (..., 3): its product with (v, ω) is the force's power."""
    return np.concatenate([force, np.cross(arm, force)], -1)
