"""How often settling from starts out of contact and too deep ends at the same poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from problems.common.same_poses import same_poses
from problems.static_equilibrium.balance import Balance
from problems.static_equilibrium.problem import StaticEquilibrium
from problems.static_equilibrium.solve import EquilibriumResult, solve

LIFTS_MM = (0.5, 2.0, 5.0, 20.0, -0.5, -2.0, -5.0)  # starts out of contact, and too deep


@dataclass(frozen=True)
class LiftedStarts:
    """For each lift: share of the rows in equilibrium (lifts,) that end at the same pose, and median IPOPT iterations;
    count: random starts of each."""

    lifts_mm: tuple[float, ...]
    count: int
    shares: Array
    iterations: Array

    def record(self) -> dict[str, Any]:
        """Plain values for a summary."""
        return {
            "count": self.count,
            "lifts_mm": list(self.lifts_mm),
            "shares": self.shares.tolist(),
            "median_iterations": self.iterations.tolist(),
        }

    def __str__(self) -> str:
        parts = [
            f"{lift:+g} mm: {100 * share:.1f} % ({iterations:.0f} iterations)"
            for lift, share, iterations in zip(self.lifts_mm, self.shares, self.iterations, strict=True)
        ]
        return f"{self.count} random starts that end at the same poses, lifted by up to " + ", ".join(parts)


def solve_from_lifts(
    problem: StaticEquilibrium, result: EquilibriumResult, count: int, lifts_mm: tuple[float, ...] = LIFTS_MM
) -> LiftedStarts:
    """Solve the rows in equilibrium again, in turn for every lift, from poses moved by up to the lift along ty, 4 mm
    along tx and 1 mm along tz, and 0.05 rad (rx) and 0.1 rad (ry). Poses that differ by what nothing holds alone are
    the same. Raises ValueError where no row is in equilibrium."""
    if not result.converged.any():
        raise ValueError("no row is in equilibrium, expected one at least, whose pose other starts may find again")
    problem, poses = problem.of_rows(result.converged), result.poses[result.converged]
    balance, rng = Balance.of(problem, problem.model), np.random.default_rng(7)
    shares, iterations = [], []
    for lift in lifts_mm:
        same, used = [], []
        for _ in range(count):
            moves = rng.uniform(-1.0, 1.0, poses.shape) * [4.0, 0.0, 1.0, 0.05, 0.1, 0.0]
            moves[:, 1] = lift * rng.uniform(0.0, 1.0, len(moves))
            again = solve(problem, poses + moves)
            near = same_poses(poses + balance.held_moves(poses, again.poses - poses), poses)
            same.append((near & again.converged).mean())
            used.append(again.iterations)
        shares.append(float(np.mean(same)))
        iterations.append(float(np.median(used)))
    return LiftedStarts(lifts_mm, count, np.array(shares), np.array(iterations))
