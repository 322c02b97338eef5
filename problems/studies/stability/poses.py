"""Rows 1 to 3: bad starts, lift-off, and poses far out of the learned range."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import least_squares

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, Array, pose_index
from casadi_contact.core.quantities import three_digits
from casadi_contact.optimisation.starts import pose_bounds
from casadi_contact.surrogate.base import Surrogate
from problems.studies.stability.methods import (
    EF_DIFFERENCES,
    Bench,
    Line,
    generalised,
    generalised_jacobian,
    normal_loads,
)

LIFTS_MM = (0.5, 2.0, 5.0, 20.0, -0.5, -2.0, -5.0)  # out of contact; below zero, too deep


def lifted(model: ElasticFoundation, poses: Array, lift_mm: float, rng: np.random.Generator) -> Array:
    """Poses moved at random in the scene's sensitive parameters by up to 1 mm (rotations over 25 mm), and by lift_mm
    against the force that the body presses with (into the other body, if negative)."""
    free = [pose_index(name) for name in model.scene.sensitive_pose]
    moved, force = poses.copy(), model.wrenches(poses)[:, :, :3].sum(axis=1)
    force[:, [k for k in range(3) if k not in free]] = 0.0
    moved[:, :3] -= lift_mm * force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
    moved[:, free] += rng.uniform(-1.0, 1.0, (len(moved), len(free))) / POSE_IN_MM[free]
    return moved


def starts(bench: Bench, count: int = 200, lifts_mm: tuple[float, ...] = LIFTS_MM) -> list[Line]:
    """Row 1: from bad starts, does settling under the loads that a method itself has at a pose find that pose again,
    within 0.01 mm, and in how many iterations? Poses press every patch by 20 N or more."""
    rng, scene = np.random.default_rng(1), bench.scene
    near = bench.poses[(normal_loads(bench.truth, bench.truth(bench.poses)) > 20.0).all(axis=1)]
    near = near[np.linspace(0, len(near) - 1, count).astype(int)]
    presses = ElasticFoundation(scene, scene.grids["coarse"])
    begun = [lifted(presses, near, lift, rng) for lift in lifts_mm]
    lines = []
    for start, lift in zip(begun, lifts_mm, strict=True):
        shares: dict[str, float | str] = {}
        for method, model in bench.models.items():
            loads = model(near)
            targets = {name: loads[:, model.load_names.index(name)] for name in scene.sensitive_loads}
            found, report = settle(model, start, scene.sensitive_pose, targets, tolerance=1e-3, max_iterations=100)
            there = np.abs((found - near) * POSE_IN_MM).max(axis=1) < 0.01  # mm
            good = report.converged & there & (normal_loads(model, loads) > 0.0).all(axis=1)
            used = f" / {np.median(report.iterations[good]):.0f}" if good.any() else ""
            shares[method] = f"{100.0 * good.mean():.0f}{used}"
        case = f"{abs(lift):g} mm {'out' if lift > 0.0 else 'too deep'}"
        lines.append(Line(1, case, f"of {count} solved [%] / median iterations", shares))
    return lines


def tilted(
    model: Any, pose: Array, moments: Array, free: tuple[str, ...], stiffness: Array
) -> tuple[Array, Array, np.ndarray]:
    """Poses (n, 6) in equilibrium under the contact loads at `pose`, additional moments (n,) [N·mm] along the last of
    the free parameters, and springs (free,) about `pose`; evaluations of each, and whether it is in equilibrium within
    0.1 N (moments over 25 mm). Each begins at the one before; SciPy's trust-region least squares for all methods."""
    columns = [pose_index(name) for name in free]
    scale = POSE_IN_MM[columns]
    target = generalised(model, pose)[columns]
    poses, used, solved = np.tile(pose, (len(moments), 1)), np.zeros(len(moments)), np.zeros(len(moments), dtype=bool)
    q = np.zeros(len(free))

    def at(x: Array) -> Array:
        moved = pose.copy()
        moved[columns] += x / scale
        return moved

    for k, moment in enumerate(moments):
        wanted = target + moment * (np.arange(len(free)) == len(free) - 1)

        def residual(x: Array, wanted: Array = wanted) -> Array:
            return np.asarray(generalised(model, at(x))[columns] - wanted + stiffness * x / scale) / scale

        def jacobian(x: Array) -> Array:
            slopes = generalised_jacobian(model, at(x)[None])[0][np.ix_(columns, columns)]
            return np.asarray((slopes + np.diag(stiffness)) / scale / scale[:, None])

        answer = least_squares(residual, q, jacobian, ftol=1e-15, xtol=1e-12, gtol=1e-9, max_nfev=100)
        q, used[k], poses[k] = answer.x, answer.nfev, at(answer.x)
        solved[k] = np.abs(answer.fun).max() <= 0.1
    return poses, used, solved


def lift_off_height(model: Any, pose: Array, patch: int, highest_mm: float = 5.0) -> float:
    """Height [mm] above a pose at which a patch ceases to carry load; NaN where it carries load 5 mm up."""
    up = np.eye(6)[pose_index("ty")]

    def carries(height: float) -> bool:
        return bool(normal_loads(model, model((pose + height * up)[None]))[0, patch] > 0.0)

    heights = np.linspace(0.0, highest_mm, 501)
    free = np.flatnonzero(normal_loads(model, model(pose + heights[:, None] * up))[:, patch] <= 0.0)
    if not len(free) or free[0] == 0:
        return float("nan")
    low, high = heights[free[0] - 1], heights[free[0]]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if carries(middle) else (low, middle)
    return float(low)


def one_sided(model: Any, pose: Array, height_mm: float, load: str) -> dict[str, tuple[float, float]]:
    """N [N], dN/dty [N/mm], d²N/dty² [N/mm²] of a vertical load just in contact and just out of it."""
    column, up = model.load_names.index(load), np.eye(6)[pose_index("ty")]
    sides: dict[str, list[float]] = {"N": [], "dN": [], "ddN": []}
    for way in (-1.0, 1.0):
        at = [pose + (height_mm + way * off) * up for off in (1e-5, 1e-3, 2e-3)]
        loads, slopes = model.jacobian(np.array(at))
        slope = 0.0 - slopes[:, column, pose_index("ty")]  # a difference, so that no load is 0, not -0
        sides["N"].append(0.0 - loads[0, column])
        sides["dN"].append(slope[0])
        sides["ddN"].append(way * (slope[2] - slope[1]) / 1e-3)
    return {name: (float(pair[0]), float(pair[1])) for name, pair in sides.items()}


def liftoff(bench: Bench, frames: int = 61, force_n: float = 800.0) -> list[Line]:
    """Row 2, of a knee: a moment about x lifts the lateral side off and lands it again, against a spring about rx; and
    the derivatives of its load where it lifts off."""
    free, stiffness = ("ty", "rx"), np.array([0.0, 1e5])
    first = bench.models[bench.surrogates[0]]
    pose = settle(first, bench.poses[:1], free, dict.fromkeys(bench.scene.sensitive_loads, -0.5 * force_n))[0][0]
    moments = 28.0 * force_n * np.sin(np.pi * np.linspace(0.0, 1.0, frames)) ** 2
    true, _, _ = tilted(bench.truth, pose, moments, free, stiffness)
    cells: dict[str, dict[str, float | str]] = {}
    for method, model in bench.models.items():
        poses, used, solved = tilted(model, pose, moments, free, stiffness)
        jump = (np.diff(poses, axis=0) - np.diff(true, axis=0)) * POSE_IN_MM
        cells[method] = {
            "frames solved [%]": 100.0 * float(solved.mean()),
            "evaluations per frame, mean / most": f"{used.mean():.1f} / {used.max():.0f}",
            "largest jump beyond the true motion [mm]": float(np.abs(jump).max()),
            "way out against way back [mm]": float(np.abs((poses - poses[::-1]) * POSE_IN_MM).max()),
        }
        height = lift_off_height(model, pose, bench.scene.patch_names.index("lat"))
        if not np.isnan(height):
            edge = one_sided(model, pose, height, "Fy_lat")
            for label, key in (("N [N]", "N"), ("dN/dty [N/mm]", "dN"), ("d²N/dty² [N/mm²]", "ddN")):
                cells[method][f"{label}, in contact → out"] = " → ".join(three_digits(slope) for slope in edge[key])
    quantities = dict.fromkeys(quantity for cell in cells.values() for quantity in cell)
    return [
        Line(2, "at lift-off" if "→" in q else f"{frames} frames", q, {m: c[q] for m, c in cells.items() if q in c})
        for q in quantities
    ]


def count_failures(model: Any, poses: Array, gaps_of: ElasticFoundation, apart_mm: float = 3.0) -> tuple[int, ...]:
    """Poses with a load that is not finite, with a pulling patch, with contact where the patch's surfaces are more than
    apart_mm apart; of a surrogate also how many of these have a validity above 1/2."""
    loads = np.concatenate([model(chunk) for chunk in np.array_split(poses, max(1, len(poses) // 5000))])
    broken = ~np.isfinite(loads).all(axis=1)
    pressed = normal_loads(model, loads)
    pulling, touching = (pressed < 0.0).any(axis=1), (pressed > 0.0).any(axis=1)
    apart = np.zeros(len(poses), dtype=bool)
    if touching.any():
        apart[touching] = ((gaps_of.gaps(poses[touching]) > apart_mm) & (pressed[touching] > 0.0)).any(axis=1)
    counts = tuple(int(rows.sum()) for rows in (broken, pulling, apart))
    if not isinstance(model, Surrogate):
        return counts
    wrong = poses[broken | pulling | apart]
    return (*counts, int((model.validity(wrong) > 0.5).sum()) if len(wrong) else 0)


def out_of_range(bench: Bench, count: int = 100_000, times: float = 3.0, per_parameter: int = 600) -> list[Line]:
    """Row 3: each parameter alone over three times the learned range, then all at once at random."""
    gaps_of = ElasticFoundation(bench.scene, bench.scene.grids["fine"])
    low, high = pose_bounds(bench.models[bench.surrogates[0]])
    middle, half = 0.5 * (low + high), 0.5 * times * (high - low)
    cases = {}
    for column, name in enumerate(POSE_NAMES):
        poses = np.tile(bench.poses[len(bench.poses) // 3], (per_parameter, 1))
        poses[:, column] = middle[column] + half[column] * np.linspace(-1.0, 1.0, per_parameter)
        cases[f"{name}, {per_parameter} poses"] = poses
    cases[f"all at random, {count:,} poses"] = middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (count, 6))
    models = {method: model for method, model in bench.models.items() if method != EF_DIFFERENCES}
    quantity = "not finite / pulling / false contact / of these called valid"
    return [
        Line(3, case, quantity, {m: " / ".join(map(str, count_failures(x, poses, gaps_of))) for m, x in models.items()})
        for case, poses in cases.items()
    ]
