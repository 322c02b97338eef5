"""Row 9: is the force field a gradient, and is the stiffness the EF's?

The generalised forces Q(q) = (F, Eᵀ·(T - t×F)) of a conservative contact have a symmetric Jacobian. With
K = S·dQ/dq·S in comparable units (S: mm, and rad times 25 mm), the curl is ‖K - Kᵀ‖/2‖K‖ and the stiffness is off by
‖K - K*‖/‖K*‖ (Frobenius), K* that of the EF on the finest grid. The EF itself is not quite conservative: it presses
along its elements' normals, but measures depth to where the ray meets the other body.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import POSE_IN_MM, Array
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from problems.studies.stability.methods import Bench
from problems.studies.stability.table import Line


def stiffness(model: Any, poses: Array) -> Array:
    """K = S·dQ/dq·S (n, 6, 6) [N/mm] of the contact loads, by the chain rule from the model's own Jacobian."""
    pose, wrench = ca.MX.sym("pose", 6), ca.MX.sym("wrench", 6)
    forces = generalised_forces(pose, wrench)
    slopes = ca.Function("slopes", [pose, wrench], [ca.jacobian(forces, pose), ca.jacobian(forces, wrench)])
    total = total_selection(model.load_names, model.patch_names)
    loads, jacobians = model.jacobian(poses)
    result = np.empty((len(poses), 6, 6))
    for k, at in enumerate(poses):
        direct, by_wrench = (np.asarray(part) for part in slopes(at, total @ loads[k]))
        result[k] = direct + by_wrench @ (total @ jacobians[k])
    return result / POSE_IN_MM[:, None] / POSE_IN_MM


def curl(k: Array) -> Array:
    """‖K - Kᵀ‖/2‖K‖ (n,)."""
    return np.asarray(np.linalg.norm(k - np.swapaxes(k, 1, 2), axis=(1, 2)) / (2.0 * np.linalg.norm(k, axis=(1, 2))))


def measure(bench: Bench) -> tuple[list[Line], None]:
    """Lines of row 9, over the frames of the reference cycle."""
    true = stiffness(bench.teacher, bench.poses)
    size = np.linalg.norm(true, axis=(1, 2))
    curls: dict[str, float | str] = {}
    worst: dict[str, float | str] = {}
    own: dict[str, float | str] = {}
    off: dict[str, float | str] = {}
    for method, model in bench.models.items():
        k = stiffness(model, bench.poses)
        share = curl(k)
        skew = 0.5 * (k - np.swapaxes(k, 1, 2)) - 0.5 * (true - np.swapaxes(true, 1, 2))
        curls[method], worst[method] = 100.0 * float(np.median(share)), 100.0 * float(share.max())
        own[method] = 100.0 * float(np.median(np.linalg.norm(skew, axis=(1, 2)) / size))
        off[method] = 100.0 * float(np.median(np.linalg.norm(k - true, axis=(1, 2)) / size))
    grid = bench.teacher.label
    case = f"{len(bench.poses)} frames of the motion"
    return [
        Line(9, case, f"curl, median [%] ({grid}: {100.0 * np.median(curl(true)):.2g})", curls, bench.missing),
        Line(9, case, f"curl, largest [%] ({grid}: {100.0 * curl(true).max():.2g})", worst, bench.missing),
        Line(9, case, f"curl off the {grid}'s own, median [%]", own, bench.missing),
        Line(9, case, f"stiffness off the {grid}'s, median [%]", off, bench.missing),
    ], None
