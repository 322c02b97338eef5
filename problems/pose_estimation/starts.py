"""Where pose estimation may start: poses from a file, and how often random starts reach the same solution."""

from __future__ import annotations

from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.progress import track

from casadi_contact.conventions import POSE_IN_MM, POSE_NAMES, Array
from casadi_contact.motion.load_cycle import LoadCycle
from casadi_contact.motion.pose_file import read_poses
from casadi_contact.structures import load_surrogate
from casadi_contact.workers import worker_pool
from problems.pose_estimation.problem import build
from problems.pose_estimation.solve import solve

SAME_MM = 0.01  # rotations over 25 mm


@dataclass(frozen=True)
class RandomStarts:
    """Of each random start: share of its frames that converge to the reference solution, and IPOPT iterations."""

    frames_reached: Array
    iterations: np.ndarray

    @property
    def reached(self) -> np.ndarray:
        """True (starts,) where every frame converges to the reference solution."""
        return self.frames_reached == 1.0

    def __str__(self) -> str:
        return (
            f"{int(self.reached.sum())} of {len(self.reached)} random starts reach the same solution in every frame "
            f"({100.0 * self.frames_reached.mean():.1f} % of all frames), "
            f"median {np.median(self.iterations):.0f} IPOPT iterations"
        )


def start_from_file(path: Path, count: int) -> Array:
    """The poses of a file (`read_poses`) spread over `count` frames, first on first and last on last: (count, 6)."""
    poses = read_poses(path)
    at = np.linspace(0.0, len(poses) - 1.0, count)
    return np.stack([np.interp(at, np.arange(len(poses)), column) for column in poses.T], axis=1)


def one_start(surrogate: str, cycle: LoadCycle, reference: Array, seed: tuple[int, int]) -> tuple[float, int]:
    """Solve from one random start about the reference poses (n, 6): each side of every frame up to 3 mm lifted or
    1 mm too deep, independently, tx and tz off by up to 4 mm; one try. Returns the share of frames reached, and
    iterations."""
    problem = build(load_surrogate(surrogate), cycle)
    rng = np.random.default_rng(seed)
    count = len(cycle)
    start = reference.copy()
    med_mm, lat_mm = rng.uniform(-1.0, 3.0, (2, count))  # lift of either side
    apart_mm = np.ptp(problem.surrogate.scene.anchors_mm[:, 2])
    start[:, POSE_NAMES.index("tx")] += rng.uniform(-4.0, 4.0, count)
    start[:, POSE_NAMES.index("tz")] += rng.uniform(-4.0, 4.0, count)
    start[:, POSE_NAMES.index("ty")] += 0.5 * (med_mm + lat_mm)
    start[:, POSE_NAMES.index("rx")] -= (med_mm - lat_mm) / apart_mm
    result = solve(problem, start, alone=False)
    same = np.abs((result.poses - reference) * POSE_IN_MM).max(axis=1) < SAME_MM
    return float((result.converged & same).mean()), result.iterations


def solve_from_random_starts(
    surrogate: str, cycle: LoadCycle, reference: Array, count: int = 200, seed: int = 1
) -> RandomStarts:
    """Solve a cycle from `count` random starts on all cores; reference: the solution's poses (n, 6)."""
    with worker_pool() as pool:
        jobs = [pool.submit(one_start, surrogate, cycle, reference, (seed, k)) for k in range(count)]
        for job in track(as_completed(jobs), "random starts", total=count):
            job.result()
    outcomes = [job.result() for job in jobs]
    return RandomStarts(np.array([o[0] for o in outcomes]), np.array([o[1] for o in outcomes]))
