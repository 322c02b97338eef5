"""Root loads of patches from those of the spots of their parts (`network.spots`), in NumPy and in CasADi."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.network.spots import LEAST_ROOT, joint_root


def patch_roots(s: Array, ds: Array, first: Sequence[int]) -> tuple[Array, Array]:
    """S (n, P) and dS (n, P, 6) from s (n, spots) and ds (n, spots, 6); first: where each patch's spots begin.

    From no derivatives (0, spots, 6) follow none (0, P, 6).
    """
    if len(first) == s.shape[1]:
        return s, ds
    patches = []
    for a, b in itertools.pairwise([*first, s.shape[1]]):
        patches.append(_together(s[:, a:b], ds[:, a:b]) if b - a > 1 else (s[:, a], ds[:, a]))
    return np.stack([S for S, _ in patches], axis=1), np.stack([dS for _, dS in patches], axis=1)


def _together(s: Array, ds: Array) -> tuple[Array, Array]:
    root, slopes = joint_root(np, s)
    return root, np.einsum("ni,nij->nj", slopes[: len(ds)], ds)


def patch_root_expressions(roots: ca.MX, first: Sequence[int]) -> ca.MX:
    """The same as CasADi expressions: S (P x n) from the spots' root loads (spots x n)."""
    bounds = itertools.pairwise([*first, roots.shape[0]])
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
