"""Calibration of a foundation: material and placement of the fixed body from measured poses and loads.

    unknowns    parameters p (Young's modulus, placement, ...) and the true pose q_k of every frame
    minimise    ½ Σ_k |(F(q_k, p) - F̂_k)/σ_F|² + ½ Σ_k |(q_k - q̂_k)/σ_q|²

with measured poses q̂ and loads F̂ of standard deviation σ: the maximum likelihood estimate for normal errors in both
(errors in variables). One IPOPT problem with the Gauss-Newton Hessian JᵀJ. Variables: q_k = q̂_k + σ_q·δ_k; a material
parameter is the scene's times e^z, a placement z mm or z/25 rad.

Uncertainty. With A_k, B_k the derivatives of a frame's weighted residuals by z and by δ_k, the Gauss-Newton Hessian has
the Schur complement

    H = Σ_k A_kᵀ (I + B_k B_kᵀ)⁻¹ A_k

whose inverse is the covariance of z. An eigenvalue below 1 is a direction that the data do not determine. The sum of
squares over its degrees of freedom is about 1 where model and stated deviations are right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.symbolic import PLACEMENT, SymbolicContact, check_parameters
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, Array
from casadi_contact.core.quantities import quantity
from casadi_contact.core.terminal import run_program
from casadi_contact.networks.frames import placed, pose_of, relative_pose
from casadi_contact.optimisation.ipopt import least_squares_options
from casadi_contact.optimisation.knee import SIDES, check_knee
from casadi_contact.optimisation.starts import settle_in_range
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.scenes.columns import read_columns, write_columns
from casadi_contact.scenes.walking import reference_cycle

TRUTH = {  # of the made-up measurement
    **{"youngs_modulus": 600.0, "poissons_ratio": 0.44, "thickness": 7.0},
    **{"fixed_tx": 0.8, "fixed_ty": -0.5, "fixed_tz": 0.6, "fixed_rx": 0.02, "fixed_ry": -0.03, "fixed_rz": 0.01},
}


@dataclass(frozen=True)
class Measurement:
    """Poses (n, 6) and loads (n, L) in the scene's frame, and the standard deviations of their errors."""

    poses: Array
    loads: Array
    load_names: tuple[str, ...]
    force_n: float = 5.0
    torque_nmm: float = 100.0
    length_mm: float = 0.01
    angle_rad: float = 2e-4

    @property
    def load_deviation(self) -> Array:
        """Of each load (L,) [N, N·mm]."""
        return np.array([self.force_n if name[0] == "F" else self.torque_nmm for name in self.load_names])

    @property
    def pose_deviation(self) -> Array:
        """Of each pose parameter (6,) [mm, rad]."""
        return np.repeat([self.length_mm, self.angle_rad], 3)

    def columns(self) -> dict[str, Array]:
        """tx_mm ... rz_rad, Fy_med_N ... as `read_measurement` reads them."""
        names = [quantity(name).column for name in (*POSE_NAMES, *self.load_names)]
        return dict(zip(names, np.hstack([self.poses, self.loads]).T, strict=True))


def read_measurement(path: Path, load_names: Sequence[str]) -> Measurement:
    """A CSV file with tx_mm ... rz_rad and a column for each load, such as Fy_med_N and Tx_Nmm."""
    names = list(Measurement(np.zeros((1, 6)), np.zeros((1, len(load_names))), tuple(load_names)).columns())
    found = read_columns(path, required=names, what="measurement")
    table = np.column_stack([found[name] for name in names])
    return Measurement(table[:, :6], table[:, 6:], tuple(load_names))


def made_up(
    model: CompiledFoundation, truth: Mapping[str, float], frames: int = 30, noise: float = 1.0, seed: int = 1
) -> Measurement:
    """What would be measured of a knee with the true parameters at the flexion, rotation and loads of the built-in
    walk, while the femur swings by some mm; errors are noise times the standard deviations."""
    check_knee("a made-up measurement", model.scene, model.load_names, SIDES)
    cycle, share = reference_cycle(frames), 2.0 * np.pi * np.arange(frames) / frames
    relative = np.tile(model.scene.start_pose, (frames, 1))
    for name, curve in cycle.pose.items():
        relative[:, POSE_NAMES.index(name)] = curve
    relative[:, 0], relative[:, 2] = 2.0 + 2.5 * np.sin(2.0 * share), np.sin(3.0 * share)
    sides = {name: np.minimum(f, -150.0) for name, f in zip(SIDES, cycle.loads.values(), strict=True)}
    relative = settle_in_range(model, relative, relative, POSE_NAMES, sides)
    poses = composed(relative, np.array([truth.get(name, 0.0) for name in PLACEMENT]))
    function = model.function(parameters=tuple(truth))
    loads = np.asarray(function.map(frames)(poses.T, ca.repmat(ca.DM(list(truth.values())), 1, frames))).T
    exact, draw = Measurement(poses, loads, model.load_names), np.random.default_rng(seed)
    poses = poses + noise * exact.pose_deviation * draw.standard_normal(poses.shape)
    loads = loads + noise * exact.load_deviation * draw.standard_normal(loads.shape)
    return Measurement(poses, loads, model.load_names)


def composed(poses: Array, place: Array, *, inverse: bool = False) -> Array:
    """Poses (n, 6) in the scene's frame from those in a fixed body that lies at place (6,), or the reverse."""
    pose, at = ca.SX.sym("pose", 6), ca.SX.sym("at", 6)
    (t, R), (s, turn) = placed(ca.SX.zeros(6), pose), placed(ca.SX.zeros(6), at)
    out = relative_pose((s, turn), (t, R)) if inverse else pose_of(s + turn @ t, turn @ R)
    return np.asarray(ca.Function("composed", [pose, at], [out]).map(len(poses))(poses.T, place)).T


@dataclass(frozen=True)
class Estimate:
    """Values and standard deviations (m,) [MPa, mm, rad] of the parameters, infinite where not determined; Hessian H
    (m, m); load_error (n, L) [N, N·mm]; misfit: sum of squares over its degrees of freedom."""

    parameters: tuple[str, ...]
    values: Array
    deviations: Array
    hessian: Array
    load_error: Array
    misfit: float
    iterations: int


def start_poses(model: SymbolicContact, measured: Measurement) -> Array:
    """Measured poses settled under the measured normal loads: bodies that lie apart give no derivative."""
    pressing: dict[str, Array] = {}
    for normal in model.scene.normal_loads:
        forces = measured.loads[:, [measured.load_names.index(name) for name in normal.loads]]
        pressing |= dict(zip(normal.loads, normal.at_least(forces, model.scene.boundary_load).T, strict=True))
    return settle_in_range(model, measured.poses, measured.poses, POSE_NAMES, pressing)


def calibrate(model: CompiledFoundation, measured: Measurement, parameters: Sequence[str]) -> Estimate:
    """Estimate parameters of a foundation; material ones within a factor of 100 of the scene's, ν below 0.499."""
    names, n = check_parameters(parameters, model.scene.material), len(measured.poses)
    placing = np.array([name in PLACEMENT for name in names])
    unit = np.array([1.0 / POSE_IN_MM[PLACEMENT.index(name)] if name in PLACEMENT else 1.0 for name in names])
    reference = np.array([getattr(model.scene.material, name, 0.0) for name in names])
    z, delta, pose, load = (ca.MX.sym("s", rows) for rows in (len(names), 6, 6, len(measured.load_names)))
    p = ca.if_else(ca.DM(placing), unit * z, reference * ca.exp(ca.if_else(ca.DM(placing), 0.0, z)))
    loads = model.function(measured.load_names, parameters=names)(pose + ca.DM(measured.pose_deviation) * delta, p)
    off = (loads - load) / ca.DM(measured.load_deviation)
    values = ca.Function("values", [z], [p])
    residuals = ca.Function("residuals", [z, delta, pose, load], [off, ca.jacobian(off, z), ca.jacobian(off, delta)])
    only = ca.Function("residuals", [z, delta, pose, load], [off])

    Z, D = ca.MX.sym("z", len(names)), ca.MX.sym("delta", 6, n)
    r = ca.vec(only.map(n)(ca.repmat(Z, 1, n), D, ca.DM(measured.poses.T), ca.DM(measured.loads.T)))
    x = ca.vertcat(Z, ca.vec(D))
    J, lam = ca.jacobian(ca.vertcat(r, ca.vec(D)), x), ca.MX.sym("lam_f")
    short_steps = ca.diag(ca.vertcat(ca.DM.ones(len(names)), ca.DM.zeros(6 * n)))  # along directions left open
    hessian = ca.Function(
        "gauss_newton",
        [x, ca.MX(0, 1), lam, ca.MX(0, 1)],
        [ca.triu(lam * (J.T @ J + short_steps))],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    high = np.append(np.where(placing, np.inf, np.log(100.0)), np.full(6 * n, np.inf))
    low = -high
    if "poissons_ratio" in names:
        high[names.index("poissons_ratio")] = np.log(0.499 / model.scene.material.poissons_ratio)
    start = (start_poses(model, measured) - measured.poses) / measured.pose_deviation
    options = {**least_squares_options(max_iterations=200), "hess_lag": hessian}
    solver = ca.nlpsol("calibration", "ipopt", {"x": x, "f": 0.5 * (ca.sumsqr(r) + ca.sumsqr(D))}, options)
    answer = solver(x0=np.append(np.zeros(len(names)), start.ravel()), lbx=low, ubx=high)
    if not solver.stats()["success"]:
        raise ValueError(f"not solved ({solver.stats()['return_status']}): are poses in mm and rad, loads in N, N·mm?")

    found = np.asarray(answer["x"])[:, 0]
    z_found, H = found[: len(names)], np.zeros((len(names), len(names)))
    load_error = np.zeros(measured.loads.shape)
    for k, d in enumerate(found[len(names) :].reshape(-1, 6)):
        at, A, B = (np.asarray(part) for part in residuals(z_found, d, measured.poses[k], measured.loads[k]))
        H += A.T @ np.linalg.solve(np.eye(len(B)) + B @ B.T, A)
        load_error[k] = at[:, 0] * measured.load_deviation
    eigenvalues, vectors = np.linalg.eigh(H)
    spread = np.sqrt(np.sum(vectors**2 / np.maximum(eigenvalues, 1.0), axis=1))
    open_ones = (vectors[:, eigenvalues < 1.0] ** 2).sum(axis=1) > 0.05
    estimate = np.asarray(values(z_found))[:, 0]
    deviations = np.where(open_ones, np.inf, spread * np.where(placing, unit, estimate))
    misfit = 2.0 * float(answer["f"]) / max(measured.loads.size - len(names), 1)
    return Estimate(tuple(names), estimate, deviations, H, load_error, misfit, solver.stats()["iter_count"])


def main(
    measured: Path | None = None,
    scene: str = "knee",
    parameters: str = "youngs_modulus,fixed_tx,fixed_ty,fixed_tz,fixed_rx,fixed_ry",
    frames: int = 30,
    out: Path = Path("results/calibration"),
) -> None:
    """Estimate parameters from a measurement (CSV of tx_mm ... rz_rad, Fy_med_N ...), or from a made-up one."""
    model, names = cc.foundation(scene), [name.strip() for name in parameters.split(",")]
    truth = {name: TRUTH[name] for name in check_parameters(names, model.scene.material)}
    data = read_measurement(measured, model.load_names) if measured else made_up(model, truth, frames)
    found = calibrate(model, data, names)
    print("parameter            estimate  standard deviation", "" if measured else "      truth")
    for name, value, deviation in zip(found.parameters, found.values, found.deviations, strict=True):
        print(f"{name:15s} {value:13.5g} {deviation:19.3g}", "" if measured else f"{truth[name]:11.4g}")
    print(f"sum of squares over degrees of freedom {found.misfit:.3f}, {found.iterations} iterations")
    if found.misfit > 2.0:
        print("these parameters do not explain the data: check units and signs, free more, or state larger deviations")
    if np.isinf(found.deviations).any():
        print("not determined: leave one of these to the scene, or measure more")

    out.mkdir(parents=True, exist_ok=True)
    write_columns(out / "made_up.csv", data.columns())
    page = new_page(10.0, 4.5)
    left, right = page.subplots(1, 2)
    left.plot(found.load_error / data.load_deviation, ".-", lw=0.6, label=list(data.load_names))
    left.set(xlabel="frame", ylabel="loads, fitted minus measured [standard deviations]")
    left.legend(fontsize=7)
    covariance = np.linalg.inv(found.hessian + 1e-9 * np.eye(len(found.hessian)))
    size = np.sqrt(np.diag(covariance))
    image = right.imshow(covariance / np.outer(size, size), vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    right.set(title="correlation of the estimates", xticks=[], yticks=range(len(names)), yticklabels=found.parameters)
    page.colorbar(image, ax=right)
    save_page(page, out / "calibration.png")


if __name__ == "__main__":
    run_program(main)
