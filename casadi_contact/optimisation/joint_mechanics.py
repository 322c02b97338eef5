"""Forces that do work on a moving joint, as CasADi expressions.

A wrench (F, T) about the fixed origin acts on the pose q = (t, r) through the virtual power F·v + T·ω of the moving
body, v being the velocity of its point at the fixed origin, so its generalised forces are

    Q(q) = (F, Eᵀ·(T - t × F))    with ω = E(r)·ṙ    [N, N·mm]

About the moving origin, Q = (F, EᵀT). Contact loads W act on the fixed body: on the moving body they do -Q(q; W).
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import LEVER_MM, WRENCH_NAMES, Array, loads_of_total
from casadi_contact.core.quantities import TORQUE, quantity
from casadi_contact.networks.frames import angular_velocity_map
from casadi_contact.scenes.scene import Scene


def generalised_forces(pose: Any, wrench: Any, *, about: str = "fixed") -> Any:
    """Generalised forces (6) [N, N·mm] of a wrench (6) about the ``fixed`` or the ``moving`` origin, as a CasADi
    expression; ValueError for another origin."""
    if about not in ("fixed", "moving"):
        raise ValueError(f"about is {about!r}, expected fixed or moving")
    force, torque = wrench[:3], wrench[3:]
    if about == "fixed":
        torque = torque - ca.cross(pose[:3], force)
    return ca.vertcat(force, ca.mtimes(angular_velocity_map(pose[3:]).T, torque))


def total_selection(load_names: Sequence[str], patch_names: Sequence[str]) -> Array:
    """Matrix (6, L) that adds named loads up to the total wrench, each component as `loads_of_total` says; ValueError
    where one is named neither in total nor of every patch."""
    parts = {component: loads_of_total(component, load_names, patch_names) for component in WRENCH_NAMES}
    if missing := [component for component, names in parts.items() if not names]:
        raise ValueError(f"the loads {', '.join(load_names)} lack {', '.join(missing)}, in total or of every patch")
    return np.array([[float(name in parts[component]) for name in load_names] for component in WRENCH_NAMES])


def whole_wrench(scene: Scene) -> Scene:
    """The scene with every component of the wrench among its loads: those that it leaves out in total, with the
    loosest tolerance of their kind, or that of the other kind at the lever `LEVER_MM`."""
    missing = [name for name in WRENCH_NAMES if not loads_of_total(name, scene.load_names, scene.patch_names)]
    if not missing:
        return scene
    tolerances = dict(scene.tolerances)
    for name in missing:
        kind = quantity(name).kind
        alike = [value for load, value in scene.tolerances.items() if quantity(load).kind == kind]
        at_lever = LEVER_MM if kind == TORQUE else 1.0 / LEVER_MM
        tolerances[name] = max(alike) if alike else at_lever * max(scene.tolerances.values())
    loads = {**scene.tables["loads"], "names": [*scene.load_names, *missing]}
    return Scene.from_tables({**scene.tables, "loads": loads, "tolerances": tolerances})
