"""Row 6: the largest stable fixed time step of a loaded knee simulator, against contact stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from rich.progress import track
from scipy.optimize import root

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.starts import KNEE_STEPS
from problems import knee_simulator
from problems.knee_simulator import KneeSimulator, constant, start_state
from problems.studies.stability.methods import PATCH, Bench
from problems.studies.stability.table import Line
from problems.studies.stable_step import LONGEST_STEP_S, SCHEMES, contact_stiffness, largest_stable_step

AXIAL_N = (50.0, 200.0, 800.0, 2000.0)
FLEXION_DEG = 20.0
EXPLICIT = ("explicit_euler", "rk4")
_IMPLICIT_STEPS = 50


def rest_of(simulator: KneeSimulator, near: Array) -> Array:
    """State (10,) at rest of a simulator on any contact model, from a state near it; ValueError where none is found."""
    q = ca.MX.sym("q", 5)
    acceleration = simulator.rate(ca.vertcat(q * ca.DM(KNEE_STEPS[:5]), ca.DM.zeros(5)), 0.0)[5:] / 1e6
    both = ca.Function("rest", [q], [acceleration, ca.jacobian(acceleration, q)])
    answer = root(
        lambda x: np.asarray(both(x)[0]).ravel(),
        near[:5] / KNEE_STEPS[:5],
        jac=lambda x: np.asarray(both(x)[1]),
        tol=1e-12,
    )
    if not np.abs(answer.fun).max() < 1e-4:
        raise ValueError(f"no rest found near the surrogate's: {' '.join(answer.message.split())}")
    return np.concatenate([answer.x * KNEE_STEPS[:5], np.zeros(5)])


def _milliseconds(step_s: float) -> str:
    return f"{'≥ ' if step_s >= LONGEST_STEP_S else ''}{1e3 * step_s:.3g}"


def measure(
    bench: Bench, axial_n: Sequence[float] = AXIAL_N, schemes: Sequence[str] = SCHEMES, explicit_steps: int = 200
) -> tuple[list[Line], dict[str, Any]]:
    """Lines of row 6, and for every method axial forces, stiffness [N/mm] and steps [s] by scheme."""
    lines: list[Line] = []
    curves: dict[str, dict[str, list[float]]] = {m: {key: [] for key in ("stiffness", *schemes)} for m in bench.models}
    for axial in axial_n:
        waveforms = constant(FLEXION_DEG, axial)
        near = start_state(knee_simulator.build(bench.models[PATCH], waveforms))
        cells: dict[str, dict[str, float | str]] = {key: {} for key in ("stiffness", *schemes)}
        no_rest: dict[str, str] = {}
        for method, model in track(bench.models.items(), f"steps at {axial:g} N", transient=True):
            simulator = knee_simulator.build(model, waveforms)
            try:
                rest = rest_of(simulator, near)
            except ValueError as error:
                no_rest[method] = str(error)
                continue
            stiffness = contact_stiffness(simulator, rest)
            cells["stiffness"][method] = stiffness
            curves[method]["stiffness"].append(stiffness)
            for scheme in schemes:
                steps = explicit_steps if scheme in EXPLICIT else _IMPLICIT_STEPS
                step_s = largest_stable_step(simulator, scheme, rest, steps=steps)
                cells[scheme][method] = _milliseconds(step_s)
                curves[method][scheme].append(step_s)
        for key, values in cells.items():
            quantity = "contact stiffness [N/mm]" if key == "stiffness" else f"{key.replace('_', ' ')} [ms]"
            lines.append(Line(6, f"{axial:g} N", quantity, values, {**bench.missing, **no_rest}))
    return lines, curves
