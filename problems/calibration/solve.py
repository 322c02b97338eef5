"""The solution of calibration, from any parameters that still bring the bodies together."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.contact.parameters import PLACEMENT
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.optimisation.starts import settle_in_range
from problems.calibration.measurement import in_fixed_body, in_scene_frame
from problems.calibration.problem import Calibration
from problems.calibration.uncertainty import Uncertainty, degrees_of_freedom, largest_misfit, uncertainty

FACTOR, SHIFT_MM, TURN_RAD = 2.0, 1.5, np.radians(3.0)  # random starts: material over or times, placement plus or minus


@dataclass(frozen=True)
class CalibrationResult:
    """values (m,) of the parameters; poses (n, 6) as corrected; misfit: the sum of squares over its degrees of freedom,
    about 1 where the deviations stated for the measurement are right, and by chance hardly above largest_misfit;
    shares (n,) of the frames in that sum; load_error (n, L) [N, N·mm] at the solution."""

    values: Array
    uncertainty: Uncertainty
    poses: Array
    load_error: Array
    shares: Array
    misfit: float
    largest_misfit: float
    ipopt_status: str
    solved: bool
    iterations: int
    seconds: float

    @property
    def explained(self) -> bool:
        """Whether the foundation with these parameters explains the data, but for the stated deviations."""
        return self.misfit <= self.largest_misfit

    @property
    def place(self) -> Array:
        """Where the fixed body lies in the scene's frame (6,)."""
        by_name = dict(zip(self.uncertainty.parameters, self.values, strict=True))
        return np.array([by_name.get(name, 0.0) for name in PLACEMENT])


def start_values(problem: Calibration, start: Mapping[str, float] | None = None) -> Array:
    """x at parameters by name, the scene's where left out. Poses are settled there under the measured normal loads
    along the scene's sensitive pose, since bodies that a wrong placement leaves apart give no slope."""
    scene, measured = problem.model.scene, problem.measured
    begin = dict(zip(problem.parameters, problem.reference, strict=True)) | dict(start or {})
    unknown = set(begin) - set(problem.parameters)
    if unknown:
        raise ValueError(f"start holds {', '.join(sorted(unknown))}, expected {', '.join(problem.parameters)}")
    place = np.array([begin.get(name, 0.0) for name in PLACEMENT])
    targets: dict[str, Array] = {}
    for normal in scene.normal_loads:
        forces = measured.loads[:, [measured.load_names.index(name) for name in normal.loads]]
        pressed = normal.at_least(forces, scene.boundary_load)  # noise may make a small load pull
        targets |= dict(zip(normal.loads, pressed.T, strict=True))
    relative = in_fixed_body(measured.poses, place)
    relative = settle_in_range(problem.model, relative, relative, POSE_NAMES, targets)
    delta = (in_scene_frame(relative, place) - measured.poses) / measured.pose_deviation
    x = np.concatenate([problem.variables(np.array([begin[n] for n in problem.parameters])), delta.ravel()])
    return np.clip(x, problem.lower, problem.upper)


def random_starts(problem: Calibration, count: int) -> list[dict[str, float]]:
    """Parameters by name, spread about those of the scene by `FACTOR`, `SHIFT_MM` and `TURN_RAD`."""
    draw = np.random.default_rng(3)
    found = []
    for _ in range(count):
        share = dict(zip(problem.parameters, draw.uniform(-1.0, 1.0, len(problem.parameters)), strict=True))
        found.append(
            {
                name: (SHIFT_MM if name.startswith("fixed_t") else TURN_RAD) * part
                if name in PLACEMENT
                else reference * FACTOR**part
                for (name, part), reference in zip(share.items(), problem.reference, strict=True)
            }
        )
    return found


def solve(
    problem: Calibration,
    start: Mapping[str, float] | None = None,
    *,
    max_iterations: int = 200,
    print_level: int = 0,
) -> CalibrationResult:
    """Estimate with IPOPT. Never raises where it does not converge: it is reported."""
    began = time.perf_counter()
    options = ipopt_options(tolerance=1e-8, max_iterations=max_iterations, print_level=print_level, mu_init=1e-6)
    solver = ca.nlpsol("calibration", "ipopt", problem.nlp, {**options, "hess_lag": problem.hessian})
    answer = solver(x0=start_values(problem, start), lbx=problem.lower, ubx=problem.upper)
    outcome = IpoptOutcome.of(solver)
    seconds = time.perf_counter() - began
    measured, count = problem.measured, len(problem.parameters)
    x = np.asarray(answer["x"])[:, 0]
    z, delta = x[:count], x[count:].reshape(-1, 6)
    frames = len(delta)
    every = problem.residuals.map(frames)
    off = np.asarray(every(ca.repmat(ca.DM(z), 1, frames), delta.T, measured.poses.T, measured.loads.T)).T
    squares = np.sum(off**2, axis=1) + np.sum(delta**2, axis=1)
    misfit, largest = 2.0 * float(answer["f"]) / degrees_of_freedom(problem), largest_misfit(problem)
    return CalibrationResult(
        values=problem.values(z),
        uncertainty=uncertainty(problem, z, delta, np.sqrt(misfit) if misfit > largest else 1.0),
        poses=measured.poses + measured.pose_deviation * delta,
        load_error=off * measured.load_deviation,
        shares=squares / max(squares.sum(), np.finfo(float).tiny),
        misfit=misfit,
        largest_misfit=largest,
        ipopt_status=outcome.status,
        solved=outcome.solved,
        iterations=outcome.iterations,
        seconds=seconds,
    )
