"""Rows 4 to 6: what derivatives are worth: differences against exact ones, stable time steps, consistency."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from casadi_contact.core.conventions import LEVER_MM, POSE_IN_MM, Array, pose_index
from casadi_contact.core.quantities import newton_scales
from problems.studies.stability.methods import (
    EF_ANALYTIC,
    EF_DIFFERENCES,
    Bench,
    Line,
    by_differences,
    generalised,
    generalised_jacobian,
)


def relative_error(jacobian: Array, true: Array, load_names: tuple[str, ...]) -> float:
    """RMS over poses of ‖S_L(J - J*)S_q‖/‖S_L·J*·S_q‖ (Frobenius) of Jacobians (n, L, 6): torques over 25 mm, rotations
    times 25 mm."""
    scale = 1.0 / newton_scales(load_names, LEVER_MM)[:, None] / POSE_IN_MM
    off = np.linalg.norm((jacobian - true) * scale, axis=(1, 2)) / np.linalg.norm(true * scale, axis=(1, 2))
    return float(np.sqrt(np.mean(off**2)))


def difference_steps(
    bench: Bench, count: int = 20, steps_mm: Sequence[float] = (1e-9, 1e-7, 1e-5, 1e-3, 1e-1)
) -> list[Line]:
    """Row 4: central differences of each method against its own Jacobian, and that against the true one."""
    poses = bench.poses[np.linspace(0, len(bench.poses) - 1, count).astype(int)]
    true = bench.truth.jacobian(poses)[1]
    own = {method: model.jacobian(poses)[1] for method, model in bench.models.items()}
    # Elements whose Jacobian is by differences are compared with the analytic one of the same elements.
    exact = {**own, EF_DIFFERENCES: own[EF_ANALYTIC]} if EF_DIFFERENCES in own else own
    lines = []
    for step in steps_mm:
        errors: dict[str, float | str] = {
            method: relative_error(by_differences(model, poses, step), exact[method], model.load_names)
            for method, model in bench.models.items()
            if method != EF_ANALYTIC
        }
        lines.append(Line(4, f"central, step {step:g} mm", "relative error", errors))
    off: dict[str, float | str] = {m: relative_error(j, true, bench.models[m].load_names) for m, j in own.items()}
    return [*lines, Line(4, f"as used, against the {bench.truth.label}", "relative error", off)]


def explicit_euler(rate: Callable[[Array], Array], x: Array, h: float) -> Array:
    """x + h·f(x)."""
    return x + h * rate(x)


def runge_kutta_4(rate: Callable[[Array], Array], x: Array, h: float) -> Array:
    """The classical scheme of order 4."""
    k1 = rate(x)
    k2 = rate(x + 0.5 * h * k1)
    k3 = rate(x + 0.5 * h * k2)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(x + h * k3))


def motion_about_rest(
    model: Any, pose: Array, free: Sequence[str], mass_kg: float = 5.0, damping: float = 0.1
) -> Callable[[Array], Array]:
    """Rate of (q, v) of a body in the free parameters [mm, rotations times 25 mm] about a pose where its contact loads
    are balanced: m·q'' = Q(0) - Q(q) - 2ζ√(k·m)·q', with k the largest eigenvalue of dQ/dq there."""
    columns, mass = [pose_index(name) for name in free], 1e-3 * mass_kg
    scale = POSE_IN_MM[columns]
    forces, slopes = generalised(model, pose)[columns], generalised_jacobian(model, pose[None])[0]
    stiffness = np.linalg.eigvals(slopes[np.ix_(columns, columns)] / scale / scale[:, None]).real.max()
    drag = 2.0 * damping * np.sqrt(max(stiffness, 0.0) * mass)

    def rate(state: Array) -> Array:
        q, v = np.split(state, 2)
        moved = pose.copy()
        moved[columns] += q / scale
        off = (generalised(model, moved)[columns] - forces) / scale
        return np.concatenate([v, (-off - drag * v) / mass])

    return rate


def largest_stable_step(
    scheme: Callable[..., Array], rate: Callable[[Array], Array], size: int, steps: int = 200, longest_s: float = 0.1
) -> float:
    """Largest fixed step [s] with which a body 0.001 mm off its rest stays within three times that for `steps` steps:
    halved from longest_s, then bisected in the logarithm; 0 where none above 1 ns is stable."""

    def stable(h: float) -> bool:
        state = np.concatenate([np.full(size, 1e-3), np.zeros(size)])
        for _ in range(steps):
            state = scheme(rate, state, h)
            if not np.isfinite(state).all() or np.abs(state[:size]).max() > 1.0:
                return False
        return bool(np.abs(state[:size]).max() <= 3e-3)

    high = longest_s
    while not stable(high):
        high *= 0.5
        if high < 1e-9:
            return 0.0
    low, high = high, 2.0 * high
    for _ in range(8 if low < longest_s else 0):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def time_steps(bench: Bench, count: int = 3, steps: int = 100) -> list[Line]:
    """Row 5: poses of the motion under more and more load. For a linear spring the bounds are 2.8/ω for Runge-Kutta and
    2ζ/ω for Euler, ω = √(k/m)."""
    free = bench.scene.sensitive_pose
    size = np.linalg.norm(bench.truth.wrenches(bench.poses)[:, :, :3].sum(axis=1), axis=1)
    lines = []
    for k in np.argsort(size)[np.linspace(0.2 * len(size), len(size) - 1, count).astype(int)]:
        for scheme in (explicit_euler, runge_kutta_4):
            found: dict[str, float | str] = {
                method: 1e3
                * largest_stable_step(scheme, motion_about_rest(model, bench.poses[k], free), len(free), steps)
                for method, model in bench.models.items()
            }
            lines.append(Line(5, f"{size[k]:.0f} N", f"{scheme.__name__.replace('_', ' ')} [ms]", found))
    return lines


def curl(k: Array) -> Array:
    """‖K - Kᵀ‖/2‖K‖ (n,) of K = S·dQ/dq·S: zero where contact conserves energy."""
    return np.asarray(np.linalg.norm(k - np.swapaxes(k, 1, 2), axis=(1, 2)) / (2.0 * np.linalg.norm(k, axis=(1, 2))))


def stiffness(model: Any, poses: Array) -> Array:
    """K = S·dQ/dq·S (n, 6, 6) [N/mm] of the contact loads, rotations times 25 mm."""
    return np.asarray(generalised_jacobian(model, poses) / POSE_IN_MM[:, None] / POSE_IN_MM)


def consistency(bench: Bench) -> list[Line]:
    """Row 6: is the force field a gradient, and is the stiffness that of the finest elements? These are not quite
    conservative: they press along their normals, but measure depth to where the ray meets the other body."""
    true, case = stiffness(bench.truth, bench.poses), f"{len(bench.poses)} frames of the motion"
    found = {method: stiffness(model, bench.poses) for method, model in bench.models.items()}
    found = {method: k for method, k in found.items() if (np.linalg.norm(k, axis=(1, 2)) > 0.0).all()}
    off = {m: np.linalg.norm(k - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2)) for m, k in found.items()}
    grid = f"{bench.truth.label}: {100.0 * np.median(curl(true)):.2g}"
    return [
        Line(6, case, f"curl, median [%] ({grid})", {m: 100.0 * float(np.median(curl(k))) for m, k in found.items()}),
        Line(6, case, "curl, largest [%]", {m: 100.0 * float(curl(k).max()) for m, k in found.items()}),
        Line(6, case, "stiffness off, median [%]", {m: 100.0 * float(np.median(share)) for m, share in off.items()}),
    ]
