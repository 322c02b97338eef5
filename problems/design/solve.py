"""The solution of the design problem, from the scene's own dish in balance; and any dish evaluated on the EF."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array, pose_index
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.optimisation.starts import settle_in_range
from problems.design.problem import BALANCED, FREE, LAXITY_PUSHES, Design, variables

_TOLERANCE_N = 0.01


@dataclass(frozen=True)
class DishState:
    """A dish in balance: poses (n, 6), peak pressures of both sides in the frames of walking (frames, 2) [MPa], and
    travel (2,) [mm] of the laxity tests. reason tells where it has no equilibrium, and is empty where it has one
    everywhere; what such poses decide is NaN."""

    radii_mm: Array
    poses: Array
    peaks_mpa: Array
    laxity_mm: Array
    reason: str = ""

    @property
    def peak_mpa(self) -> float:
        """The largest pressure of the cycle."""
        return float(self.peaks_mpa.max())


@dataclass(frozen=True)
class DesignResult:
    """First and best dish, and what became of IPOPT. Where the first has no equilibrium, IPOPT does not start: its
    status is empty, and the best dish is the first."""

    first: DishState
    best: DishState
    solved: bool
    ipopt_status: str
    iterations: int
    seconds: float


def balanced(design: Design, radii_mm: Array, model: PolarFoundation | ElasticFoundation, start: Array) -> DishState:
    """A dish on a contact model of its own, poses settled from a start (n, 6). Loads without equilibrium are reported,
    not raised."""
    targets = dict(zip(BALANCED, design.wanted.T, strict=True))
    poses, report = settle(model, start, FREE, targets, tolerance=_TOLERANCE_N)
    peaks = model.summary(poses[: design.frames]).largest_mpa
    lost = ~report.converged
    poses[lost], peaks[lost[: design.frames]] = np.nan, np.nan
    row = int(np.argmax(lost))
    reason = f"{_pose_in_words(design, row)}: {report.reason[row]}" if lost.any() else ""
    return DishState(radii_mm, poses, peaks, travels(design, poses), reason)


def _pose_in_words(design: Design, row: int) -> str:
    if row < design.frames:
        return f"frame {row}"
    return f"laxity test {list(LAXITY_PUSHES)[(row - design.frames) // 2]}"


def travels(design: Design, poses: Array) -> Array:
    """Travel of each laxity test (2,) [mm]."""
    pairs = poses[design.frames :].reshape(len(LAXITY_PUSHES), 2, 6)
    columns = [pose_index(parameter) for parameter, _, _ in LAXITY_PUSHES.values()]
    return np.array([pair[0, column] - pair[1, column] for pair, column in zip(pairs, columns, strict=True)])


def first_state(design: Design) -> DishState:
    """The scene's own dish in balance."""
    scene = design.contact.scene
    model = PolarFoundation(scene, design.contact.rays)
    rest = design.locked + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]) * scene.start_pose
    sides = dict(zip(BALANCED[:2], design.wanted[:, :2].T, strict=True))
    return balanced(design, design.contact.radii_mm, model, settle_in_range(model, rest, rest, ("ty", "rx"), sides))


def solve(design: Design, *, max_iterations: int = 200, print_level: int = 0) -> DesignResult:
    """Solve with IPOPT. Never raises where it does not converge, or where the first dish has no equilibrium: it is
    reported."""
    first = first_state(design)
    if first.reason:
        return DesignResult(first, first, False, "", 0, 0.0)
    began = time.perf_counter()
    options = ipopt_options(
        tolerance=1e-6,
        max_iterations=max_iterations,
        print_level=print_level,
        hessian_approximation="limited-memory",
        limited_memory_max_history=30,
        mu_strategy="adaptive",
    )
    solver = ca.nlpsol("design", "ipopt", design.nlp, options)
    answer = solver(
        x0=variables(design, first.radii_mm, first.poses, first.peak_mpa),
        lbx=design.lower,
        ubx=design.upper,
        lbg=design.lower_g,
        ubg=design.upper_g,
    )
    outcome = IpoptOutcome.of(solver)
    radii, _, poses = (np.asarray(part) for part in design.unpack(answer["x"]))
    best = evaluated(design, radii[:, 0], poses.T)
    return DesignResult(first, best, outcome.solved, outcome.status, outcome.iterations, time.perf_counter() - began)


def evaluated(design: Design, radii_mm: Array, poses: Array) -> DishState:
    """Peaks and travels of a dish at given poses, as the problem has them."""
    contact, scene = design.contact, design.contact.scene
    values, _ = contact.evaluate(poses, radii_mm)
    depths = values[: design.frames, len(contact.load_names) :]
    model = PolarFoundation(scene, contact.rays, compiled=False)
    _, modulus, thickness = model.law
    return DishState(radii_mm, poses, modulus / thickness * depths, travels(design, poses))


def on_elements(design: Design, state: DishState) -> DishState:
    """The same dish on the scene's finest elements, settled there by itself (see `balanced`)."""
    scene = design.contact.with_radii(state.radii_mm)
    return balanced(design, state.radii_mm, ElasticFoundation(scene, scene.grids.get("teacher")), state.poses)
