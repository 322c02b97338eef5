"""Muscle and contact forces of a knee together, over a whole walking cycle, from inverse dynamics.

Muscles pull the femur onto the tibia, contact pushes back, and both balance the knee's inverse-dynamics loads. For all
frames at once, activations a (13), free pose parameters q (ty and rx; tx and tz by choice) and reserve loads r:

    min Σ a^p + Σ (r/size)²        p = 2: least squared activation

    Σ_m arm_m·F_m(a_m) + contact(q) + r = inverse dynamics        for each balanced coordinate
    s_med(q), s_lat(q) >= 0,   least activation <= a <= 1,   q in the learned range

F is linear in a (`problems.muscle`). contact(q) is the surrogate's load on the femur, as a generalised load: F of
translations, Eᵀ(T - t×F) of rotations, about the moving origin (`angular_velocity_map`). s is the signed root load: a
side that carries nothing just touches, because nothing else says where it floats. tx and tz where they are not free
stand where equal forces on both sides cause no shear. ry and rz are prescribed. Measured contact forces enter nowhere.

Run ``python -m problems.muscle_contact --help``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import casadi as ca
import numpy as np
import typer

from casadi_contact.conventions import POSE_NAMES, Array
from casadi_contact.files import writable_folder
from casadi_contact.motion.load_cycle import read_cycle
from casadi_contact.motion.opensim import ColumnMap
from casadi_contact.structures import load_surrogate
from problems.command import run_command
from problems.knee_coordinates import CONTACT_LOADS, COORDINATES, contact_on_femur, in_newtons
from problems.muscle_example import example_walk
from problems.muscle_problem import BALANCED, FREE, RESERVE_SIZES, MuscleContact, build
from problems.muscle_walk import ROTATION_MAPS, read_walk

TOLERANCE_N = 0.1  # of a balanced coordinate, moments over LEVER_MM


@dataclass(frozen=True)
class MuscleContactResult:
    """Activations and forces along the tendons (n, m), poses (n, 6), surrogate loads there (n, 7) as in
    `CONTACT_LOADS`, reserves and what is left of each balance [N, N·m] by coordinate, and what became of the frames."""

    activations: Array
    muscle_forces_n: Array
    poses: Array
    loads: Array
    reserves: Mapping[str, Array]
    unbalanced: Mapping[str, Array]
    converged: np.ndarray
    reason: np.ndarray
    ipopt_status: str
    iterations: int
    seconds: float

    @property
    def overloaded(self) -> np.ndarray:
        """True (n,) where a reserve gives more than its size: muscles and contact alone do not balance the frame."""
        shares = [np.abs(curve) / RESERVE_SIZES[name] for name, curve in self.reserves.items()]
        return np.asarray(np.max(shares, axis=0) > 1.0)


def solve(problem: MuscleContact, max_iterations: int = 500, print_level: int = 0) -> MuscleContactResult:
    """Solve with IPOPT and its exact Hessian. Never raises for frames that do not converge: each is reported."""
    walk, began = problem.walk, time.perf_counter()
    options: dict[str, Any] = {
        "ipopt": {
            "print_level": print_level,
            "sb": "yes",
            "max_iter": max_iterations,
            "tol": 1e-7,
            "hessian_approximation": "exact",
        },
        "print_time": False,
    }
    solver = ca.nlpsol("muscle_contact", "ipopt", problem.nlp, options)
    answer = solver(x0=problem.start, lbx=problem.lower, ubx=problem.upper, lbg=problem.lower_g, ubg=problem.upper_g)
    stats = solver.stats()
    seconds = time.perf_counter() - began
    variables = np.asarray(answer["x"]).reshape(len(walk), -1) * problem.scales
    count, free = len(walk.muscles.names), len(problem.free)
    activations, moved, reserves = np.split(variables, [count, count + free], axis=1)
    poses = problem.neutral_poses.copy()
    poses[:, [POSE_NAMES.index(name) for name in problem.free]] = moved
    return _judged(problem, activations, poses, reserves, stats, seconds)


def _judged(
    problem: MuscleContact, activations: Array, poses: Array, reserves: Array, stats: dict[str, Any], seconds: float
) -> MuscleContactResult:
    """What is left of each balance, evaluated anew from the surrogate's NumPy side, and whether frames hold."""
    walk, capacity = problem.walk, problem.capacity
    forces = capacity.active_n * activations + capacity.passive_n
    loads = problem.surrogate(poses, CONTACT_LOADS)
    contact = contact_on_femur(poses, loads)
    named = {name: reserves[:, column] for column, name in enumerate(problem.balanced)}
    left = {
        name: (walk.arms[name] * forces).sum(axis=1) + contact[name] + named[name] - walk.loads[name]
        for name in problem.balanced
    }
    worst = np.abs(np.column_stack([in_newtons(name) * left[name] for name in problem.balanced])).max(axis=1)
    status = str(stats["return_status"])
    solved = status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    converged = (worst <= TOLERANCE_N) & solved
    reason = np.full(len(walk), "", dtype=object)
    for k in np.flatnonzero(~converged):
        reason[k] = f"balance is off by {worst[k]:.3g} N" if solved else f"IPOPT stopped: {status}"
    iterations = int(stats["iter_count"])
    return MuscleContactResult(
        activations, forces, poses, loads, named, left, converged, reason, status, iterations, seconds
    )


__all__ = ["MuscleContact", "MuscleContactResult", "build", "main", "solve"]

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def run(
    inverse_dynamics: Annotated[Path | None, typer.Option(help="CSV or .sto; the built-in walk if left out")] = None,
    muscles: Annotated[Path | None, typer.Option(help="CSV, or folder of a MuscleAnalysis: lengths and arms")] = None,
    parameters: Annotated[Path | None, typer.Option(help="CSV of the muscles' parameters")] = None,
    rotations: Annotated[Path | None, typer.Option(help="CSV or .sto with flexion_rz_rad and rotation_ry_rad")] = None,
    maps: Annotated[
        list[str] | None, typer.Option("--map", help="other columns of it, such as knee_angle_r=-rz:deg")
    ] = None,
    measured: Annotated[Path | None, typer.Option(help="cycle (CSV) to compare with; never used to solve")] = None,
    surrogate: Annotated[str, typer.Option(help="a ready surrogate or the path of a .h5 file")] = "knee",
    out: Annotated[Path, typer.Option(help="folder for muscle_contact.csv, .sto, .png, summary.json")] = Path(
        "results"
    ),
    model: Annotated[str, typer.Option(help="hill or isometric")] = "hill",
    fit_lengths: Annotated[bool, typer.Option(help="scale fibres and tendons to the person's lengths")] = True,
    exponent: Annotated[float, typer.Option(help="of the activations in the cost")] = 2.0,
    least_activation: Annotated[float, typer.Option(help="no muscle is ever less active")] = 0.01,
    all_six: Annotated[
        bool, typer.Option(help="balance all six coordinates, with reserves; tx and tz are free")
    ] = False,
) -> None:
    """Find the muscle activations and contact forces of a walking cycle that balance its inverse dynamics."""
    from problems.muscle_contact_report import report  # draws with matplotlib: not needed to solve

    writable_folder(out)
    files = {"inverse-dynamics": inverse_dynamics, "muscles": muscles, "parameters": parameters, "rotations": rotations}
    missing = [f"--{name}" for name, path in files.items() if path is None]
    if inverse_dynamics and muscles and parameters and rotations:
        columns = [ColumnMap.parse(text) for text in maps or ()] or ROTATION_MAPS
        walk = read_walk(rotations, inverse_dynamics, muscles, parameters, columns)
    elif len(missing) == len(files):
        walk = example_walk()
    else:
        raise ValueError(f"{', '.join(missing)} not given, expected all four files, or none for the built-in walk")
    comparison = None if measured is None else read_cycle(measured)
    problem = build(
        load_surrogate(surrogate),
        walk,
        model=model,
        fit_lengths=fit_lengths,
        balanced=tuple(COORDINATES) if all_six else BALANCED,
        free=("tx", "ty", "tz", "rx") if all_six else FREE,
        exponent=exponent,
        least_activation=least_activation,
    )
    result = solve(problem)
    report(problem, result, out, comparison)
    if not result.converged.all():
        frames = ", ".join(map(str, np.flatnonzero(~result.converged)))
        print(f"muscle_contact: not converged at frames {frames}; reasons in {out}", file=sys.stderr)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1; unsolved frames are exit status 2."""
    run_command(app, "muscle_contact")


if __name__ == "__main__":
    main()
