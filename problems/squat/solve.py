"""The squats of a trade-off, each from the one before or from one that turns out cheaper."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array, pose_index
from casadi_contact.optimisation import KNEE_STEPS, IpoptOutcome, ipopt_options, middle_pose, settle_in_range
from problems.squat.muscles import MUSCLES
from problems.squat.problem import FREE, Squat, at_bounds, flexion_rad

_START_FORCE_N = 600.0  # of each side
_START_ACTIVATION = 0.2
_LIGHT = (0.0, 1e-3)  # these weights' squats from the start values may cost less than those from heavier ones
_FAR, _NEAR = 1e-2, 1e-4  # IPOPT's first barrier: the large one leaves the valley of the cost where it starts
_ROUNDS = 3
_CHEAPER = 1.0 - 1e-4  # farther apart than two solutions of one optimum
_FULLY = 0.999  # activation of a muscle that has no more to give
_SHARES = np.array([0.35, -0.65, 0.45])  # lean of shank, thigh and trunk over the flexion


@dataclass(frozen=True)
class SquatResult:
    """One squat: x of its problem, and at the collocation points angles φ and rates (n, 3) [rad, rad/s], activations
    and muscle forces (n, m), poses (n, 6), contact loads (n, L); effort: mean squared activation; medial_bw: root mean
    square of the medial force over body weight; iterations and seconds of the solver in the run that ended here."""

    weight: float
    x: Array
    time_s: Array
    phi: Array
    rates: Array
    activations: Array
    muscle_forces_n: Array
    poses: Array
    loads: Array
    effort: float
    medial_bw: float
    solved: bool
    ipopt_status: str
    iterations: int
    seconds: float

    @property
    def at_bounds(self) -> str:
        """The bounds of the search that hold this squat (`at_bounds`), "" for none."""
        return at_bounds(self.phi, self.poses)

    @property
    def exhausted(self) -> tuple[str, ...]:
        """The muscles that are fully active at some moment."""
        full = self.activations.max(axis=0) >= _FULLY
        return tuple(name for name, is_full in zip(MUSCLES, full, strict=True) if is_full)


def start_values(squat: Squat) -> Array:
    """x of a smooth squat: shank and trunk lean forward by shares of the flexion; the knee pressed by equal forces."""

    def angles(time_s: Array) -> tuple[Array, Array]:
        """φ (n, 3) and rates (n, 3)."""
        flexion = flexion_rad(time_s, squat.depth_deg, squat.grid.duration_s)
        return np.outer(flexion, _SHARES), np.outer(np.gradient(flexion, time_s), _SHARES)

    nodes, points = np.linspace(0.0, squat.grid.duration_s, squat.grid.intervals + 1), squat.grid.times_s
    phi, rates = angles(points)
    rest = np.tile(middle_pose(squat.model), (len(points), 1))
    rest[:, [pose_index(name) for name in ("tx", "tz", "rx", "ry")]] = 0.0
    rest[:, pose_index("rz")] = phi[:, 1] - phi[:, 0]
    sides = dict.fromkeys(squat.model.scene.sensitive_loads, np.full(len(points), -_START_FORCE_N))
    poses = settle_in_range(squat.model, rest, rest, FREE, sides)
    columns = [pose_index(name) for name in FREE]
    activations = np.full((len(points), len(MUSCLES)), _START_ACTIVATION)
    parts = (*angles(nodes), phi, rates, activations, poses[:, columns] / KNEE_STEPS[columns])
    return np.clip(np.concatenate([part.ravel() for part in parts]), squat.lower, squat.upper)


def trade_off(squat: Squat, weights: Sequence[float]) -> list[SquatResult]:
    """A squat for each weight. The largest weight comes first and each begins at the one before. The cost has many
    local optima, and every squat is feasible at every weight: where one costs less than a weight's own, that weight
    begins there once more. Squats from the start values with two light weights count among these. No optimum is proven
    to be global. Never raises where one does not converge.

    Raises ValueError for a weight that is negative or not finite.
    """
    if not len(weights) or not all(0.0 <= weight < np.inf for weight in weights):
        raise ValueError(f"weights are {', '.join(map(str, weights)) or '(none)'}, expected finite numbers >= 0")
    far, near = (
        ca.nlpsol("squat", "ipopt", squat.nlp, ipopt_options(tolerance=1e-6, max_iterations=300, mu_init=barrier))
        for barrier in (_FAR, _NEAR)
    )
    bounds = {"lbx": squat.lower, "ubx": squat.upper, "lbg": squat.lower_g, "ubg": squat.upper_g}
    value = ca.Function("cost", [squat.nlp["x"], squat.nlp["p"]], [squat.nlp["f"]])

    def solve(solver: ca.Function, weight: float, x: Array) -> SquatResult:
        began = time.perf_counter()
        answer = np.asarray(solver(x0=x, p=weight, **bounds)["x"])[:, 0]
        return _result(squat, weight, answer, IpoptOutcome.of(solver), time.perf_counter() - began)

    def cost(result: SquatResult, weight: float) -> float:
        return float(value(result.x, weight)) if result.solved else np.inf

    start = x = start_values(squat)
    found: dict[float, SquatResult] = {}
    for weight in sorted(set(weights), reverse=True):
        found[weight] = solve(far, weight, x)
        x = found[weight].x if found[weight].solved else x
    light = [solve(far, weight, start) for weight in _LIGHT]
    for _ in range(_ROUNDS):
        for weight, own in list(found.items()):
            cheapest = min((*light, *found.values()), key=lambda result: cost(result, weight))
            if cost(cheapest, weight) < _CHEAPER * cost(own, weight):
                found[weight] = min(own, solve(near, weight, cheapest.x), key=lambda result: cost(result, weight))
    return [found[weight] for weight in weights]


def _result(squat: Squat, weight: float, x: Array, outcome: IpoptOutcome, seconds: float) -> SquatResult:
    phi, rates, activations, poses = (np.asarray(part).T for part in squat.unpack(x))
    loads, weights = squat.model(poses), squat.grid.weights
    medial = loads[:, squat.model.load_names.index("Fy_med")] / squat.mechanics.body.weight_n
    forces = np.asarray(squat.mechanics.muscle_forces.map(len(phi))(phi.T, rates.T, activations.T)).T
    return SquatResult(
        weight=weight,
        x=x,
        time_s=squat.grid.times_s,
        phi=phi,
        rates=rates,
        activations=activations,
        muscle_forces_n=forces,
        poses=poses,
        loads=loads,
        effort=float(weights @ np.mean(activations**2, axis=1)),
        medial_bw=float(np.sqrt(weights @ medial**2)),
        solved=outcome.solved,
        ipopt_status=outcome.status,
        iterations=outcome.iterations,
        seconds=seconds,
    )
