"""Whole solutions against error: pose estimation of a cycle by each contact model of a scene, timed in turn in one run.

The error is that of the loads at the poses found, against a converged elastic foundation there. Run
``python -m problems.studies.solve_time --help``.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.table import Table

from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import PlainConsole, run_program
from casadi_contact.core.workers import one_thread
from casadi_contact.optimisation.pose_estimation import PoseEstimation, PoseResult
from casadi_contact.pictures.charts import draw_speed_accuracy, save
from casadi_contact.samples.samples import load_errors
from casadi_contact.scenes.cycle import Cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import reference_motion_cycles
from casadi_contact.workflow.benchmark.candidates import Candidate, compare, surrogate_candidates, untrained_candidates
from casadi_contact.workflow.benchmark.front_file import Front, Point, write_front
from casadi_contact.workflow.benchmark.measure import converged_elements, header_of
from casadi_contact.workflow.project import shipped_surrogates

NAME = "solve_time"


def measured_front(scene: Scene, cycle: Cycle, repeats: int = 3) -> Front:
    """Time of the whole solution [µs a frame], start and settling included, and RMS errors of the loads there.

    Models: the scene's coarse and fine elements (their Hessians are differences of the Jacobian), foundations from
    coarse to fine, and the surrogates that are shipped for the scene. One that leaves frames unsolved fails."""
    grid, grids = converged_elements(scene), (None, scene.grids["coarse"], scene.grids["fine"])
    truth = ElasticFoundation(scene, grid)
    candidates = [each for each in untrained_candidates(scene) if getattr(each.model, "grid", None) in grids]
    for name, surrogate in shipped_surrogates(scene).items():
        candidates += surrogate_candidates(name, surrogate)
    points: dict[str, Point] = {}
    measurements: dict[str, Callable[[], float]] = {}
    with one_thread():
        for candidate in candidates:
            name = candidate.point.name
            points[name] = _point(candidate, cycle, truth)
            if not points[name].failure:
                measurements[name] = partial(_seconds_a_frame, candidate, cycle)
        timings = compare(measurements, repeats)
    header = header_of(scene, f"EF {grid_text(grid)}", cycle=cycle.name, frames=str(len(cycle.time_s)))
    return Front(header, tuple(replace(point, value=timings.get(name)) for name, point in points.items()))


def draw(front: Front) -> Any:
    """Time a frame against errors in force and torque."""
    header = front.header
    measured = f"{header['frames']} frames of {header['cycle']}, loads at the poses found against {header['reference']}"
    return draw_speed_accuracy(front, "whole solution of pose estimation, time a frame against error", measured)


def _solve(candidate: Candidate, cycle: Cycle) -> PoseResult:
    return PoseEstimation.of_cycle(symbolic(cast(ContactModel, candidate.model)), cycle).solve()


def _point(candidate: Candidate, cycle: Cycle, truth: ElasticFoundation) -> Point:
    """A model's errors at the poses that it finds."""
    point = replace(candidate.point, training_seconds=0.0, parameters=0, remark="")
    if candidate.model is None:
        return point
    result = _solve(candidate, cycle)
    solved = int(result.solved.sum())
    if solved < len(result.solved):
        return replace(point, failure=f"{solved} of {len(result.solved)} frames solved")
    errors = load_errors(truth.load_names, candidate.model(result.poses), truth(result.poses))
    rms = {load: error["rms"] for load, error in errors.items()}
    return replace(point, load_rms=rms, remark=f"{result.ipopt.iterations} IPOPT iterations")


def _seconds_a_frame(candidate: Candidate, cycle: Cycle) -> float:
    began = time.perf_counter()
    _solve(candidate, cycle)
    return (time.perf_counter() - began) / len(cycle.time_s)


def run(
    scene: Annotated[str, typer.Argument(help="ready scene, or the path of a .toml")] = "knee",
    cycle: Annotated[Path | None, typer.Option(help="measured cycle (CSV); the scene's own if left out")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="solutions by each model")] = 3,
    out: Annotated[Path, typer.Option(help="folder for solve_time.csv and .png")] = Path("results") / NAME,
) -> None:
    """Chart whole solve time against error."""
    writable_folder(out)
    joint = load_scene(scene)
    measured = reference_motion_cycles(joint, [] if cycle is None else [cycle])[0]
    front = measured_front(joint, measured, repeats)
    write_front(out / f"{NAME}.csv", front)
    save(draw(front), out, NAME)
    table = Table("model", "ms a frame", "force [N]", "torque [N·mm]", "")
    for point in front.points:
        ms = "" if point.value is None else f"{1e-3 * point.value.median_us:.3g}"
        errors = (f"{point.force_rms_n:.3g}", f"{point.torque_rms_nmm:.3g}")
        table.add_row(point.name, ms, *errors, point.failure or point.remark)
    PlainConsole().print(table)
    print(f"results in {out}")


if __name__ == "__main__":
    run_program(run)
