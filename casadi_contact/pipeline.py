"""The stages from a scene to a surrogate, each restarting alone from the files of the one before it.

cycles -> motion.npz, samples.h5 -> training/ -> patch.h5, two_stage.h5 -> evaluation.json -> export/
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.dataset import Samples, read_samples, read_table, write_samples
from casadi_contact.evaluation import domain_errors, machine_record
from casadi_contact.evaluation import evaluate as evaluate_models
from casadi_contact.files import replacing, writable_folder
from casadi_contact.network import Regression
from casadi_contact.presets import PRESETS, Effort, Preset, effort_for
from casadi_contact.sampling import (
    ReferenceMotion,
    ReferenceReport,
    SamplePoint,
    SamplingSettings,
    draw_samples,
    elastic_foundations,
    found_sensitive_pose,
    reference_motion,
)
from casadi_contact.sampling.draw import ModelPair
from casadi_contact.scenes import Scene, load_scene
from casadi_contact.scenes.cycles import LoadCycle, read_cycle
from casadi_contact.scenes.joint_cycle import JointCycle, read_joint_cycle, scene_cycles
from casadi_contact.scenes.motion import reference_cycles
from casadi_contact.surrogate import PatchSurrogate, TwoStageSurrogate, calibrated, load_surrogate
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.info import samples_record
from casadi_contact.training import TrainingSettings, fit_all
from casadi_contact.transcription import save_function
from casadi_contact.workers import worker_pool

STRUCTURES: dict[str, type[PatchSurrogate] | type[TwoStageSurrogate]] = {
    "patch": PatchSurrogate,
    "two_stage": TwoStageSurrogate,
}
Update = Callable[[str, float, float, str], None]


@dataclass(frozen=True)
class Project:
    """A scene, a preset and the folder that holds everything made from them."""

    scene: Scene
    preset_name: str
    folder: Path

    @classmethod
    def open(cls, scene: str | Path, preset: str, folder: Path | None = None) -> Project:
        """Check the names and make the folder (results/SCENE-PRESET if left out).

        The sensitive pose parameters of a scene that leaves them out are found, and kept in the folder's scene.toml.

        Raises ValueError for an unknown scene or preset, OSError for a folder that cannot be made or written.
        """
        loaded = load_scene(scene)
        if preset not in PRESETS:
            raise ValueError(f"unknown preset {preset!r}, expected one of {', '.join(PRESETS)}")
        folder = Path("results") / f"{loaded.name}-{preset}" if folder is None else Path(folder)
        writable_folder(folder)
        return cls(loaded if loaded.sensitive_pose else _completed(loaded, folder / "scene.toml"), preset, folder)

    @property
    def preset(self) -> Preset:
        return PRESETS[self.preset_name]

    @property
    def samples_path(self) -> Path:
        return self.folder / "samples.h5"

    @property
    def motion_path(self) -> Path:
        return self.folder / "motion.npz"

    def surrogate_path(self, structure: str) -> Path:
        return self.folder / f"{structure}.h5"

    def samples(self) -> Samples:
        """The drawn samples; raises ValueError if they belong to another scene."""
        samples = read_samples(self.samples_path)
        if samples.scene.digest != self.scene.digest:
            raise ValueError(
                f"{self.samples_path} holds samples of another scene than {self.scene.name} as it is now: "
                "choose another --out, or remove that folder"
            )
        return samples


def _completed(scene: Scene, path: Path) -> Scene:
    """The scene with its sensitive pose parameters: those found before, else found now on the settle grid."""
    if path.is_file():
        before = load_scene(path)
        if before.digest == scene.with_sensitive_pose(before.sensitive_pose).digest:
            return before
    model = ElasticFoundation(scene, scene.grids.get("settle"))
    completed = scene.with_sensitive_pose(found_sensitive_pose(model, reference_motion_cycles(scene, ())))
    with replacing(path) as beside:
        beside.write_text(completed.to_toml(), "utf-8")
    return completed


def sample(
    project: Project,
    cycle_files: Sequence[Path] = (),
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
    models: ModelPair = elastic_foundations,
) -> tuple[Samples, ReferenceReport]:
    """Estimate the poses of the reference cycles and draw the samples, or go on where an earlier run stopped.

    cycle_files: measured cycles (§3.3); the built-in reference motion if empty. models: as in `draw_samples`, for
    another contact model than the elastic foundation.
    """
    cycles = reference_motion_cycles(project.scene, cycle_files)
    settings = SamplingSettings.from_scene(project.scene, scale=project.preset.sampling_scale)
    motion, report = reference_motion(models(project.scene, settings)[0], cycles, settings)
    samples = draw_samples(
        project.scene,
        motion,
        project.samples_path,
        settings=settings,
        executor=executor,
        models=models,
        progress=progress,
    )
    inputs, names = np.array(motion.point.inputs), np.array(report.names)
    with replacing(project.motion_path) as beside, beside.open("wb") as file:
        np.savez(file, inputs=inputs, cycles=names, curves=motion.curves, poses=motion.poses)
    return samples, report


def take_table(project: Project, table: Path) -> Samples:
    """Make the samples file from a table of samples (`dataset.read_table`) instead of drawing them.

    Raises ValueError for a table that cannot serve, or a folder that holds other samples.
    """
    samples = read_table(table, project.scene)
    if project.samples_path.is_file():
        there = project.samples().provenance.get("table_digest")
        if there != samples.provenance["table_digest"]:
            raise ValueError(f"{project.samples_path} was not made from {table}: choose another --out")
    write_samples(project.samples_path, samples)
    return samples


def reference_motion_cycles(scene: Scene, cycle_files: Sequence[Path]) -> list[LoadCycle] | list[JointCycle]:
    """The cycles in the files, or the built-in ones: the scene's own [motion], for a knee without one its walking."""
    if scene.motion or not {"Fy_med", "Fy_lat"} <= set(scene.load_names):
        return [read_joint_cycle(path, scene) for path in cycle_files] or scene_cycles(scene)
    return [read_cycle(path) for path in cycle_files] or reference_cycles()


def read_motion(project: Project) -> tuple[ReferenceMotion, list[str]]:
    """The reference motion that the samples were drawn around, and the names of its cycles."""
    try:
        with np.load(project.motion_path, allow_pickle=False) as content:
            point = SamplePoint.of_inputs([str(name) for name in content["inputs"]])
            cycles = [str(name) for name in content["cycles"]]
            return ReferenceMotion(point, content["curves"], content["poses"]), cycles
    except FileNotFoundError:
        raise FileNotFoundError(f"{project.motion_path} does not exist: run casadi-contact sample first") from None
    except (ValueError, KeyError, OSError) as error:
        raise ValueError(f"{project.motion_path} is damaged ({error}): remove it and sample again") from None


def _has_motion(project: Project) -> bool:
    """False where the samples come from a table."""
    return project.motion_path.is_file() or "table" not in project.samples().provenance


def _at_most(regression: Regression, rows: int | None, seed: int) -> Regression:
    """A random subset of a regression's rows (§3.5 fits a random subset of the samples)."""
    if rows is None or len(regression.targets) <= rows:
        return regression
    kept = np.sort(np.random.default_rng(seed).choice(len(regression.targets), rows, replace=False))
    columns = {name: getattr(regression, name)[kept] for name in ("inputs", "targets", "weights", "validation")}
    return replace(regression, **columns)


def fitting_structures(project: Project) -> list[str]:
    """The preset's structures that can stand for the scene's loads."""
    return [name for name in project.preset.efforts if STRUCTURES[name].fits(project.scene)]


def train(project: Project, update: Update | None = None, executor: Executor | None = None) -> list[Path]:
    """Train the preset's structures side by side on all cores, and write a surrogate file for each.

    Goes on from checkpoints where an earlier run stopped.
    """
    samples = project.samples()
    command = f"casadi-contact build {project.scene.name} --preset {project.preset_name}"
    paths = []
    for structure in fitting_structures(project):
        efforts = project.preset.efforts[structure]
        folder, path = project.folder / "training" / structure, project.surrogate_path(structure)
        with worker_pool(executor) as workers:
            surrogate = fit_surrogate(project, samples, structure, efforts, folder, command, structure, update, workers)
        calibrated(surrogate, samples).save(path)
        paths.append(path)
    return paths


def fit_surrogate(
    project: Project,
    samples: Samples,
    structure: str,
    efforts: Mapping[str, Effort],
    checkpoints: Path,
    command: str,
    title: str,
    update: Update | None = None,
    executor: Executor | None = None,
    loads: Sequence[str] | None = None,
) -> Surrogate:
    """A surrogate of one structure, its networks fitted side by side, with a record of how it was made.

    efforts: by the start of a network's name (see `Preset`). checkpoints: folder that a later call goes on from.
    command: what a reader of the record runs to make it again. loads: fit only the networks that these need.
    update is called as (title and network, seconds used, seconds allotted, remark).
    """
    kind = STRUCTURES[structure]
    needed = None if loads is None else kind.networks_for(project.scene, loads)
    regressions, settings = [], {}
    for regression in kind.regressions(samples):
        if needed is not None and regression.name not in needed:
            continue
        effort = effort_for(efforts, regression.name)
        wanted = replace(regression, tolerance=effort.tolerance_share * regression.tolerance)
        regressions.append(_at_most(wanted, effort.max_rows, seed=0))
        settings[regression.name] = TrainingSettings(
            sizes=effort.sizes, activation=effort.activation, max_time_s=effort.seconds
        )

    def progress(name: str, used: float, allotted: float, rms: float, hidden: Any) -> None:
        if update is not None:
            update(f"{title} {name}", used, allotted, f"{size_text(hidden)} RMS {rms:.3g}")

    fits = fit_all(regressions, settings, executor, checkpoints, progress)
    for name, fit in fits.items():
        if update is not None:
            allotted = settings[name].max_time_s
            update(
                f"{title} {name}", allotted, allotted, f"{size_text(fit.hidden)} RMS {fit.rms:.3g}, {fit.stop_reason}"
            )
    networks = {name: fit.network for name, fit in fits.items()}
    return kind(project.scene, networks, _record(project, samples, kind(project.scene, networks), fits, command))


def size_text(hidden: Sequence[int]) -> str:
    """Neurons per hidden layer as people write them: "12-12"."""
    return "-".join(map(str, hidden))


def _record(
    project: Project, samples: Samples, surrogate: Surrogate, fits: dict[str, Any], command: str
) -> dict[str, Any]:
    """What the surrogate's file says of how it was made (see `surrogate.info`)."""
    return {
        **samples_record(samples),
        "training_errors": {name: fit.rms for name, fit in fits.items()},
        "test_errors": domain_errors(surrogate, samples),
        "command": command,
        "reference_cycles": read_motion(project)[1] if _has_motion(project) else [],
        "stop_reasons": {name: fit.stop_reason for name, fit in fits.items()},
        "seconds": {name: round(fit.seconds, 1) for name, fit in fits.items()},
        "machine": machine_record(),
    }


def trained(project: Project) -> dict[str, Surrogate]:
    """The surrogates in the project's folder by structure; raises FileNotFoundError if there is none."""
    paths = {s: project.surrogate_path(s) for s in STRUCTURES if project.surrogate_path(s).is_file()}
    if not paths:
        raise FileNotFoundError(f"no surrogate in {project.folder}: run casadi-contact train first")
    return {structure: load_surrogate(path) for structure, path in paths.items()}


def calibrate(project: Project) -> list[Path]:
    """Give the project's surrogates validity and expected error anew, from its samples; `train` does so too."""
    samples = project.samples()
    for structure, surrogate in trained(project).items():
        calibrated(surrogate, samples).save(project.surrogate_path(structure))
    return [project.surrogate_path(structure) for structure in trained(project)]


def evaluate(project: Project) -> Path:
    """Write ``evaluation.json`` (Tables 2 to 4) and ``evaluation.csv`` (the domain errors); return the first's path."""
    motion = read_motion(project)[0] if _has_motion(project) else None
    content = evaluate_models(trained(project), project.samples(), motion)
    path = project.folder / "evaluation.json"

    with replacing(project.folder / "evaluation.csv") as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("model", "domain", "load", "rms", "max", "mean"))
        for model, domains in content["domain_errors"].items():
            for domain, errors in domains.items():
                for load, error in errors.items():
                    writer.writerow((model, domain, load, error["rms"], error["max"], error["mean"]))
    with replacing(path) as beside:
        beside.write_text(json.dumps(content, indent=1), "utf-8")
    return path


def export(project: Project, *, kernel_only: bool = False) -> list[Path]:
    """Write each surrogate as a ``.casadi`` file and as a C kernel with header and example, or as the kernel alone."""
    written = []
    poses = read_motion(project)[0].poses[0] if _has_motion(project) else project.samples().poses
    for structure, surrogate in trained(project).items():
        folder = project.folder / "export" / structure
        writable_folder(folder)
        if not kernel_only:
            path = folder / f"{project.scene.name}.casadi"
            save_function(surrogate.function(), path)
            written.append(path)
        written += surrogate.export_c(folder, example_pose=list(poses[len(poses) // 4]))
    return written
