"""Root load of a patch from those of its spots, the places where it touches.

With the normal loads N_k = N0·max(s_k, 0)² of its spots a patch has N = Σ N_k, so that its root load is

    S = √(Σ max(s_k, 0)²)    where a spot is in contact,
    S = -1/√(Σ s_k⁻²)        where none is: near the root load of the nearest spot, smooth, and likewise once
                             continuously differentiable where a spot comes into contact

The second derivatives jump at liftoff, as those of any load do there.
"""

from __future__ import annotations

from typing import Any

LEAST_ROOT = 1e-9  # a spot that just touches counts as this far off, so that no quotient is 0/0


def joint_root(xp: Any, s: Any) -> tuple[Any, Any]:
    """S (n,) and dS/ds_k (n, K) from s (n, K), in NumPy or torch (xp)."""
    pressed, free = xp.clip(s, 0.0, None), xp.clip(s, None, -LEAST_ROOT)
    inside = xp.sqrt((pressed * pressed).sum(1))
    nearest = xp.amax(free, 1)
    outside = nearest / xp.sqrt(((nearest[:, None] / free) ** 2).sum(1))
    loaded = inside > 0.0
    divisor = xp.where(loaded, inside, xp.ones_like(inside))
    slopes = xp.where(loaded[:, None], pressed / divisor[:, None], (outside[:, None] / free) ** 3)
    return xp.where(loaded, inside, outside), slopes
