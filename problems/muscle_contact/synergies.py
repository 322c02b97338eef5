"""Muscles that are driven by a few synergies: five for a leg in Walter et al. (J Biomech Eng 136 (2014) 021031).

    a_m(t) = Σ_j W_mj·C_j(t),    W, C >= 0,    Σ_m W_mj = 1        j = 1 ... count

The synergy vector W_j says how strongly synergy j drives each muscle, the same over the whole cycle, and so couples all
frames; C_j is its command. Both are found with all other variables in one IPOPT problem. W and C begin where they
factor the activations of muscles that are each driven alone best; all else begins where that problem began, since from
its solution IPOPT takes as many iterations. Synergies know no measured contact force.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.optimize import nnls

from casadi_contact.core.conventions import Array
from problems.muscle_contact.problem import MuscleContact
from problems.muscle_contact.solve import solve

SYNERGIES = 5
_ROUNDS = 200
_SCALE = 10.0  # of the synergy vectors' variables, which sum to one over a dozen muscles


def driven_by_synergies(problem: MuscleContact, count: int = SYNERGIES) -> MuscleContact:
    """The problem with activations (soleus' apart) that are combinations of `count` synergies; it is solved without
    them first, for a start of vectors and commands.

    Raises ValueError for less than one synergy, for as many as there are muscles or more, and for a problem with a
    patella.
    """
    muscles, frames = len(problem.muscles.names), len(problem.walk)
    if not 1 <= count < muscles:
        raise ValueError(f"got {count} synergies, expected 1 to {muscles - 1}, fewer than the {muscles} muscles")
    if problem.extensor is not None:
        raise ValueError("got synergies and a patella, expected one of them: leave out --synergies or --patella")
    alone = solve(problem)
    vectors, commands = factored(alone.activations.T, count)
    x = problem.nlp["x"]
    w, c = ca.MX.sym("vectors", muscles, count), ca.MX.sym("commands", count, frames)
    activations = problem.solution(x)[0]
    apart = activations - ca.mtimes(w / _SCALE, c)
    whole = ca.vertcat(x, ca.vec(w), ca.vec(c))
    unknown = whole.numel() - x.numel()
    met = apart.numel() + count
    return replace(
        problem,
        nlp={**problem.nlp, "x": whole, "g": ca.vertcat(problem.nlp["g"], ca.vec(apart), ca.sum1(w).T / _SCALE - 1.0)},
        lower=np.concatenate([problem.lower, np.zeros(unknown)]),
        upper=np.concatenate([problem.upper, np.full(unknown, np.inf)]),
        lower_g=np.concatenate([problem.lower_g, np.zeros(met)]),
        upper_g=np.concatenate([problem.upper_g, np.zeros(met)]),
        start=np.concatenate([problem.start, _SCALE * vectors.ravel("F"), commands.ravel("F")]),
        solution=ca.Function("solution", [whole], problem.solution(x)),
    )


def factored(activations: Array, count: int) -> tuple[Array, Array]:
    """Synergy vectors W (m, count), each of sum one, and commands C (count, n), both >= 0, whose product is near
    activations (m, n) >= 0: least squares for one and the other by turns, from the leading singular vectors."""
    left, _, _ = np.linalg.svd(activations, full_matrices=False)
    vectors = np.abs(left[:, :count])
    for _ in range(_ROUNDS):
        commands = np.array([nnls(vectors, column)[0] for column in activations.T]).T
        vectors = np.array([nnls(commands.T, row)[0] for row in activations])
    sums = np.maximum(vectors.sum(axis=0), np.finfo(float).tiny)
    return vectors / sums, commands * sums[:, None]
