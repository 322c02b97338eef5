"""How far poses lie outside of what a model has learned, in words."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import POSE_NAMES, POSE_UNITS, Array
from casadi_contact.optimisation import pose_bounds
from casadi_contact.structures import Surrogate
from casadi_contact.verification.verify import LEAST_VALIDITY


def beyond_learned(model: SymbolicContact, poses: Array) -> np.ndarray:
    """By how much, in which parameter, each pose (n, 6) lies outside of what a surrogate has learned (n,); "" inside,
    and for a model that learned nothing."""
    words = np.full(len(poses), "", dtype=object)
    if not isinstance(model, Surrogate):
        return words
    low, high = pose_bounds(model)
    excess = np.maximum(low - poses, poses - high)
    validity = model.validity(poses)
    for k in np.flatnonzero((excess > 0.0).any(axis=1) | (validity < LEAST_VALIDITY)):
        named = [f"{POSE_NAMES[i]} by {excess[k, i]:.2g} {POSE_UNITS[i]}" for i in np.flatnonzero(excess[k] > 0.0)]
        words[k] = f"outside the learned range ({', '.join([*named, f'validity {validity[k]:.2g}'])})"
    return words
