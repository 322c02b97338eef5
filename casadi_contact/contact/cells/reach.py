"""Poses in which a patch is pressed: what the size of its cells is chosen on."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.cells.quadrature import Quadrature
from casadi_contact.contact.kernels import point_distances
from casadi_contact.conventions import Array, rotation

_TURN_RAD = np.deg2rad(30.0)  # about each axis
_LEAN_RAD = np.deg2rad(30.0)
_SHARE = 0.25  # of the patch's extent, by which the body is shifted to each side
_FARTHEST_MM = 300.0
_STEPS = 200
_NEAR_MM = 0.01
_ROUNDS = 6
_TRIES = 6  # for each pose wanted


def pressed_poses(
    patch: Quadrature, start: Array, loads_n: tuple[float, float], count: int, seed: int = 0
) -> tuple[Array, Array]:
    """Rotations (m, 3, 3) and translations (m, 3) of the body, m <= count, that press the patch.

    From the start pose (6,) the body is turned and, by turns, shifted and brought down along the patch's mean normal
    until it touches, or brought down along a direction that leans from it; then it presses with forces spread evenly
    on a logarithmic scale between loads_n [N]. Poses whose contact the rim cuts are left out where others are found.
    """
    random = np.random.default_rng(seed)
    known = patch.patch.c[patch.patch.known]
    up = patch.patch.loads[:, :3].sum(axis=0)
    up /= np.linalg.norm(up)
    wanted = np.geomspace(*loads_n, count)
    inside: list[tuple[Array, Array]] = []
    cut: list[tuple[Array, Array]] = []
    for attempt in range(_TRIES * count):
        turn, lean, shift = random.random() * random.uniform(-1.0, 1.0, (3, 3))
        R = rotation(start[3:] + _TURN_RAD * turn)
        away = up + np.tan(_LEAN_RAD) * lean * (attempt % 2)
        away /= np.linalg.norm(away)
        shift = _SHARE * shift * np.ptp(known, axis=0) * (1 - attempt % 2)
        t = start[:3] + shift - (shift @ up) * up
        touching = _come_down(patch, known, R, t, away)
        pressed = None if touching is None else _press(patch, R, touching, away, float(wanted[len(inside)]))
        if pressed is not None:
            (cut if patch.reaches_rim(R, pressed) else inside).append((R, pressed))
        if len(inside) == count:
            break
    R, t = (np.array([pose[k] for pose in inside or cut[:count]]) for k in (0, 1))
    return R.reshape(-1, 3, 3), t.reshape(-1, 3)


def _come_down(patch: Quadrature, points: Array, R: Array, t: Array, up: Array) -> Array | None:
    """The place on the way down at which the body first touches one of the points; None where it passes all."""
    lift = _FARTHEST_MM
    for _ in range(_STEPS):
        gap = point_distances(patch.body.family, patch.body.parameters, points, R, t + lift * up).min()
        if gap < _NEAR_MM:
            return np.asarray(t + lift * up)
        lift -= 0.9 * gap
        if lift < -_FARTHEST_MM:
            return None
    return None


def _press(patch: Quadrature, R: Array, t: Array, up: Array, wanted_n: float) -> Array | None:
    """From a touching place further down to about the wanted force, which grows about as the square of the depth."""
    depth = 0.05
    for _ in range(_ROUNDS):
        force = float(np.linalg.norm(patch.wrench(R, t - depth * up)[:3]))
        depth *= float(np.clip(np.sqrt(wanted_n / max(force, 1e-3 * wanted_n)), 0.3, 3.0))
    return np.asarray(t - depth * up) if force > 0.1 * wanted_n else None
