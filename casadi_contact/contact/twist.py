"""Twists (v, ω) of a body that moves with v at its origin and turns with ω: power of forces, and derivatives."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array, angular_velocity_map


def twist(force: Array, arm: Array) -> Array:
    """(f, arm × f) (..., 6) of forces and arms (..., 3): its product with (v, ω) is the force's power."""
    return np.concatenate([force, np.cross(arm, force)], -1)


def by_pose(by_twist: Array, poses: Array) -> Array:
    """Derivatives (n, ..., 6) by twist become derivatives by pose (n, 6), since ω = E·(ṙx, ṙy, ṙz)."""
    slopes = by_twist.copy()
    slopes[..., 3:] = np.einsum("n...w,nwj->n...j", by_twist[..., 3:], angular_velocity_map(poses[:, 3:]))
    return slopes
