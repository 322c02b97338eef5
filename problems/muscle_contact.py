"""Muscle and contact: which muscles pull how hard in a walk, and what does the knee's contact carry?

    min Σ a^p + Σ (r/size)²    so that    Σ_m arm_m·F_m(a_m) + contact(q) + r = inverse dynamics

over all frames of the walk at once, with Hill muscles and both sides closed
(`casadi_contact.optimisation.muscle_contact`). Measured contact forces enter nowhere; a cycle given as `measured` is
compared with.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.quantities import quantity
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.knee import COORDINATES, KNEE_LOADS, SIDES, coordinate_unit
from casadi_contact.optimisation.muscle import MuscleWalk
from casadi_contact.optimisation.muscle_contact import MuscleContact, MuscleContactResult, MuscleSettings
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import SURROGATE, TARGET, frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.cycle import read_cycle
from casadi_contact.scenes.opensim import ColumnMap
from problems.contact_source import load_contact
from problems.pose_estimation import rms_and_max
from problems.summary import tell, write_summary
from problems.walks import ROTATION_MAPS, at_times, example_walk, read_walk


def main(
    rotations: Path | None = None,
    inverse_dynamics: Path | None = None,
    muscles: Path | None = None,
    parameters: Path | None = None,
    maps: list[str] | None = None,
    measured: Path | None = None,
    surrogate: str | None = None,
    scene: str | None = None,
    exponent: float = 3.0,
    margin_mm: float = 20.0,
    all_six: bool = False,
    out: Path = Path("results/muscle_contact"),
) -> None:
    """Find the activations and contact forces of a walk (four files, see `read_walk`; the built-in one for none).

    maps: columns of the rotations file, such as knee_angle_r=-rz:deg. margin_mm: both sides stay closed though the load
    passes so far beside. all_six: balance all six coordinates, tx and tz being free too. Exit status 3: some frames are
    not solved by muscles and contact alone; 4: all are, but the elements differ in some."""
    walk = walk_of((rotations, inverse_dynamics, muscles, parameters), maps)
    settings = MuscleSettings(exponent=exponent, margin_mm=margin_mm)
    if all_six:
        settings = replace(settings, balanced=tuple(COORDINATES), free=("tx", "ty", "tz", "rx"))
    problem = MuscleContact(load_contact(surrogate, scene), walk, settings)
    result = problem.solve()
    model = problem.contact_model
    verdict = verify(model, result.poses, reference_model(model), result.solved, KNEE_LOADS)

    summary = {"walk": walk.name, **tell(result, verdict)}
    compression, compared = -result.loads[:, :2], {}
    forces = None if measured is None else measured_compression(measured, walk)
    for k, side in enumerate(SIDES):
        print(f"{side}: largest compression {compression[:, k].max():.0f} N")
        if forces is not None:
            off = compression[:, k] - forces[:, k]
            compared[side] = {"rms": float(np.sqrt(np.mean(off**2))), "mean": float(off.mean())}
            print(f"  predicted - measured: RMS {compared[side]['rms']:.3g} N, mean {compared[side]['mean']:+.3g} N")
    reserves = {name: f"{np.abs(curve).max():.2g} {coordinate_unit(name)}" for name, curve in result.reserves.items()}
    print(f"largest reserves: {reserves}; largest activation: {result.activations.max():.2f}")
    out.mkdir(parents=True, exist_ok=True)
    columns: dict[str, Any] = {"time_s": walk.time_s}
    columns |= {quantity(name).column: result.poses[:, k] for k, name in enumerate(POSE_NAMES)}
    columns |= {quantity(name).column: result.loads[:, k] for k, name in enumerate(KNEE_LOADS)}
    for k, name in enumerate(walk.muscles.names):
        columns |= {f"{name}_activation": result.activations[:, k], f"{name}_N": result.muscle_forces_n[:, k]}
    columns |= {"outcome": [outcome.value for outcome in result.outcome], "verdict": verdict.words}
    write_columns(out / "muscle_contact.csv", columns, digits=9)
    elements_off = {side: rms_and_max(verdict.errors[:, k]) for k, side in enumerate(SIDES)}
    summary |= {"predicted_minus_measured": compared, "elements_off": elements_off}
    write_summary(out / "summary.json", summary)
    draw(out / "muscle_contact.png", walk, result, forces)
    print(f"results in {out}")
    raise SystemExit(verdict.exit_code)


def walk_of(files: Sequence[Path | None], maps: Sequence[str] | None = None) -> MuscleWalk:
    """The walk of rotations, inverse dynamics, muscles and parameters, the built-in one for none of them."""
    given = [path for path in files if path is not None]
    if not given:
        return example_walk()
    if len(given) < len(files):
        raise ValueError("got some of rotations, inverse dynamics, muscles and parameters, expected all four or none")
    rotations, inverse_dynamics, muscles, parameters = given
    columns = [ColumnMap.parse(text) for text in maps or ()] or ROTATION_MAPS
    return read_walk(rotations, inverse_dynamics, muscles, parameters, columns)


def measured_compression(path: Path, walk: MuscleWalk) -> Array:
    """Measured medial and lateral compression (n, 2) [N] at the walk's times."""
    cycle = read_cycle(path)
    return at_times(str(path), cycle.time_s, -np.stack([cycle.loads[side] for side in SIDES], axis=1), walk.time_s)


def draw(path: Path, walk: MuscleWalk, result: MuscleContactResult, measured: Array | None) -> None:
    """Compression of both sides, and forces and activations of the strongest muscles, over the cycle."""
    page = new_page(12.0, 6.0)
    axes = page.subplots(2, 2).ravel()
    for k, side in enumerate(SIDES):
        if measured is not None:
            axes[k].plot(walk.percent, measured[:, k], label="measured", **TARGET)
        axes[k].plot(walk.percent, -result.loads[:, k], label="predicted", **SURROGATE)
        axes[k].set_ylabel(f"compression, {side} [N]")
        axes[k].legend()
    for axis, table, label in ((axes[2], result.muscle_forces_n, "force [N]"), (axes[3], result.activations, "a")):
        for k in np.argsort(-result.muscle_forces_n.max(axis=0))[:6]:
            axis.plot(walk.percent, table[:, k], label=walk.muscles.names[k])
        axis.set_ylabel(label)
    axes[3].legend()
    frame(axes, "cycle [%]")
    save_page(page, path)


if __name__ == "__main__":
    run_program(main)
