"""Forces that do work on a moving joint, as CasADi expressions.

A wrench (F, T) about the fixed origin acts on the pose q = (t, r) through the virtual power F·v + T·ω of the moving
body, v being the velocity of its point at the fixed origin, so its generalised forces are

    Q(q) = (F, Eᵀ·(T - t × F))    with ω = E(r)·ṙ    [N, N·mm]

About the moving origin, Q = (F, EᵀT). Contact loads W act on the fixed body: on the moving body they do -Q(q; W).
"""

from __future__ import annotations

from typing import Any

import casadi as ca


def angular_velocity_map(angles: Any) -> Any:
    """E (3 x 3) with ω = E·(ṙx, ṙy, ṙz), as a CasADi expression of the angles (3)."""
    sx, sy, cx, cy = ca.sin(angles[0]), ca.sin(angles[1]), ca.cos(angles[0]), ca.cos(angles[1])
    return ca.vertcat(ca.horzcat(1, 0, sy), ca.horzcat(0, cx, -sx * cy), ca.horzcat(0, sx, cx * cy))


def generalised_forces(pose: Any, wrench: Any, *, about: str = "fixed") -> Any:
    """Generalised forces (6) [N, N·mm] of a wrench (6) about the ``fixed`` or the ``moving`` origin, as a CasADi
    expression; ValueError for another origin."""
    if about not in ("fixed", "moving"):
        raise ValueError(f"about is {about!r}, expected fixed or moving")
    force, torque = wrench[:3], wrench[3:]
    if about == "fixed":
        torque = torque - ca.cross(pose[:3], force)
    return ca.vertcat(force, ca.mtimes(angular_velocity_map(pose[3:]).T, torque))
