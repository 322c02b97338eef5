"""The solution of muscle and contact forces together, and what is left of each balance."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import three_digits
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.optimisation.knee import KNEE_LOADS, contact_on_femur, in_newtons
from problems.muscle_contact.extensor import PatellaResult, quadriceps
from problems.muscle_contact.problem import RESERVE_SIZES, MuscleContact

TOLERANCE_N = 0.1  # of a balanced coordinate, moments over LEVER_MM


@dataclass(frozen=True)
class MuscleContactResult:
    """Activations and forces along the tendons (n, m), poses (n, 6), contact loads there (n, 7) as in
    `KNEE_LOADS`, reserves and what is left of each balance [N, N·m] by coordinate, soleus' activation (n,) where the
    ankle counts, what became of the frames, and the patella where it is part of the problem."""

    activations: Array
    muscle_forces_n: Array
    poses: Array
    loads: Array
    reserves: Mapping[str, Array]
    unbalanced: Mapping[str, Array]
    soleus: Array | None
    converged: np.ndarray
    reason: np.ndarray
    ipopt_status: str
    iterations: int
    seconds: float
    patella: PatellaResult | None = None

    @property
    def overloaded(self) -> np.ndarray:
        """True (n,) where a reserve gives more than its size, or soleus more than it can: muscles and contact alone do
        not balance the frame."""
        shares = [np.abs(curve) / RESERVE_SIZES[name] for name, curve in self.reserves.items()]
        shares += [] if self.soleus is None else [self.soleus]
        return np.asarray(np.max(shares, axis=0) > 1.0)


def solve(problem: MuscleContact, max_iterations: int = 500, print_level: int = 0) -> MuscleContactResult:
    """Solve with IPOPT and its exact Hessian, with a patella from the solution of its first problem. Never raises for
    frames that do not converge: each is reported."""
    began = time.perf_counter()
    x, outcome = _optimum(problem, max_iterations, print_level)
    seconds = time.perf_counter() - began
    activations, poses, forces, reserves, soleus, patella = (np.asarray(part).T for part in problem.solution(x))
    driven = soleus[:, 0] if soleus.size else None
    return _result(problem, activations, poses, forces, reserves, driven, patella, outcome, seconds)


def _optimum(problem: MuscleContact, max_iterations: int, print_level: int) -> tuple[Array, IpoptOutcome]:
    """The optimal variables, and what became of them."""
    start, resting, warm = problem.start, np.zeros(0), {}
    if problem.first is not None and problem.extensor is not None:
        first, _ = _optimum(problem.first, max_iterations, print_level)
        _, poses, forces, *_ = (np.asarray(part).T for part in problem.first.solution(first))
        tension_n = forces[:, quadriceps(problem.walk.muscles.names)].sum(axis=1)
        settled = problem.extensor.settled(poses, tension_n)
        at = problem.extensor.contact_poses(poses, settled) / problem.extensor.steps
        start = np.hstack([first.reshape(len(poses), -1), at]).ravel()
        resting, warm = at.ravel(), {"mu_init": 1e-3}
    options = ipopt_options(tolerance=1e-7, max_iterations=max_iterations, print_level=print_level, **warm)
    solver = ca.nlpsol("muscle_contact", "ipopt", problem.nlp, options)
    bounds = {"lbx": problem.lower, "ubx": problem.upper, "lbg": problem.lower_g, "ubg": problem.upper_g}
    return np.asarray(solver(x0=start, p=resting, **bounds)["x"])[:, 0], IpoptOutcome.of(solver)


def _result(
    problem: MuscleContact,
    activations: Array,
    poses: Array,
    forces: Array,
    reserves: Array,
    soleus: Array | None,
    patella_poses: Array,
    outcome: IpoptOutcome,
    seconds: float,
) -> MuscleContactResult:
    """What is left of each balance, evaluated anew from the model's NumPy side, and whether frames hold."""
    walk, extensor = problem.walk, problem.extensor
    loads = problem.contact_model(poses, KNEE_LOADS)
    contact = contact_on_femur(poses, loads)
    named = {name: reserves[:, column] for column, name in enumerate(problem.balanced)}
    direct, by_patella, patella = forces.copy(), dict.fromkeys(problem.balanced, np.zeros(len(walk))), None
    if extensor is not None:
        through = quadriceps(walk.muscles.names)
        by_patella, left_n = extensor.on_femur(poses, patella_poses, forces[:, through].sum(axis=1))
        direct[:, through] = 0.0
        grooved = extensor.contact_poses(poses, patella_poses)
        patella = PatellaResult(patella_poses, grooved, extensor.loads(poses, patella_poses), left_n)
    left = {
        name: (walk.arms[name] * direct).sum(axis=1) + by_patella[name] + contact[name] + named[name] - walk.loads[name]
        for name in problem.balanced
    }
    worst = np.abs(np.column_stack([in_newtons(name) * left[name] for name in problem.balanced])).max(axis=1)
    worst = worst if patella is None else np.maximum(worst, patella.left_n)
    converged = (worst <= TOLERANCE_N) & outcome.solved
    reason = np.full(len(walk), "", dtype=object)
    for k in np.flatnonzero(~converged):
        reason[k] = (
            f"balance is off by {three_digits(worst[k])} N" if outcome.solved else f"IPOPT stopped: {outcome.status}"
        )
    return MuscleContactResult(
        activations,
        forces,
        poses,
        loads,
        named,
        left,
        soleus,
        converged,
        reason,
        outcome.status,
        outcome.iterations,
        seconds,
        patella,
    )
