"""Mechanics that the problems of a moving joint share: contact as a CasADi function, and forces that do work.

A wrench (F, T) about the fixed origin acts on the pose q = (t, r) through the virtual power F·v + T·ω of the moving
body, v being the velocity of its point at the fixed origin, so its generalised forces are

    Q(q) = (F, Eᵀ·(T - t × F))    with ω = E(r)·ṙ    [N, N·mm]

About the moving origin, Q = (F, EᵀT). Contact loads W act on the fixed body: on the moving body they do -Q(q; W).
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.structures import Surrogate
from problems.foundation_callback import FoundationCallback, total_selection

SURROGATE_OPTIONS: dict[str, Any] = {"compiled": True}  # keywords of Surrogate.function for every problem here
LEVER_MM = 25.0  # turns N·mm into comparable N, and rad into comparable mm
IN_MM = np.array([1.0, 1.0, 1.0, LEVER_MM, LEVER_MM, LEVER_MM])  # pose parameters in comparable mm
STEPS = np.array([0.5, 0.01, 0.3, 0.01 / 22.0, 0.02, 0.02])  # pose steps [mm, rad] that change loads alike


def wrench_function(model: ContactModel | Surrogate, name: str = "contact_wrench") -> ca.Function:
    """casadi.Function pose (6) -> total contact wrench on the fixed body (6), about its origin.

    A surrogate gives its own function with exact derivatives; any other contact model is called back, with its
    analytic Jacobian. Raises ValueError where the model lacks a component of the wrench.
    """
    if not isinstance(model, Surrogate):
        return FoundationCallback(model, name)
    pose = ca.MX.sym("pose", 6)
    loads = model.function(name=f"{name}_loads", **SURROGATE_OPTIONS)(pose)
    return ca.Function(name, [pose], [ca.mtimes(ca.sparsify(ca.DM(total_selection(model.load_names))), loads)])


def angular_velocity_map(angles: Any) -> Any:
    """E (3 x 3) with ω = E·(ṙx, ṙy, ṙz), as a CasADi expression of the angles (3)."""
    sx, sy, cx, cy = ca.sin(angles[0]), ca.sin(angles[1]), ca.cos(angles[0]), ca.cos(angles[1])
    return ca.vertcat(ca.horzcat(1, 0, sy), ca.horzcat(0, cx, -sx * cy), ca.horzcat(0, sx, cx * cy))


def generalised_forces(pose: Any, wrench: Any, *, about: str = "fixed") -> Any:
    """Generalised forces (6) of a wrench (6) about the ``fixed`` or the ``moving`` origin, as a CasADi expression."""
    if about not in ("fixed", "moving"):
        raise ValueError(f"about is {about!r}, expected fixed or moving")
    force, torque = wrench[:3], wrench[3:]
    if about == "fixed":
        torque = torque - ca.cross(pose[:3], force)
    return ca.vertcat(force, ca.mtimes(angular_velocity_map(pose[3:]).T, torque))
