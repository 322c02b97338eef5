"""Row 1: starts out of contact and too deep, from which single frames of the reference cycle are settled.

Every method is settled by the same Newton method from the same starts, so that their iterations can be compared.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_NAMES, Array, pose_index
from casadi_contact.scenes.load_cycle import LoadCycle
from casadi_contact.scenes.walking import reference_cycle
from problems.common.same_poses import same_poses
from problems.studies.stability.methods import Bench
from problems.studies.stability.table import Line

LIFTS_MM = (0.5, 2.0, 5.0, 20.0, -0.5, -2.0, -5.0)  # gap of the nearer side at the start; below zero, overlap
FRAMES = 20
FREE = ("tx", "ty", "tz", "rx")
_MOVES = {"tx": 4.0, "tz": 1.0, "rx": 0.05}


def lifted(model: ElasticFoundation, poses: Array, lift_mm: float, rng: np.random.Generator) -> Array:
    """Poses moved at random by up to 4 mm (tx), 1 mm (tz) and 0.05 rad (rx), then along ty until the nearer side is
    off by lift_mm (or overlaps by that much, if negative)."""
    moved = poses.copy()
    for name, size in _MOVES.items():
        moved[:, pose_index(name)] += rng.uniform(-size, size, len(moved))
    for _ in range(30):
        moved[:, pose_index("ty")] += lift_mm - model.gaps(moved).min(axis=1)
    return moved


def by_newton(model: Any, cycle: LoadCycle, frames: Array, near: Array, starts: Array) -> tuple[Array, Array]:
    """`settle` of each start (lifts, n, 6), of ty and rx under the two forces, then of the four free parameters under
    all four loads: solved (lifts, n), where it ends at the pose that is found from near (n, 6), and iterations."""
    fy = {"Fy_med": cycle.fy_med[frames], "Fy_lat": cycle.fy_lat[frames]}
    total = fy["Fy_med"] + fy["Fy_lat"]
    loads = {**fy, "Tx": -cycle.cop_ml_mm[frames] * total, "Tz": cycle.cop_ap_mm[frames] * total}

    def answer(poses: Array) -> tuple[Array, np.ndarray, Array]:
        pressed, first = settle(model, poses, ("ty", "rx"), fy, tolerance=0.1, max_iterations=30)
        found, second = settle(model, pressed, FREE, loads, tolerance=1e-3, max_iterations=100)
        return found, second.converged, first.iterations + second.iterations

    reference, known, _ = answer(near)
    outcomes = [answer(begin) for begin in starts]
    solved = [good & known & same_poses(found, reference) for found, good, _ in outcomes]
    return np.array(solved), np.array([used for _, _, used in outcomes])


def measure(
    bench: Bench, count: int = 200, lifts_mm: tuple[float, ...] = LIFTS_MM
) -> tuple[list[Line], dict[str, Any]]:
    """Lines of row 1; lifts_mm, and the shares solved (lifts,) by method."""
    cycle, rng = reference_cycle(), np.random.default_rng(1)
    frames = np.linspace(0, len(cycle) - 1, FRAMES).astype(int)[np.arange(count) % FRAMES]
    near = bench.poses[frames]
    near[:, POSE_NAMES.index("ry")], near[:, POSE_NAMES.index("rz")] = cycle.ry[frames], cycle.rz[frames]
    gaps_of = ElasticFoundation(bench.scene, bench.scene.grids["coarse"])
    starts = np.stack([lifted(gaps_of, near, lift, rng) for lift in lifts_mm])
    shares: dict[str, Array] = {}
    iterations: dict[str, Array] = {}
    for method, model in bench.models.items():
        solved, used = by_newton(model, cycle, frames, near, starts)
        shares[method] = solved.mean(axis=1)
        iterations[method] = np.array(
            [np.median(u[s]) if s.any() else np.nan for u, s in zip(used, solved, strict=True)]
        )
    lines = []
    for k, lift in enumerate(lifts_mm):
        case = f"{abs(lift):g} mm {'out' if lift > 0.0 else 'too deep'}"
        solved_cells = {m: 100.0 * float(share[k]) for m, share in shares.items()}
        lines.append(Line(1, case, f"of {count} solved [%]", solved_cells, bench.missing))
        used_cells = {m: float(i[k]) for m, i in iterations.items() if np.isfinite(i[k])}
        none = {m: "none solved" for m in bench.models if m not in used_cells}
        lines.append(Line(1, case, "iterations", used_cells, {**bench.missing, **none}))
    return lines, {"lifts_mm": list(lifts_mm), "shares": {m: share.tolist() for m, share in shares.items()}}
