"""Row 4: gradients by differences against the step, and against exact ones: the noise floor of each method.

Errors are relative, in comparable units: ‖S_L·(J - J*)·S_q‖/‖S_L·J*·S_q‖ (Frobenius), torques over 25 mm, rotations
times 25 mm, and steps of rotations are those of translations over 25 mm. RMS over poses.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import LEVER_MM, POSE_IN_MM, Array
from casadi_contact.core.quantities import newton_scales
from problems.studies.stability.differences import by_differences
from problems.studies.stability.methods import EF_ANALYTIC, EF_COARSE, EF_FINE, Bench
from problems.studies.stability.table import Line

STEPS_MM = 10.0 ** np.arange(-11.0, 0.5, 0.5)
SHOWN_MM = (1e-9, 1e-7, 1e-5, 1e-3, 1e-1)


def relative_error(jacobian: Array, true: Array, load_names: tuple[str, ...]) -> float:
    """RMS over poses of the relative error of Jacobians (n, L, 6), in comparable units."""
    scale = 1.0 / newton_scales(load_names, LEVER_MM)[:, None] / POSE_IN_MM
    off = np.linalg.norm((jacobian - true) * scale, axis=(1, 2)) / np.linalg.norm(true * scale, axis=(1, 2))
    return float(np.sqrt(np.mean(off**2)))


def measure(bench: Bench, count: int = 20, steps_mm: Array = STEPS_MM) -> tuple[list[Line], dict[str, Any]]:
    """Lines of row 4; steps_mm (steps,), and the errors (steps,) of central differences by method."""
    poses = bench.poses[np.linspace(0, len(bench.poses) - 1, count).astype(int)]
    true = bench.teacher.jacobian(poses)[1]
    exact = dict(bench.models)  # but the grids themselves where a method takes differences of a grid
    for method, grid in ((EF_COARSE, "coarse"), (EF_FINE, "fine")):
        if method in exact:
            exact[method] = ElasticFoundation(bench.scene, bench.scene.grids[grid])
    curves: dict[tuple[str, bool], Array] = {}
    off_truth: dict[str, float | str] = {}
    for method, model in exact.items():
        own = model.jacobian(poses)[1]
        used = bench.models[method].jacobian(poses)[1]
        off_truth[method] = relative_error(used, true, model.load_names)
        if method != EF_ANALYTIC:
            for central in (True, False):
                errors = [
                    relative_error(by_differences(model, poses, step, central=central), own, model.load_names)
                    for step in steps_mm
                ]
                curves[method, central] = np.array(errors)
    why = {**bench.missing, EF_ANALYTIC: "takes no step: it is what EF differences are compared with"}
    lines = []
    for central, label in ((True, "central"), (False, "one-sided")):
        chosen = {m: curve for (m, c), curve in curves.items() if c == central}
        for step in SHOWN_MM:
            place = int(np.argmin(np.abs(np.log(steps_mm / step))))
            cells: dict[str, float | str] = {m: float(curve[place]) for m, curve in chosen.items()}
            lines.append(Line(4, f"{label}, step {step:g} mm", "relative error", cells, why))
        best: dict[str, float | str] = {
            m: f"{curve.min():.1e} at {steps_mm[curve.argmin()]:.0e}" for m, curve in chosen.items()
        }
        lines.append(Line(4, f"{label}, best step [mm]", "relative error", best, why))
    case = f"as used, against the {bench.teacher.label}"
    lines.append(Line(4, case, "relative error", off_truth, bench.missing))
    errors_of = {method: curve.tolist() for (method, central), curve in curves.items() if central}
    return lines, {"steps_mm": list(steps_mm), "errors": errors_of}
