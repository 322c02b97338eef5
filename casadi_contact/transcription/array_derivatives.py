"""Second derivatives over arrays of poses, for models without a kernel at hand."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.conventions import Array


def as_weights(weights: ArrayLike, count: int, loads: Sequence[str]) -> Array:
    """Weights (count, L), from as many or (L,); raises ValueError for another shape."""
    given = np.asarray(weights, dtype=float)
    if given.shape not in ((len(loads),), (count, len(loads))):
        raise ValueError(
            f"weights has shape {given.shape}, expected ({len(loads)},) or ({count}, {len(loads)}): {', '.join(loads)}"
        )
    return np.ascontiguousarray(np.broadcast_to(given, (count, len(loads))))


def hessian_function(function: ca.Function) -> ca.Function:
    """pose (6), weights (L) -> second derivatives (6 x 6) of Σ weights·loads, of a function pose (6) -> loads (L)."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    hessian, _ = ca.hessian(ca.dot(weights, function(pose)), pose)
    return ca.Function("hessian", [pose, weights], [ca.densify(hessian)])


def weighted_hessians(hessian: ca.Function, poses: Array, weights: Array) -> Array:
    """Second derivatives (n, 6, 6) by a `hessian_function`, for poses (n, 6) and weights (n, L)."""
    rows = [hessian(pose, of_pose).full() for pose, of_pose in zip(poses, weights, strict=True)]
    return np.stack(rows) if rows else np.empty((0, 6, 6))
