"""Root loads of patches from those of their parts, in NumPy and as CasADi expressions.

With the normal loads N_i = N0·max(s_i, 0)² of its parts a patch has N = Σ N_i, so that its root load is

    S = √(Σ max(s_i, 0)²)    where a part is in contact,
    S = -1/√(Σ s_i⁻²)        where none is: near the root load of the nearest part, smooth, and likewise once
                             continuously differentiable where a part comes into contact

The second derivatives jump at liftoff, as those of any load do there.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array

LEAST_ROOT = 1e-9  # a part that just touches counts as this far off, so that no quotient is 0/0


def patch_roots(s: Array, ds: Array, first_parts: Sequence[int]) -> tuple[Array, Array]:
    """S (n, P) and dS (n, P, 6) from s (n, parts) and ds (n, parts, 6); first_parts: where each patch's parts begin."""
    if len(first_parts) == s.shape[1]:
        return s, ds
    patches = []
    for a, b in itertools.pairwise([*first_parts, s.shape[1]]):
        patches.append(_together(s[:, a:b], ds[:, a:b]) if b - a > 1 else (s[:, a], ds[:, a]))
    return np.stack([S for S, _ in patches], axis=1), np.stack([dS for _, dS in patches], axis=1)


def _together(s: Array, ds: Array) -> tuple[Array, Array]:
    pressed, free = np.maximum(s, 0.0), np.minimum(s, -LEAST_ROOT)
    loaded: np.ndarray = np.any(pressed > 0.0, axis=1)
    inside = np.linalg.norm(pressed, axis=1)
    nearest = free.max(axis=1)
    outside = nearest / np.linalg.norm(nearest[:, None] / free, axis=1)
    root = np.where(loaded, inside, outside)
    slopes = np.where(loaded[:, None], pressed / np.where(loaded, inside, 1.0)[:, None], (outside[:, None] / free) ** 3)
    return root, np.einsum("ni,nij->nj", slopes, ds)


def patch_root_expressions(roots: ca.MX, first_parts: Sequence[int]) -> ca.MX:
    """The same as CasADi expressions: S (P x n) from the parts' root loads (parts x n)."""
    bounds = itertools.pairwise([*first_parts, roots.shape[0]])
    return ca.vertcat(*(roots[a, :] if b - a == 1 else _together_expression(roots[a:b, :]) for a, b in bounds))


def _together_expression(s: ca.MX) -> ca.MX:
    rows = ca.vertsplit(s)
    squares = sum(ca.fmax(row, 0) ** 2 for row in rows)
    loaded = squares > 0
    free = [ca.fmin(row, -LEAST_ROOT) for row in rows]
    nearest = free[0]
    for row in free[1:]:
        nearest = ca.fmax(nearest, row)
    outside = nearest / ca.sqrt(sum((nearest / row) ** 2 for row in free))
    return ca.if_else(loaded, ca.sqrt(ca.if_else(loaded, squares, 1)), outside)
