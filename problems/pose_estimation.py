"""Pose estimation: which poses of a joint carry the loads and centres of pressure of a measured cycle?

    min ½ Σ |r_k(q_k)|² + ½ smoothness·Σ |q_{k+1} - q_k|²    over all frames k, q_k in the learned range

r are the misfits of the measured loads and centres of pressure, measured pose parameters are locked
(`casadi_contact.optimisation.pose_estimation`). All frames are verified on the scene's elements.

Input columns (`casadi_contact.scenes.cycle.read_cycle`): time_s and any of the joint's pose parameters, loads and
centres of pressure with their units (rz_rad, Fy_med_N, cop_x_mm). Output columns: `write_frames`.
"""

from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.quantities import FORCE, LENGTH, TORQUE, quantity
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.pose_estimation import PoseEstimation, PoseResult, PoseTargets
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.verification import Verification, beside_leaps, verify
from casadi_contact.pictures.page import FAILED, FOUNDATION, SURROGATE, TARGET, frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.cycle import Cycle
from casadi_contact.scenes.opensim import poses_table, write_table
from problems.contact_source import load_contact, load_cycle
from problems.summary import tell, write_summary


def main(
    cycle: Path | None = None,
    surrogate: str | None = None,
    scene: str | None = None,
    smoothness: float = 0.0,
    out: Path = Path("results/pose_estimation"),
) -> None:
    """Find the poses of a cycle (CSV) on a surrogate, or on the foundation of a scene; verify them on its elements.

    smoothness weighs the change from frame to frame [N²/mm²]. Exit status 3: some frames are not solved; 4: all are,
    but some are not verified."""
    model = load_contact(surrogate, scene)
    measured = load_cycle(model.scene, cycle)
    raise SystemExit(estimate(model, measured, out, smoothness))


def estimate(model: SymbolicContact, measured: Cycle, out: Path, smoothness: float = 0.0) -> int:
    """Solve, verify, print and write into the folder out; the exit status."""
    problem = PoseEstimation.of_cycle(model, measured, smoothness=smoothness)
    for warning in check_targets(problem.targets):
        print(f"{measured.name}: {warning}")
    result, reference = problem.solve(), reference_model(model)
    leaps = beside_leaps(result.poses, result.solved)[:, problem.contact.columns].any(axis=1)
    rows = {"without_load": ~problem.targets.loaded, "leaps": leaps}
    verdict = verify(model, result.poses, reference, result.solved, problem.targets.load_names, **rows)
    on_elements = np.full(result.errors.shape, np.nan)
    if not isinstance(reference, str):
        columns = [reference.load_names.index(name) for name in problem.targets.load_names]
        on_elements = problem.targets.evaluate(reference(result.poses)[:, columns])

    summary = {"cycle": measured.name, "scene": model.scene.name, **tell(result, verdict)}
    errors = {name: rms_and_max(result.errors[:, k]) for k, name in enumerate(problem.targets.values)}
    print("RMS / max   model - measured     elements - model")
    off = on_elements - problem.targets.evaluate(result.loads)
    for k, name in enumerate(problem.targets.values):
        cells = [f"{rms:8.2g} / {largest:8.2g}" for rms, largest in (errors[name], rms_and_max(off[:, k]))]
        print(f"{quantity(name).label:12s}{cells[0]}  {cells[1]}")
    out.mkdir(parents=True, exist_ok=True)
    write_frames(out / "pose_estimation.csv", problem, measured, result, verdict, on_elements)
    write_table(poses_table(measured.time_s, result.poses, f"{measured.name} poses"), out / "poses.sto")
    summary["elements_off"] = {name: rms_and_max(off[:, k]) for k, name in enumerate(problem.targets.values)}
    write_summary(out / "summary.json", summary)
    draw(out / "pose_estimation.png", problem, measured, result, on_elements)
    print(f"results in {out}")
    return verdict.exit_code


def rms_and_max(errors: Array) -> tuple[float, float]:
    """Root mean square and largest size of errors (n,), of those that are numbers."""
    known = errors[np.isfinite(errors)]
    return (float(np.sqrt(np.mean(known**2))), float(np.abs(known).max())) if len(known) else (np.nan, np.nan)


def check_targets(targets: PoseTargets) -> list[str]:
    """Warnings about units and signs: forces outside 0.01 to 20 times the scene's reference load, torques of forces on
    levers below 0.05 mm, centres of pressure within 0.5 mm of the origin throughout, and of a knee a centre off that of
    forces at the patches' anchors, Σ F z / Σ F, by more than half of it and 1 mm (RMS)."""
    values, warnings = targets.values, []
    force_n, torque_nmm, centre_mm = (
        max((float(np.abs(v).max()) for n, v in values.items() if quantity(n).kind == kind), default=0.0)
        for kind in (FORCE, TORQUE, LENGTH)
    )
    if force_n > 0.0 and not 0.01 <= force_n / targets.scene.reference_load <= 20.0:
        warnings.append(f"the largest force is {force_n:.3g} N, expected a joint's: is its unit kN, or body weight?")
    if 1e-6 * force_n < torque_nmm < 0.05 * force_n:
        warnings.append(f"the largest torque is {torque_nmm:.3g} N·mm, expected more: is its unit N·m?")
    if {"Fy_med", "Fy_lat", "cop_ml"} <= set(values):
        forces, places = np.column_stack([values["Fy_med"], values["Fy_lat"]]), targets.scene.anchors_mm[:, 2]
        loaded = np.abs(forces.sum(axis=1)) > 0.05 * force_n
        middle = places.mean()
        expected = forces[loaded] @ (places - middle) / forces[loaded].sum(axis=1)
        got = values["cop_ml"][loaded] - middle
        if np.linalg.norm(got - expected) > 0.5 * np.linalg.norm(expected) + np.sqrt(len(got)):  # 1 mm a frame
            warnings.append(
                f"cop_ml contradicts Fy_med and Fy_lat by up to {np.abs(got - expected).max():.2g} mm: check the origin"
            )
    elif 0.0 < centre_mm < 0.5:
        warnings.append(f"centres of pressure reach {centre_mm:.2g} mm, expected some mm: is their unit m?")
    return warnings


def write_frames(
    path: Path, problem: PoseEstimation, measured: Cycle, result: PoseResult, verdict: Verification, on_elements: Array
) -> None:
    """A row for each frame. A new output column is one more entry of `columns`, (n,) values by name."""
    columns: dict[str, Any] = {"frame": range(problem.frames), "time_s": measured.time_s}
    columns |= {"cycle_percent": measured.percent}
    columns |= {quantity(name).column: result.poses[:, k] for k, name in enumerate(POSE_NAMES)}
    found = problem.targets.evaluate(result.loads)
    for k, (name, target) in enumerate(problem.targets.values.items()):
        unit = quantity(name).kind.plain_unit
        columns |= {f"{name}_target_{unit}": target, f"{name}_found_{unit}": found[:, k]}
        columns |= {f"{name}_elements_{unit}": on_elements[:, k]}
    columns |= {"share_of_load_at_edges": verdict.at_edge}
    columns |= {"outcome": [outcome.value for outcome in result.outcome], "verdict": verdict.words}
    write_columns(path, columns, digits=9)


def draw(path: Path, problem: PoseEstimation, measured: Cycle, result: PoseResult, on_elements: Array) -> None:
    """Targets above, poses below, over the cycle."""
    found, percent = problem.targets.evaluate(result.loads), measured.percent
    failed = ~result.solved & problem.targets.loaded
    wide = max(len(problem.targets.values), 3)
    page = new_page(3.5 * wide, 6.5)
    axes = page.subplots(2, wide, squeeze=False)
    for k, (name, target) in enumerate(problem.targets.values.items()):
        axes[0, k].plot(percent, target, label="measured", **TARGET)
        axes[0, k].plot(percent, found[:, k], label="found", **SURROGATE)
        axes[0, k].plot(percent, on_elements[:, k], label="elements", **FOUNDATION)
        axes[0, k].plot(percent[failed], found[failed, k], label="not solved", **FAILED)
        axes[0, k].set_ylabel(quantity(name).label)
    for axis, names, unit in zip(axes[1], (("tx", "tz"), ("ty",), ("rx", "ry", "rz")), ("mm", "mm", "°"), strict=False):
        for name in names:
            values = result.poses[:, POSE_NAMES.index(name)]
            axis.plot(percent, np.degrees(values) if unit == "°" else values, label=name)
        axis.set_ylabel(f"pose [{unit}]")
        axis.legend()
    for axis in [*axes[0, len(problem.targets.values) :], *axes[1, 3:]]:
        axis.set_visible(False)
    axes[0, 0].legend()
    frame(axes.ravel(), "cycle [%]")
    save_page(page, path)


if __name__ == "__main__":
    run_program(main)
