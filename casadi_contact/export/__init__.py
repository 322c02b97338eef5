"""Contact models in other programs: C, MEX, FMU, PyTorch, JAX.

Here stands what the bridges ask of a contact model, a surrogate or the one that `cc.foundation` chooses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from casadi_contact.core.conventions import POSE_NAMES, Array


class DifferentiableModel(Protocol):
    """Loads of poses with both derivatives, as arrays."""

    @property
    def load_names(self) -> Sequence[str]:
        """Names of the loads, in their order."""

    def __call__(self, poses: Array) -> Array:
        """Loads (n, L) of poses (n, 6)."""

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Loads (n, L) and their derivatives (n, L, 6)."""

    def hessian(self, poses: Array, weights: Array) -> Array:
        """Second derivatives (n, 6, 6) of Σ weights·loads for weights (n, L)."""


def check_gives(model: object, *methods: str) -> None:
    """Raise ValueError for a model without one of these methods, before a library's own call-back meets it."""
    lacking = [name for name in methods if not callable(getattr(model, name, None))]
    if lacking:
        raise ValueError(
            f"{type(model).__name__} gives no {' and no '.join(lacking)}, "
            "expected a surrogate or the contact model of cc.foundation"
        )


def check_last_axis(shape: Sequence[int]) -> None:
    """Raise ValueError for poses of another shape than (..., 6)."""
    if not shape or shape[-1] != len(POSE_NAMES):
        raise ValueError(f"poses has shape {tuple(shape)}, expected (..., 6): {', '.join(POSE_NAMES)} [mm, rad]")
