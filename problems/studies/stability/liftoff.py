"""Row 2: one side lifts off and lands again, and what the derivatives of its load do where it does.

The joint carries 800 N; a torque about x rises and falls and lifts the lateral side, against a spring about rx (as
of ligaments). With ty and rx free, every frame is solved by SciPy's trust-region least squares from the frame before,
on each method's own values and Jacobian: as it is the same solver for all, what differs is the contact model.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.core.quantities import three_digits
from casadi_contact.optimisation.joint_mechanics import wrench_function
from casadi_contact.optimisation.starts import KNEE_STEPS
from problems.static_equilibrium.problem import residual_function
from problems.studies.stability.methods import PATCH, Bench
from problems.studies.stability.table import Line

FORCE_N, TORQUE_NMM = 800.0, 2.2e4  # the lateral side lifts off at about 800 N · 22 mm
STIFFNESS = np.array([0.0, 0.0, 0.0, 1e5, 0.0, 0.0])  # [N/mm, N·mm/rad]
FREE = ("ty", "rx")
_BALANCED_N = 0.1  # left over in a frame that counts as solved, torques over 25 mm
_COLUMNS = [pose_index(name) for name in FREE]
_HIGHEST_MM = 5.0
_NEAR_MM, _CURVED_MM = 1e-5, 1e-3  # where one-sided values and slopes, and second derivatives, are taken


def path(model: Any, pose: Array, frames: int) -> tuple[Array, Array, np.ndarray]:
    """Poses (frames, 6) under the torque, Jacobians used per frame, and whether each frame is in equilibrium."""
    contact = wrench_function(model)
    residual = residual_function(contact, FREE, "fixed", STIFFNESS, model.scene.pose_space)
    symbols = [ca.MX.sym(name, size) for name, size in (("q", len(FREE)), ("loads", 6), ("rest", 6))]
    slope = ca.Function("slope", symbols, [ca.jacobian(residual(*symbols), symbols[0])])
    scale = KNEE_STEPS[_COLUMNS]
    poses, used, solved = np.tile(pose, (frames, 1)), np.zeros(frames), np.zeros(frames, dtype=bool)
    q = pose[_COLUMNS] / scale
    for k, torque in enumerate(TORQUE_NMM * np.sin(np.pi * np.linspace(0.0, 1.0, frames)) ** 2):
        given = (np.array([0.0, -FORCE_N, 0.0, torque, 0.0, 0.0]), pose)
        answer = least_squares(
            lambda x, given=given: np.asarray(residual(x, *given)).ravel(),
            q,
            jac=lambda x, given=given: np.asarray(slope(x, *given)),
            ftol=1e-15,
            xtol=1e-12,
            gtol=1e-9,
            max_nfev=100,
        )
        q, used[k] = answer.x, answer.njev
        poses[k, _COLUMNS] = q * scale
        solved[k] = np.abs(answer.fun).max() <= _BALANCED_N
    return poses, used, solved


def lift_off_height(model: Any, pose: Array) -> float:
    """Height [mm] above a pose at which the lateral side ends to carry load; NaN where it carries it 5 mm up still."""
    lateral, up = model.load_names.index("Fy_lat"), np.eye(6)[pose_index("ty")]
    heights = np.linspace(0.0, _HIGHEST_MM, 501)
    free = np.flatnonzero(model(pose + heights[:, None] * up)[:, lateral] >= 0.0)
    if not len(free) or free[0] == 0:
        return float("nan")
    low, high = heights[free[0] - 1], heights[free[0]]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if model((pose + middle * up)[None])[0, lateral] < 0.0 else (low, middle)
    return float(low)


def one_sided(model: Any, pose: Array, height_mm: float) -> dict[str, tuple[float, float]]:
    """N [N], dN/dty [N/mm], d²N/dty² [N/mm²] of the lateral side just in contact and just out of it."""
    lateral, up = model.load_names.index("Fy_lat"), np.eye(6)[pose_index("ty")]
    sides: dict[str, list[float]] = {"N": [], "dN": [], "ddN": []}
    for way in (-1.0, 1.0):
        at = [pose + (height_mm + way * off) * up for off in (_NEAR_MM, _CURVED_MM, 2.0 * _CURVED_MM)]
        loads, slopes = model.jacobian(np.array(at))
        slope = 0.0 - slopes[:, lateral, pose_index("ty")]  # a difference, so that no load is 0, not -0
        sides["N"].append(0.0 - loads[0, lateral])
        sides["dN"].append(slope[0])
        sides["ddN"].append(way * (slope[2] - slope[1]) / _CURVED_MM)
    return {name: (float(pair[0]), float(pair[1])) for name, pair in sides.items()}


def measure(bench: Bench, frames: int = 61) -> tuple[list[Line], dict[str, Any]]:
    """Lines of row 2, and rx (frames,) [rad] by method."""
    sides = dict.fromkeys(bench.scene.sensitive_loads, -0.5 * FORCE_N)
    pose = settle(bench.models[PATCH], bench.poses[:1], FREE, sides)[0][0]
    true, _, _ = path(bench.teacher, pose, frames)
    cells: dict[str, dict[str, float | str]] = {}
    courses = {bench.teacher.label: true}
    never: dict[str, str] = {}
    for method, model in bench.models.items():
        poses, used, solved = path(model, pose, frames)
        courses[method] = poses
        off = (np.diff(poses, axis=0) - np.diff(true, axis=0)) * POSE_IN_MM
        back = (poses - poses[::-1]) * POSE_IN_MM
        cells[method] = {
            "frames solved [%]": 100.0 * float(solved.mean()),
            "iterations per frame, mean / most": f"{used.mean():.1f} / {used.max():.0f}",
            "largest jump from frame to frame beyond the true motion [mm]": float(np.abs(off).max()),
            "way out against way back, largest difference [mm]": float(np.abs(back).max()),
        }
        height = lift_off_height(model, pose)
        if np.isnan(height):
            never[method] = f"still carries load {_HIGHEST_MM:g} mm up: never lifts off"
            continue
        edge = one_sided(model, pose, height)
        for label, key in (("N [N]", "N"), ("dN/dty [N/mm]", "dN"), ("d²N/dty² [N/mm²]", "ddN")):
            cells[method][f"{label}, in contact → out"] = " → ".join(three_digits(slope) for slope in edge[key][:2])
    lines = []
    for quantity in cells[PATCH]:
        edge_of = "→" in quantity
        values = {m: c[quantity] for m, c in cells.items() if quantity in c}
        why = {**bench.missing, **(never if edge_of else {})}
        lines.append(Line(2, "at lift-off" if edge_of else f"{frames} frames", quantity, values, why))
    return lines, {name: poses[:, pose_index("rx")].tolist() for name, poses in courses.items()}
