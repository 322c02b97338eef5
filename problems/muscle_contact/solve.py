"""The solution of muscle and contact forces together, and what is left of each balance."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.optimisation import IpoptOutcome, ipopt_options
from problems.muscle_contact.knee_coordinates import CONTACT_LOADS, contact_on_femur, in_newtons
from problems.muscle_contact.problem import RESERVE_SIZES, MuscleContact

TOLERANCE_N = 0.1  # of a balanced coordinate, moments over LEVER_MM


@dataclass(frozen=True)
class MuscleContactResult:
    """Activations and forces along the tendons (n, m), poses (n, 6), contact loads there (n, 7) as in
    `CONTACT_LOADS`, reserves and what is left of each balance [N, N·m] by coordinate, soleus' activation (n,) where the
    ankle counts, and what became of the frames."""

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

    @property
    def overloaded(self) -> np.ndarray:
        """True (n,) where a reserve gives more than its size, or soleus more than it can: muscles and contact alone do
        not balance the frame."""
        shares = [np.abs(curve) / RESERVE_SIZES[name] for name, curve in self.reserves.items()]
        shares += [] if self.soleus is None else [self.soleus]
        return np.asarray(np.max(shares, axis=0) > 1.0)


def solve(problem: MuscleContact, max_iterations: int = 500, print_level: int = 0) -> MuscleContactResult:
    """Solve with IPOPT and its exact Hessian. Never raises for frames that do not converge: each is reported."""
    began = time.perf_counter()
    options = ipopt_options(tolerance=1e-7, max_iterations=max_iterations, print_level=print_level)
    solver = ca.nlpsol("muscle_contact", "ipopt", problem.nlp, options)
    answer = solver(x0=problem.start, lbx=problem.lower, ubx=problem.upper, lbg=problem.lower_g, ubg=problem.upper_g)
    outcome = IpoptOutcome.of(solver)
    seconds = time.perf_counter() - began
    activations, poses, forces, reserves, soleus = (np.asarray(part).T for part in problem.solution(answer["x"]))
    driven = soleus[:, 0] if soleus.size else None
    return _result(problem, activations, poses, forces, reserves, driven, outcome, seconds)


def _result(
    problem: MuscleContact,
    activations: Array,
    poses: Array,
    forces: Array,
    reserves: Array,
    soleus: Array | None,
    outcome: IpoptOutcome,
    seconds: float,
) -> MuscleContactResult:
    """What is left of each balance, evaluated anew from the model's NumPy side, and whether frames hold."""
    walk = problem.walk
    loads = problem.contact_model(poses, CONTACT_LOADS)
    contact = contact_on_femur(poses, loads)
    named = {name: reserves[:, column] for column, name in enumerate(problem.balanced)}
    left = {
        name: (walk.arms[name] * forces).sum(axis=1) + contact[name] + named[name] - walk.loads[name]
        for name in problem.balanced
    }
    worst = np.abs(np.column_stack([in_newtons(name) * left[name] for name in problem.balanced])).max(axis=1)
    converged = (worst <= TOLERANCE_N) & outcome.solved
    reason = np.full(len(walk), "", dtype=object)
    for k in np.flatnonzero(~converged):
        reason[k] = f"balance is off by {worst[k]:.3g} N" if outcome.solved else f"IPOPT stopped: {outcome.status}"
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
    )
