"""Row 1 of any scene: starts moved out of contact and too deep, settled under the loads that a method itself carries.

Unlike pose estimation of the knee (`starts`) this frees the scene's sensitive pose parameters alone, and asks each
method for its own loads in the motion's poses: each has a solution, and the question is whether it is found again.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_IN_MM, Array, pose_index
from problems.common.same_poses import same_poses
from problems.studies.stability.methods import Bench
from problems.studies.stability.normals import normal_of
from problems.studies.stability.starts import LIFTS_MM
from problems.studies.stability.table import Line

FRAMES = 20
LEAST_LOAD_N = 20.0  # of every patch in a frame that is asked for: below, a pose is hardly determined
_MOVE_MM = 1.0  # of each free parameter at random, rotations over 25 mm


def lifted(model: ElasticFoundation, poses: Array, lift_mm: float, rng: np.random.Generator) -> Array:
    """Poses moved at random in the scene's sensitive parameters by up to 1 mm (rotations over 25 mm), and by lift_mm
    against the force that the body presses with, as far as these parameters go (into the other body, if negative)."""
    free = [pose_index(name) for name in model.scene.sensitive_pose]
    moved, force = poses.copy(), model.wrenches(poses)[:, :, :3].sum(axis=1)
    force[:, [k for k in range(3) if k not in free]] = 0.0
    moved[:, :3] -= lift_mm * force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
    moved[:, free] += rng.uniform(-_MOVE_MM, _MOVE_MM, (len(moved), len(free))) / POSE_IN_MM[free]
    return moved


def measure(
    bench: Bench, count: int = 200, lifts_mm: tuple[float, ...] = LIFTS_MM
) -> tuple[list[Line], dict[str, Any]]:
    """Lines of row 1; lifts_mm, and the shares solved (lifts,) by method. A start is solved where it settles within
    0.01 mm of the motion's pose."""
    rng, scene = np.random.default_rng(1), bench.scene
    bears = (normal_of(bench.teacher, bench.teacher(bench.poses)) > LEAST_LOAD_N).all(axis=1)
    frames = np.flatnonzero(bears)
    if not len(frames):
        why = f"no frame of the motion presses every patch by {LEAST_LOAD_N:g} N"
        return [Line(1, "starts", "solved [%]", {}, dict.fromkeys(bench.models, why))], {}
    frames = frames[np.linspace(0, len(frames) - 1, FRAMES).astype(int)][np.arange(count) % FRAMES]
    near, names = bench.poses[frames], scene.sensitive_loads
    presses = ElasticFoundation(scene, scene.grids["coarse"])
    starts = [lifted(presses, near, lift, rng) for lift in lifts_mm]
    solved: dict[str, list[float]] = {}
    used: dict[str, list[float]] = {}
    for method, model in bench.models.items():
        carried = model(near)
        targets = {name: carried[:, model.load_names.index(name)] for name in names}
        asked = (normal_of(model, carried) > 0.0).all(axis=1)
        solved[method], used[method] = [], []
        for begun in starts:
            found, report = settle(model, begun, scene.sensitive_pose, targets, tolerance=1e-3, max_iterations=100)
            good = report.converged & same_poses(found, near) & asked
            solved[method].append(float(good.mean()))
            used[method].append(float(np.median(report.iterations[good])) if good.any() else np.nan)
    lines = []
    for k, lift in enumerate(lifts_mm):
        case = f"moved {abs(lift):g} mm {'out' if lift > 0.0 else 'in'}"
        shares: dict[str, float | str] = {m: 100.0 * share[k] for m, share in solved.items()}
        lines.append(Line(1, case, f"of {count} solved [%]", shares, bench.missing))
        known: dict[str, float | str] = {m: n[k] for m, n in used.items() if np.isfinite(n[k])}
        none = {m: "none solved" for m in bench.models if m not in known}
        lines.append(Line(1, case, "iterations", known, {**bench.missing, **none}))
    return lines, {"lifts_mm": list(lifts_mm), "shares": solved}
