"""How often random starts lead an assembly's bodies to the same loads in every frame."""

from __future__ import annotations

from concurrent.futures import as_completed

import numpy as np
from rich.progress import track

from casadi_contact.core.conventions import Array, pose_index
from casadi_contact.core.workers import worker_pool
from casadi_contact.optimisation.assembly.file import load_assembly
from problems.assembly_poses.cycle import AssemblyCycle
from problems.assembly_poses.problem import AssemblyPoses, build
from problems.assembly_poses.solve import AssemblyResult, solve
from problems.patella.follow import ASIDE_MM, ASIDE_RAD, SAME_N, loads_apart_n
from problems.pose_estimation.starts import RandomStarts, StartOutcome, moved


def random_start(problem: AssemblyPoses, poses: Array, rng: np.random.Generator) -> Array:
    """Poses (n, bodies, 6) moved at random, each frame alone: the measured body as in pose estimation (`moved`), all
    others along their free pose parameters by up to `ASIDE_MM` and `ASIDE_RAD`."""
    start, bodies = poses.copy(), problem.assembly.bodies
    if problem.measured:
        body = bodies.index(problem.measured_body)
        start[:, body] = moved(problem.measured, poses[:, body], rng)
    for moving, names in problem.free.items():
        for name in names:
            aside = ASIDE_RAD if name.startswith("r") else ASIDE_MM
            start[:, bodies.index(moving), pose_index(name)] += rng.uniform(-aside, aside, len(poses))
    return start


def one_start(name: str, cycle: AssemblyCycle, poses: Array, loads: Array, seed: tuple[int, int]) -> StartOutcome:
    """Solve from one random start about a solution, which it reaches where frames have the same loads."""
    problem = build(load_assembly(name), cycle)
    result = solve(problem, random_start(problem, poses, np.random.default_rng(seed)))
    same = loads_apart_n(problem.assembly, result.loads, loads) < SAME_N
    loaded = loaded_frames(problem)
    return StartOutcome.of(result.converged[loaded], same[loaded], result.iterations)


def loaded_frames(problem: AssemblyPoses) -> np.ndarray:
    """True (n,) where the measured contact carries load: in other frames nothing tells its body's pose. Without a
    measured contact, or any load in it, everywhere."""
    everywhere = np.ones(len(problem.cycle), dtype=bool)
    loaded = everywhere if problem.measured is None else problem.measured.wanted.loaded
    return loaded if loaded.any() else everywhere


def solve_from_random_starts(
    name: str, cycle: AssemblyCycle, reference: AssemblyResult, count: int = 100, seed: int = 1
) -> RandomStarts:
    """Solve a cycle of an assembly (name or file) from `count` random starts about a solution, on all cores."""
    with worker_pool() as pool:
        jobs = [pool.submit(one_start, name, cycle, reference.poses, reference.loads, (seed, k)) for k in range(count)]
        for job in track(as_completed(jobs), "random starts", total=count):
            job.result()
    return RandomStarts(tuple(job.result() for job in jobs))
