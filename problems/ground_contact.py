"""A foot on the ground: contact parameters from a measured step, tried on another one.

    unknowns    z: stiffness, dissipation, friction; s: where the sole lies in the foot; and the foot's true pose q_k
    minimise    ½ Σ_k |e_k|² + ½ a Σ_k |e_{k+1} - e_k|² + ½ Σ_k |δ_k|² + ½ r Σ_k |δ_{k+1} - 2δ_k + δ_{k-1}|²
                + ½ |z/σ_z|² + ½ |s|²,        e = (L(q, q̇; p) - L̂)/σ_L

with measured poses q̂ = q - σ_q·δ of markers that are wrong by some mm and degrees, and loads L̂ of a force plate.
Loads are taken in the middle between frames, q = (q_k + q_{k+1})/2 and q̇ = (q_{k+1} - q_k)/Δt: the three forces, and
the moments about the measured centre of pressure, which vanish but for the free one. Errors last: they change little
from frame to frame. One IPOPT problem with the exact Hessian. Another step is fitted with the same coefficients. Its
poses are free, and six numbers for the whole step: where the sole lies in the foot, since markers and model place each
foot's frame otherwise, within three deviations. A shoe that does not slip tells friction from below alone: walking
needs some 0.2 (Redfern et al., Ergonomics 44 (2001) 1138-1166), and it stays near a dry floor's 0.6.
The scene's transition velocity is that of published contact of walking, 0.2 m/s (see `problems.tracked_step`).

Input columns: time_s, foot_tx_mm ... foot_rz_rad (the calcaneus in a ground with x forward, y up, z to the right, x-y-z
body-fixed angles), Fx_N Fy_N Fz_N on the foot, cop_x_mm and cop_z_mm at y = 0, free_Ty_Nmm.
"""

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.symbolic import PLACEMENT
from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, Array
from casadi_contact.core.quantities import quantity
from casadi_contact.core.terminal import run_program
from casadi_contact.networks.frames import placed, relative_pose
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.pictures.page import SURROGATE, TARGET, new_page, save_page
from casadi_contact.scenes.columns import read_columns, write_columns

COEFFICIENTS = ("youngs_modulus", "dissipation", "dynamic_friction")
PARAMETERS = (*COEFFICIENTS, *PLACEMENT)
LOADED_N = 40.0  # less tells no centre of pressure


@dataclass(frozen=True)
class Step:
    """Times (n,) [s], poses (n, 6) of the foot in the ground [mm, rad] and the wrench (n, 6) of the ground on it about
    the origin [N, N·mm]."""

    time_s: Array
    poses: Array
    wrench: Array

    @property
    def middles(self) -> Array:
        """Wrenches (n - 1, 6) between the frames."""
        return 0.5 * (self.wrench[1:] + self.wrench[:-1])


def read_step(path: Path, *, left: bool = False, every: int = 3, rest: int = 3) -> Step:
    """A measured step, each `every`-th frame from `rest` of these before the load to as many after. A left foot is
    mirrored into a right one. The ground's origin moves below the foot."""
    names = [f"foot_{quantity(name).column}" for name in POSE_NAMES]
    loads = ["Fx_N", "Fy_N", "Fz_N", "cop_x_mm", "cop_z_mm", "free_Ty_Nmm"]
    found = read_columns(path, required=["time_s", *names, *loads], what="step")
    poses, (Fx, Fy, Fz, x, z, free) = np.column_stack([found[name] for name in names]), (found[name] for name in loads)
    on = np.flatnonzero(Fy > LOADED_N)
    if not on.size:
        raise ValueError(f"{path}: Fy_N reaches {Fy.max():.3g}, expected a step's, above {LOADED_N:g} N: is y up?")
    rows = np.arange(max(on[0] - rest * every, 0), min(on[-1] + rest * every + 1, len(Fy)), every)
    origin = poses[on[len(on) // 2], :3] * [1.0, 0.0, 1.0]
    poses[:, :3] -= origin
    x, z = x - origin[0], z - origin[2]
    wrench = np.column_stack([Fx, Fy, Fz, -z * Fy, free + z * Fx - x * Fz, x * Fy])
    wrench[Fy <= 0.0] = 0.0
    mirror = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0]) if left else np.ones(6)
    return Step(found["time_s"][rows], (poses * mirror)[rows], (wrench * mirror)[rows])


def pressure_centre(wrench: Array) -> Array:
    """x, z (n, 2) [mm] of the centre of pressure on the ground y = 0 and the free moment about it [N·mm]: (n, 3)."""
    Fx, Fy, Fz, Tx, Ty, Tz = wrench.T
    x, z = Tz / np.maximum(Fy, 1.0), -Tx / np.maximum(Fy, 1.0)
    return np.column_stack([x, z, Ty - (z * Fx - x * Fz)])


def kinematics() -> tuple[ca.Function, ca.Function]:
    """In cheap SX: (pose of the foot (6), rates (6), place of the sole (6)) -> pose of the ground in the sole and its
    rates; (pose, place, wrench on the sole (6)) -> that wrench about the ground's origin."""
    pose, rates, place, wrench = (ca.SX.sym(name, 6) for name in ("pose", "rates", "place", "wrench"))
    t, R = placed(pose, place)
    met = relative_pose((t, R), (ca.SX.zeros(3), ca.SX.eye(3)))
    meets = ca.Function("meets", [pose, rates, place], [met, ca.jtimes(met, pose, rates)])
    on_foot = ca.vertcat(R @ wrench[:3], R @ wrench[3:] + ca.cross(t, R @ wrench[:3]))
    return meets, ca.Function("in_ground", [pose, place, wrench], [on_foot])


def ground_wrench(model: CompiledFoundation) -> ca.Function:
    """(pose of the foot (6), rates (6), parameters) -> wrench (6) of the ground on it about the ground's origin."""
    meets, in_ground = kinematics()
    pose, rates, p = (ca.MX.sym(name, rows) for name, rows in (("pose", 6), ("rates", 6), ("p", len(PARAMETERS))))
    coefficients, place = p[: len(COEFFICIENTS)], p[len(COEFFICIENTS) :]
    contact = model.function(WRENCH_NAMES, velocity=True, parameters=(*COEFFICIENTS, "static_friction"))
    own = contact(*meets(pose, rates, place), ca.vertcat(coefficients, p[COEFFICIENTS.index("dynamic_friction")]))
    return ca.Function("ground", [pose, rates, p], [in_ground(pose, place, own)])


@dataclass(frozen=True)
class Weights:
    """Standard deviations of forces [N], of centres of pressure [mm], of the free moment [N·mm], of poses [mm, rad]; a
    of the loads' changes, r of the pose's bends; most a pose is corrected by, in its deviations; deviations of the
    sole's place [mm, rad], and of the coefficients' logarithms z."""

    force_n: float = 20.0
    centre_mm: float = 5.0
    free_nmm: float = 1000.0
    length_mm: float = 2.0
    angle_rad: float = 0.012
    lasting: float = 4.0
    rough: float = 2.0
    most: float = 8.0
    place: tuple[float, ...] = (15.0, 15.0, 15.0, 0.1, 0.1, 0.1)
    prior: tuple[float, ...] = (1.0, 1.0, 0.03)

    @classmethod
    def other_foot(cls) -> "Weights":
        """Of a foot to which the sole was not fitted: its loads deviate more, and change more between frames."""
        return cls(force_n=40.0, centre_mm=5.5, free_nmm=2000.0, lasting=2.0)


@dataclass(frozen=True)
class Fit:
    """Parameters by name, corrected poses (n, 6), wrenches (n - 1, 6) between the frames; how IPOPT ended."""

    parameters: dict[str, float]
    poses: Array
    wrench: Array
    ipopt: IpoptOutcome


def start_heights(wrench: ca.Function, step: Step, p: Array, reach_mm: float = 20.0) -> Array:
    """How far (n,) [mm] to lift the foot so that it carries its vertical force at rest: by bisection."""
    low, high = np.full(len(step.poses), -reach_mm), np.full(len(step.poses), reach_mm)
    at = wrench.map(len(low))
    for _ in range(12):
        middle = 0.5 * (low + high)
        force = np.asarray(at((step.poses + np.outer(middle, np.eye(6)[1])).T, 0.0, p))[1]
        deep = force > step.wrench[:, 1]
        low, high = np.where(deep, middle, low), np.where(deep, high, middle)
    return np.where(step.wrench[:, 1] > 0.0, low, 0.0)


def fit(
    model: CompiledFoundation, step: Step, known: dict[str, float] | None = None, weights: Weights | None = None
) -> Fit:
    """Fit poses, the sole's place, and coefficients unless they are known; ValueError where IPOPT finds no solution."""
    w, n = weights or Weights(), len(step.time_s)
    scene = {**vars(model.scene.friction), **vars(model.scene.material), **dict.fromkeys(PLACEMENT, 0.0)}
    start = np.array([(known or scene)[name] for name in PARAMETERS])
    z, s, D = ca.MX.sym("z", 0 if known else len(COEFFICIENTS)), ca.MX.sym("s", 6), ca.MX.sym("D", 6, n)
    p = ca.vertcat(ca.DM(start[:3]) * (ca.exp(z) if z.numel() else 1.0), ca.DM(start[3:]) + ca.DM(w.place) * s)
    unit, wrench = np.repeat([w.length_mm, w.angle_rad], 3), ground_wrench(model)
    poses = ca.DM(step.poses.T) + ca.diag(unit) @ D
    middle = 0.5 * (poses[:, 1:] + poses[:, :-1])
    rates = (poses[:, 1:] - poses[:, :-1]) @ ca.diag(1.0 / np.diff(step.time_s))
    found = wrench.map(n - 1)(middle, rates, ca.repmat(p, 1, n - 1))

    measured, on = step.middles, (step.wrench[1:, 1] > LOADED_N) & (step.wrench[:-1, 1] > LOADED_N)
    c = pressure_centre(measured) * on[:, None]
    off = found - ca.DM(measured.T)
    x_c, z_c = ca.DM(c[:, 0]).T, ca.DM(c[:, 1]).T
    arm = ca.DM(on / (w.centre_mm * (measured[:, 1] + 60.0))).T
    moments = [
        arm * (off[5, :] - x_c * off[1, :]),
        arm * (off[3, :] + z_c * off[1, :]),
        ca.DM(on).T * (off[4, :] - z_c * off[0, :] + x_c * off[2, :]) / w.free_nmm,
    ]
    misfit = ca.vertcat(off[:3, :] / w.force_n, *moments)
    bend = D[:, 2:] - 2.0 * D[:, 1:-1] + D[:, :-2]
    cost = ca.sumsqr(misfit) + w.lasting * ca.sumsqr(misfit[:, 1:] - misfit[:, :-1]) + ca.sumsqr(D)
    cost += w.rough * ca.sumsqr(bend) + ca.sumsqr(s) + (0.0 if known else ca.sumsqr(z / ca.DM(w.prior)))
    unknowns = ca.vertcat(z, s, ca.vec(D))
    options = ipopt_options(tolerance=1e-3, max_iterations=1000, mu_init=1e-3)
    solver = ca.nlpsol("step", "ipopt", {"x": unknowns, "f": 0.5 * cost}, options)
    lifted = np.outer(start_heights(wrench, step, start) / w.length_mm, np.eye(6)[1])
    bound = np.append(np.full(z.numel() + 6, 3.0), np.full(6 * n, w.most))
    answer = solver(
        x0=np.append(np.zeros(z.numel() + 6), np.clip(lifted, -w.most, w.most).ravel()), lbx=-bound, ubx=bound
    )
    outcome = IpoptOutcome.of(solver)
    if not outcome.solved:
        raise ValueError(f"not solved ({outcome}): are poses in mm and rad, forces in N, and is y up?")
    values = ca.Function("values", [unknowns], [p, poses, found])(answer["x"])
    p_found, q, loads = (np.asarray(value).T for value in values)
    return Fit(dict(zip(PARAMETERS, p_found[0].tolist(), strict=True)), q, loads, outcome)


def misfits(step: Step, found: Fit) -> dict[str, float]:
    """RMS of vertical and fore-aft force [N], centre of pressure [mm], free moment [N·m], pose under load [mm, °]."""
    measured, on = step.middles, step.middles[:, 1] > LOADED_N
    off = found.wrench - measured
    c = (pressure_centre(found.wrench) - pressure_centre(measured))[on]
    moved = (found.poses - step.poses)[step.wrench[:, 1] > 0.0] / np.repeat([1.0, np.pi / 180.0], 3)
    differences = {
        "vertical_N": off[:, 1],
        "fore_aft_N": off[:, 0],
        "cop_mm": c[:, :2],
        "free_moment_Nm": 1e-3 * c[:, 2],
        "moved_mm": moved[:, :3],
        "turned_deg": moved[:, 3:],
    }
    return {name: float(np.linalg.norm(rows) / np.sqrt(len(rows))) for name, rows in differences.items()}


def main(
    fitted: Path = Path("../shared/data/jam_knee/steps/right_step.csv"),
    unseen: Path = Path("../shared/data/jam_knee/steps/left_step_1.csv"),
    scene: str = "foot_on_ground",
    every: int = 3,
    swap: bool = False,
    out: Path = Path("results/ground_contact"),
) -> None:
    """Fit a right foot's step (CSV), then a left foot's poses with what was found, or, to swap, the other way round."""
    model = cc.foundation(scene)
    both = (read_step(fitted, every=every), read_step(unseen, left=True, every=every))
    steps = dict(zip(("fitted", "unseen"), both[::-1] if swap else both, strict=True))
    found = {"fitted": fit(model, steps["fitted"])}
    found["unseen"] = fit(model, steps["unseen"], known=found["fitted"].parameters, weights=Weights.other_foot())
    for name, value in found["fitted"].parameters.items():
        print(f"{name:20s} {value:10.4g}" + f"{found['unseen'].parameters[name]:10.4g}" * (name in PLACEMENT))
    table = {name: misfits(steps[name], found[name]) for name in steps}
    print("RMS" + " " * 21 + "".join(f"{name:>10s}" for name in table))
    for key in table["fitted"]:
        print(f"{key:24s}" + "".join(f"{table[name][key]:10.2f}" for name in table))
    print("; ".join(f"{name}: {fitted.ipopt}" for name, fitted in found.items()))

    out.mkdir(parents=True, exist_ok=True)
    page = new_page(12.0, 6.0)
    labels = ("fore-aft [N]", "vertical [N]", "centre of pressure x [mm]", "free moment [N·m]")
    for row, (name, step) in zip(page.subplots(2, 4), steps.items(), strict=True):
        time, on = 0.5 * (step.time_s[1:] + step.time_s[:-1]), step.middles[:, 1] > LOADED_N
        for source, wrench, style in (("plate", step.middles, TARGET), ("model", found[name].wrench, SURROGATE)):
            shown = np.column_stack([wrench[:, :2], pressure_centre(wrench) * [1.0, 1.0, 1e-3]])[:, [0, 1, 2, 4]]
            for axis, values, label in zip(row, shown.T, labels, strict=True):
                axis.plot(time[on], values[on], label=source, **style)
                axis.set(ylabel=label, xlabel=f"time of the {name} step [s]")
        columns = dict(zip(WRENCH_NAMES, found[name].wrench.T, strict=True))
        write_columns(out / f"{name}.csv", {"time_s": time, **columns}, digits=9)
        row[0].legend()
    save_page(page, out / "ground_contact.png")


if __name__ == "__main__":
    run_program(main)
