"""Contact models in other programs: C, MEX, FMU, PyTorch, JAX; checks that the bridges share."""

from collections.abc import Sequence

from casadi_contact.core.conventions import POSE_NAMES


def check_gives(model: object, *methods: str) -> None:
    """Raise ValueError for a model without one of these methods, before a library's own call-back meets it."""
    lacking = [name for name in methods if not callable(getattr(model, name, None))]
    if lacking:
        raise ValueError(f"{type(model).__name__} gives no {', '.join(lacking)}, expected a surrogate or a foundation")


def check_last_axis(shape: Sequence[int]) -> None:
    """Raise ValueError for poses of another shape than (..., 6)."""
    if not shape or shape[-1] != len(POSE_NAMES):
        raise ValueError(f"poses has shape {tuple(shape)}, expected (..., 6): {', '.join(POSE_NAMES)} [mm, rad]")
