"""Where pose estimation may start: poses from a file, and how often random starts reach the same solution."""

from __future__ import annotations

from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from casadi_contact.core.conventions import Array, pose_index
from casadi_contact.core.workers import worker_pool
from casadi_contact.scenes.pose_file import read_poses
from problems.common.contact import ContactSource
from problems.common.same_poses import same_poses
from problems.pose_estimation.completion import solve_and_complete
from problems.pose_estimation.problem import Cycle, PoseEstimation, build

LIFTS_MM = (-1.0, 3.0)  # of each patch: too deep, and out of contact
ASIDE_MM, ASIDE_RAD = 4.0, 0.1  # along and about whatever does not press
_SEED = 1


@dataclass(frozen=True)
class StartOutcome:
    """Of one random start: shares of its frames under load that are solved, and by the reference solution; IPOPT
    iterations."""

    solved: float
    reached: float
    iterations: int

    @classmethod
    def of(cls, solved: np.ndarray, same: np.ndarray, iterations: int) -> StartOutcome:
        """Of frames (n,), one at least, that are solved, and that end as the reference does."""
        return cls(float(solved.mean()), float((solved & same).mean()), iterations)


@dataclass(frozen=True)
class RandomStarts:
    """What became of each of several random starts. Where contact carries the wanted loads in several poses, all frames
    may be solved and some of them by another solution."""

    outcomes: tuple[StartOutcome, ...]

    @property
    def solved(self) -> int:
        """Number of starts from which every frame is solved."""
        return sum(outcome.solved == 1.0 for outcome in self.outcomes)

    @property
    def reached(self) -> int:
        """Number of starts from which every frame is solved by the reference solution."""
        return sum(outcome.reached == 1.0 for outcome in self.outcomes)

    def record(self) -> dict[str, Any]:
        """Plain values for a summary."""
        return {
            "count": len(self.outcomes),
            "solved": self.solved,
            "reached": self.reached,
            "share_of_frames": float(np.mean([outcome.reached for outcome in self.outcomes])),
            "median_iterations": float(np.median([outcome.iterations for outcome in self.outcomes])),
        }

    def __str__(self) -> str:
        of = self.record()
        return (
            f"{self.solved} of {len(self.outcomes)} random starts solve every frame, {self.reached} of them by the "
            f"same solution ({of['share_of_frames']:.1%} of all frames), "
            f"median {of['median_iterations']:.0f} IPOPT iterations"
        )


def start_from_file(path: Path, count: int) -> Array:
    """The poses of a file (`read_poses`) spread over `count` frames, first on first and last on last: (count, 6)."""
    poses = read_poses(path)
    at = np.linspace(0.0, len(poses) - 1.0, count)
    return np.stack([np.interp(at, np.arange(len(poses)), column) for column in poses.T], axis=1)


def moved(problem: PoseEstimation, poses: Array, rng: np.random.Generator) -> Array:
    """Poses (n, 6) moved at random, each frame alone: each patch lifted by `LIFTS_MM` along what presses it (along the
    wanted parts of its force, where it has no direction), as nearly as the sensitive pose parameters can; all other
    free ones by up to `ASIDE_MM` and `ASIDE_RAD`."""
    scene, count = problem.model.scene, len(poses)
    start = poses.copy()
    sensitive = [name for name in scene.sensitive_pose if name in problem.free]
    lifts = rng.uniform(*LIFTS_MM, (len(scene.normal_loads), count))
    for name in problem.free:
        if name not in sensitive:
            aside = ASIDE_RAD if name.startswith("r") else ASIDE_MM
            start[:, pose_index(name)] += rng.uniform(-aside, aside, count)
    rows = np.empty((count, len(scene.normal_loads), len(sensitive)))
    for p, (normal, anchor) in enumerate(zip(scene.normal_loads, scene.anchors_mm, strict=True)):
        if normal.direction is None:
            force = np.column_stack([problem.wanted.values.get(name, np.zeros(count)) for name in normal.loads])
            along = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
        else:
            along = np.tile(normal.direction, (count, 1))
        for column, name in enumerate(sensitive):
            axis = np.eye(3)["xyz".index(name[1])]
            rows[:, p, column] = -along @ (np.cross(axis, anchor) if name.startswith("r") else axis)
    moves = np.einsum("nsp,pn->ns", np.linalg.pinv(rows), lifts)
    for column, name in enumerate(sensitive):
        start[:, pose_index(name)] += moves[:, column]
    return start


def one_start(
    source: ContactSource,
    cycle: Cycle,
    reference: Array,
    smoothness: float,
    compiled: bool | None,
    number: int,
) -> StartOutcome:
    """Solve from one random start, by its number, about the reference poses (n, 6) (`moved`), without any other contact
    model; smoothness, compiled: as of `build`."""
    problem = build(source.load(), cycle, smoothness, compiled=compiled)
    start = moved(problem, reference, np.random.default_rng([_SEED, number]))
    result = solve_and_complete(problem, start, "the model alone")
    loaded = problem.wanted.loaded if problem.wanted.loaded.any() else np.ones(problem.frames, dtype=bool)
    return StartOutcome.of(result.converged[loaded], same_poses(result.poses, reference)[loaded], result.iterations)


def solve_from_random_starts(
    source: ContactSource, problem: PoseEstimation, reference: Array, count: int
) -> RandomStarts:
    """Solve a problem, on the model of a source, from `count` random starts on all cores; reference: the solution's
    poses (n, 6).

    Starts are about the poses that the contact alone finds from there: frames of the solution may stand on another
    contact model.
    """
    reference = solve_and_complete(problem, reference, "the model alone").poses
    solve_one = partial(one_start, source, problem.cycle, reference, problem.smoothness, problem.compiled)
    with worker_pool() as pool:
        jobs = [pool.submit(solve_one, number) for number in range(count)]
        for job in track(as_completed(jobs), "random starts", total=count):
            job.result()
    return RandomStarts(tuple(job.result() for job in jobs))
