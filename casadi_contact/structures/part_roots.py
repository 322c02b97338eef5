"""Root loads of patches from those of their parts, as CasADi expressions.

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

LEAST_ROOT = 1e-9  # a part that just touches counts as this far off, so that no quotient is 0/0


def part_roots(roots: ca.MX, first_parts: Sequence[int]) -> ca.MX:
    """S (P x n) from the parts' root loads (parts x n); the parts of patch p begin at first_parts[p]."""
    bounds = itertools.pairwise([*first_parts, roots.shape[0]])
    return ca.vertcat(*(roots[a, :] if b - a == 1 else _together(roots[a:b, :]) for a, b in bounds))


def _together(s: ca.MX) -> ca.MX:
    rows = ca.vertsplit(s)
    squares = sum(ca.fmax(row, 0) ** 2 for row in rows)
    loaded = squares > 0
    free = [ca.fmin(row, -LEAST_ROOT) for row in rows]
    nearest = free[0]
    for row in free[1:]:
        nearest = ca.fmax(nearest, row)
    outside = nearest / ca.sqrt(sum((nearest / row) ** 2 for row in free))
    return ca.if_else(loaded, ca.sqrt(ca.if_else(loaded, squares, 1)), outside)
