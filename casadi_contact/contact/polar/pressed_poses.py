"""Poses in which a smooth patch is pressed somewhere in its reach: what the number of rays is chosen on."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.approach import press_until
from casadi_contact.contact.polar.ends import fixed_point
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.quadrature import PatchLoads, patch_loads
from casadi_contact.contact.polar.rays import Rays
from casadi_contact.contact.polar.rim import u_range
from casadi_contact.core.conventions import Array

_BEYOND_RAD = np.deg2rad(25.0)  # by which contact goes beyond the outermost junctions of arcs
_SPIN_RAD = np.deg2rad(10.0)
_LEAN_RAD = np.deg2rad(5.0)
_COARSE = Rays(16, 3)


def pressed_poses(
    patch: SmoothPatch, law: tuple[int, float, float], loads_n: tuple[float, float], count: int
) -> tuple[Array, Array]:
    """Rotations (m, 3, 3) and translations (m, 3) of the body, m <= count, that press the patch within its rim.

    The deepest point lies anywhere on the patch, faced by any place of the moving arcs, turned and leant a little;
    forces spread evenly on a logarithmic scale between loads_n [N]. Poses whose contact the rim cuts are left out.
    """
    random = np.random.default_rng(0)
    v = random.uniform(*patch.rim.v, count)
    low, high = u_range(patch, v)
    u = low + (high - low) * random.random(count)
    c, N, length = fixed_point(patch, u, v)
    n = N / length[:, None]
    junctions = np.arctan2(patch.arcs[:-1, 4], patch.arcs[:-1, 3])
    first, last = (junctions[0], junctions[-1]) if len(junctions) else (0.0, 0.0)
    angle = random.uniform(first - _BEYOND_RAD, last + _BEYOND_RAD, count)
    lean, spin = random.uniform(-_LEAN_RAD, _LEAN_RAD, count), random.uniform(-_SPIN_RAD, _SPIN_RAD, count)
    zero = np.zeros(count)
    out = np.stack([np.sin(angle), -np.cos(angle), zero], -1)  # from the arc's axis
    facing = np.cos(lean)[:, None] * out + np.sin(lean)[:, None] * [0.0, 0.0, 1.0]  # outward normal of the body
    along = np.stack([np.cos(angle), np.sin(angle), zero], -1)
    tangent = np.stack([np.ones(count), -N[:, 0], zero], -1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = np.cos(spin)[:, None] * tangent + np.sin(spin)[:, None] * np.cross(n, tangent)
    body = np.stack([along, facing, np.cross(along, facing)], -1)
    R = np.stack([tangent, -n, np.cross(tangent, -n)], -1) @ np.swapaxes(body, 1, 2)
    arc = patch.arcs[(angle[:, None] > junctions).sum(axis=1)]
    point = np.column_stack([arc[:, :2], np.full(count, patch.centre_z)]) + arc[:, 2:3] * out
    point += patch.tube_radius * facing
    surface = c - np.einsum("nij,nj->ni", R, point)
    turn = patch.turn.T

    def loads_at(depth_mm: Array) -> PatchLoads:
        return patch_loads(patch, law, _COARSE, turn @ R, (surface - depth_mm[:, None] * n) @ turn.T)

    def force_at(depth_mm: Array) -> Array:
        return np.linalg.norm(loads_at(depth_mm).wrench[:, :3], axis=1)

    depth, _ = press_until(force_at, np.geomspace(*loads_n, count), 0.01, rounds=4, most_change=30.0)
    whole = ~loads_at(depth).cut
    return (turn @ R)[whole], ((surface - depth[:, None] * n) @ turn.T)[whole]
