"""Root load of a patch that is cut into parts, from those of its parts, in NumPy and in CasADi.

With the normal loads N_k = N0·max(s_k, 0)² of its parts a patch has N = Σ N_k, so that its root load is

    S = √(Σ max(s_k, 0)²)    where a part is in contact,
    S = -1/√(Σ s_k⁻²)        where none is: near the root load of the nearest part

This is smooth in and out of contact, and once continuously differentiable where a part comes into contact.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array

LEAST_ROOT = 1e-9  # a part that just touches counts as this far off, so that no quotient is 0/0


def union_root(s: Array) -> tuple[Array, Array]:
    """S (n,) and dS/ds_k (n, K) of a patch from the root loads s (n, K) of its parts."""
    pressed, free = np.maximum(s, 0.0), np.minimum(s, -LEAST_ROOT)
    inside, nearest = np.sqrt((pressed * pressed).sum(axis=1)), free.max(axis=1)
    outside = nearest / np.sqrt(((nearest[:, None] / free) ** 2).sum(axis=1))
    loaded = inside > 0.0
    divisor = np.where(loaded, inside, 1.0)
    jacobian = np.where(loaded[:, None], pressed / divisor[:, None], (outside[:, None] / free) ** 3)
    return np.where(loaded, inside, outside), jacobian


def patch_roots(s: Array, ds: Array, first: Sequence[int]) -> tuple[Array, Array]:
    """S (n, P) and dS (n, P, 6) from s (n, parts) and ds (n, parts, 6); first: the first part of each patch.

    Without derivatives (0, parts, 6) the result has none (0, P, 6).
    """
    if len(first) == s.shape[1]:
        return s, ds
    patches = []
    for a, b in itertools.pairwise([*first, s.shape[1]]):
        if b - a == 1:
            patches.append((s[:, a], ds[:, a]))
            continue
        root, jacobian = union_root(s[:, a:b])
        patches.append((root, np.einsum("ni,nij->nj", jacobian[: len(ds)], ds[:, a:b])))
    return np.stack([S for S, _ in patches], axis=1), np.stack([dS for _, dS in patches], axis=1)


def patch_root_expressions(roots: ca.MX, first: Sequence[int]) -> ca.MX:
    """The same as CasADi expressions: S (P x n) from the parts' root loads (parts x n)."""
    bounds = itertools.pairwise([*first, roots.shape[0]])
    return ca.vertcat(*(roots[a, :] if b - a == 1 else _union_expression(roots[a:b, :]) for a, b in bounds))


def _union_expression(s: ca.MX) -> ca.MX:
    rows = ca.vertsplit(s)
    squares = sum(ca.fmax(row, 0) ** 2 for row in rows)
    loaded = squares > 0
    free = [ca.fmin(row, -LEAST_ROOT) for row in rows]
    nearest = free[0]
    for row in free[1:]:
        nearest = ca.fmax(nearest, row)
    outside = nearest / ca.sqrt(sum((nearest / row) ** 2 for row in free))
    return ca.if_else(loaded, ca.sqrt(ca.if_else(loaded, squares, 1)), outside)
