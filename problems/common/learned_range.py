"""How far poses lie outside of what a model has learned, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_NAMES, POSE_UNITS, Array, load_unit
from casadi_contact.core.quantities import two_digits
from casadi_contact.optimisation.starts import pose_bounds
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.confidence import VALID

_ROUNDED = 1e-6  # mm, rad: IPOPT lets bounds slip by a hundredth of that


def beyond_learned(model: ContactModel, poses: Array) -> np.ndarray:
    """By how much, in which pose parameters or else in which patch's normal load, each pose (n, 6) lies outside of what
    a surrogate has learned (n,); "" inside, and for a model that learned nothing."""
    words = np.full(len(poses), "", dtype=object)
    if not isinstance(model, Surrogate):
        return words
    low, high = pose_bounds(model)
    excess = np.maximum(low - poses, poses - high) - _ROUNDED
    validity = model.validity(poses)
    for k in np.flatnonzero((excess > 0.0).any(axis=1) | (validity < VALID)):
        # Beyond its range a surrogate extrapolates loads, by the hundredfold a radian away.
        named = _parameters_beyond(excess[k]) or _loads_beyond(model, poses[k])
        named.append(f"validity {validity[k]:.2g}")
        words[k] = f"outside the learned range ({', '.join(named)})"
    return words


def held_beyond(model: SymbolicContact, poses: Array, free: Sequence[int]) -> np.ndarray:
    """By how much what a problem holds in poses (n, 6), all but its free columns, lies outside of the range that a
    surrogate has learned (n,); "" inside, and for a model that learned nothing."""
    words = np.full(len(poses), "", dtype=object)
    low, high = pose_bounds(model)
    excess = np.maximum(low - poses, poses - high) - _ROUNDED
    excess[:, free] = 0.0
    for k in np.flatnonzero((excess > 0.0).any(axis=1)):
        words[k] = f"held outside the learned range ({', '.join(_parameters_beyond(excess[k]))})"
    return words


def _parameters_beyond(excess: Array) -> list[str]:
    """The pose parameters with an excess (6,) above 0, and how large it is."""
    return [f"{POSE_NAMES[i]} by {excess[i]:.2g} {POSE_UNITS[i]}" for i in np.flatnonzero(excess > 0.0)]


def _loads_beyond(model: Surrogate, pose: Array) -> list[str]:
    """The loads at a pose (6,) beyond those of all samples, and by how much [N, N·mm]."""
    ranges = model.record.get("load_range", {})
    beyond = {}
    for name, load in zip(model.load_names, model(pose), strict=True):
        low, high = ranges.get(name, (-np.inf, np.inf))
        beyond[name] = max(low - load, load - high)
    return [f"{name} by {two_digits(by)} {load_unit(name)}" for name, by in beyond.items() if by > 0.0]


def reasons(model: ContactModel, poses: Array, verdict: Verdict, known: np.ndarray | None = None) -> np.ndarray:
    """Why frames (n,) are not verified: what is known of them already, else how far outside the learned range they
    lie, else the verdict of those that are solved; "" for frames that are verified, and where nothing is known."""
    beyond = beyond_learned(model, poses)
    told = np.where(verdict.solved & verdict.checked, np.array(verdict.words, dtype=object), "")
    words = np.where(verdict.verified, "", np.where(beyond != "", beyond, told))
    return words if known is None else np.where(known != "", known, words)
