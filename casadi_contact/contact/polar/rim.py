"""A patch's rim: a box in coordinates (w, v) with u = w·s(v), where s = ρ(v) for a rim of one angle, else 1."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.core.conventions import Array


def rim_box(patch: SmoothPatch) -> tuple[Array, Array]:
    """Least and largest (w, v) of the patch, each (2,)."""
    w = (-patch.rim.spread, patch.rim.spread) if _curved(patch) else patch.rim.u
    return tuple(np.array([w, patch.rim.v]).T)  # type: ignore[return-value]


def stretch(patch: SmoothPatch, v: Array) -> tuple[Array, Array, Array]:
    """s(v) with its first and second derivative."""
    if not _curved(patch) or patch.torus is None:
        return np.ones_like(v), np.zeros_like(v), np.zeros_like(v)
    f = patch.torus
    tube = np.sqrt(f.radius**2 - v * v)
    return f.offset + f.rho_sign * tube, -f.rho_sign * v / tube, -f.rho_sign * f.radius**2 / tube**3


def u_range(patch: SmoothPatch, v: Array) -> tuple[Array, Array]:
    """Least and largest u of the patch at v."""
    (low, _), (high, _) = rim_box(patch)
    s = stretch(patch, v)[0]
    return low * s, high * s


def within(patch: SmoothPatch, u: Array, v: Array) -> tuple[Array, Array]:
    """The point (u, v) moved onto the patch, along u and along v."""
    v = np.clip(v, *patch.rim.v)
    low, high = u_range(patch, v)
    return np.clip(u, low, high), v


def _curved(patch: SmoothPatch) -> bool:
    return patch.torus is not None and bool(np.isfinite(patch.rim.spread))
