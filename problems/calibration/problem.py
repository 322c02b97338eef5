"""Calibration: material and placement of the fixed body from measured poses and loads.

Both are measured with errors, so the true poses q are unknown too (errors in variables). With parameters p of the
foundation, measured poses q̂ and loads F̂ and their standard deviations σ,

    min  ½ Σ_k |(F(q_k, p) - F̂_k)/σ_F|² + ½ Σ_k |(q_k - q̂_k)/σ_q|²        over p and all q_k

is the maximum likelihood estimate for normal errors, all frames in one IPOPT problem with the Gauss-Newton Hessian JᵀJ,
which reaches it in fewer iterations, and from farther off, than the exact one. Its variables are alike:
q_k = q̂_k + σ_q·δ_k, a material parameter is its scene value times e^z, a placement z mm or z/25 rad.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.parameters import PLACEMENT, check_parameters
from casadi_contact.core.conventions import POSE_IN_MM, Array
from casadi_contact.core.quantities import three_digits
from problems.calibration.measurement import Measurement

DEFAULT = ("youngs_modulus", "fixed_tx", "fixed_ty", "fixed_tz", "fixed_rx", "fixed_ry")
LARGEST_FACTOR = np.log(100.0)  # of a material parameter, over or times the scene's
_LARGEST_POISSONS_RATIO = 0.499


@dataclass(frozen=True)
class Calibration:
    """A problem that can be looked at unsolved.

    reference (m,): parameters at z = 0, those of the scene; residuals: (z, δ of a frame (6), its measured pose and
    loads) -> (F - F̂)/σ_F (L). x of the nlp holds z, then every δ; hessian is nlpsol's ``hess_lag``.
    """

    model: CompiledFoundation
    measured: Measurement
    parameters: tuple[str, ...]
    reference: Array
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    residuals: ca.Function
    hessian: ca.Function

    @property
    def placing(self) -> np.ndarray:
        """True (m,) for parameters that place the fixed body; the others are of its material."""
        return np.array([name in PLACEMENT for name in self.parameters])

    @property
    def units(self) -> Array:
        """Size of z = 1 (m,): mm, rad, and for a material parameter its own relative change."""
        return np.array([1.0 / POSE_IN_MM[PLACEMENT.index(n)] if n in PLACEMENT else 1.0 for n in self.parameters])

    def values(self, z: Array) -> Array:
        """Parameters (m,) [MPa, mm, rad] at z (m,)."""
        return np.where(self.placing, self.units * z, self.reference * np.exp(np.where(self.placing, 0.0, z)))

    def variables(self, values: Array) -> Array:
        """z (m,) at parameters (m,)."""
        of_material = np.log(np.where(self.placing, 1.0, values) / np.where(self.placing, 1.0, self.reference))
        return np.where(self.placing, values / self.units, of_material)


def build(model: CompiledFoundation, measured: Measurement, parameters: Iterable[str] = DEFAULT) -> Calibration:
    """Pose the problem. Raises ValueError for parameters that are none of the foundation's (see its `function`), for
    fewer measured loads than parameters, for normal loads that are not measured or have the wrong sign, and for a scene
    that locks or ties pose parameters: all six are measured."""
    model.scene.pose_space.check_whole("calibration")
    _check_named(model, measured)
    names = check_parameters(parameters, model.scene.material)
    if measured.loads.size < len(names) or not names:
        raise ValueError(f"{measured.loads.size} measured loads, {len(names)} parameters: expected as many at least")
    _check_pressed(model, measured)
    reference = np.array([getattr(model.scene.material, name, 0.0) for name in names])
    z, delta = ca.MX.sym("z", len(names)), ca.MX.sym("delta", 6, len(measured.poses))
    one, pose, load = ca.MX.sym("one", 6), ca.MX.sym("pose", 6), ca.MX.sym("load", len(measured.load_names))
    values = ca.vertcat(
        *(
            z[i] / POSE_IN_MM[PLACEMENT.index(name)] if name in PLACEMENT else reference[i] * ca.exp(z[i])
            for i, name in enumerate(names)
        )
    )
    loads = model.function(measured.load_names, parameters=names)(pose + ca.DM(measured.pose_deviation) * one, values)
    off = (loads - load) / ca.DM(measured.load_deviation)
    residuals = ca.Function("residuals", [z, one, pose, load], [off])
    count = len(measured.poses)
    every = residuals.map(count)(ca.repmat(z, 1, count), delta, ca.DM(measured.poses.T), ca.DM(measured.loads.T))
    x = ca.vertcat(z, ca.vec(delta))
    largest = np.full(x.numel(), np.inf)
    largest[: len(names)] = [np.inf if name in PLACEMENT else LARGEST_FACTOR for name in names]
    upper = largest.copy()
    if "poissons_ratio" in names:
        at = names.index("poissons_ratio")
        upper[at] = np.log(_LARGEST_POISSONS_RATIO / reference[at])
    nlp = {"x": x, "f": 0.5 * (ca.sumsqr(every) + ca.sumsqr(delta))}
    return Calibration(
        model, measured, names, reference, nlp, -largest, upper, residuals, _gauss_newton(x, every, delta, len(names))
    )


def _check_named(model: CompiledFoundation, measured: Measurement) -> None:
    """ValueError for a measurement without the loads that poses are settled under, as one of totals alone."""
    scene = model.scene
    missing = [name for name in scene.sensitive_loads if name not in measured.load_names]
    if missing:
        raise ValueError(
            f"the measured loads are {', '.join(measured.load_names)}, expected the normal loads of scene {scene.name} "
            f"among them: have {', '.join(missing)} in its [loads] names and in the measurement"
        )


def _check_pressed(model: CompiledFoundation, measured: Measurement) -> None:
    """ValueError for normal loads that pull on average."""
    for normal in model.scene.normal_loads:
        forces = measured.loads[:, [measured.load_names.index(name) for name in normal.loads]]
        if normal.direction is not None and (mean := float(forces.mean())) * normal.sign < -measured.force_n:
            raise ValueError(
                f"{normal.loads[0]} is {three_digits(mean)} N on average, but compression is "
                f"{'positive' if normal.sign > 0.0 else 'negative'} (the loads act on the fixed body): turn its sign"
            )


def _gauss_newton(x: ca.MX, every: ca.MX, delta: ca.MX, parameters: int) -> ca.Function:
    """JᵀJ of all residuals, as nlpsol's ``hess_lag`` gives it: (x, p, multipliers) -> upper triangle.

    1 on the diagonal of z keeps steps short along directions that the data leave open; it moves no solution.
    """
    J = ca.jacobian(ca.vertcat(ca.vec(every), ca.vec(delta)), x)
    of_cost = ca.MX.sym("lam_f")
    damping = ca.diag(ca.vertcat(ca.DM.ones(parameters), ca.DM(x.numel() - parameters, 1)))
    triangle = ca.triu(of_cost * (ca.mtimes(J.T, J) + damping))
    names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
    return ca.Function("gauss_newton", [x, ca.MX(0, 1), of_cost, ca.MX(0, 1)], [triangle], *names)
