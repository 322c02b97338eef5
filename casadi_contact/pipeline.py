"""The stages from a scene to a surrogate, each restarting alone from the files of the one before it.

cycles -> motion.npz, samples.h5 -> training/ -> patch.h5, two_stage.h5 -> evaluation.json -> export/, report.html
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from casadi_contact.benchmark import evaluate as evaluate_models
from casadi_contact.benchmark import measure_project
from casadi_contact.benchmark.front_file import read_front
from casadi_contact.contact import ContactModel, ElasticFoundation, foundation
from casadi_contact.contact.compiled import CompiledFoundation
from casadi_contact.dataset import Samples, read_sample_table, write_samples
from casadi_contact.dataset.gaps import refuse_missing_gaps, refuse_wrong_gaps
from casadi_contact.files import file_stem, folder_lock, replacing, writable_folder, write_npz, write_text
from casadi_contact.fitting import moved_samples, structures_for_scene, train
from casadi_contact.presets import PRESETS
from casadi_contact.project import (
    Project,
    Update,
    alone,
    has_motion,
    motion_at_hand,
    project_surrogates,
    read_motion,
    reference_motion_cycles,
    surrogates_at_hand,
    surrogates_made,
)
from casadi_contact.report import draw_charts, write_report
from casadi_contact.sampling import (
    ReferenceReport,
    SamplingSettings,
    draw_samples,
    elastic_foundations,
    model_name_of,
    model_pair,
    reference_motion,
    teacher_of,
)
from casadi_contact.sampling.chunk import WrenchModel
from casadi_contact.sampling.draw import ModelPair
from casadi_contact.sampling.drops import refuse_many_dropped
from casadi_contact.scenes import Scene
from casadi_contact.show import contact_pose
from casadi_contact.structures import Surrogate, with_trust
from casadi_contact.training.arrays import arrays_for
from casadi_contact.transcription import save_function

__all__ = [
    "PRESETS",
    "Project",
    "build",
    "calibrate",
    "chart",
    "check_table",
    "evaluate",
    "export",
    "read_motion",
    "report",
    "sample",
    "structures_for_scene",
    "take_table",
    "train",
]


class DrawnModel(ContactModel, WrenchModel, Protocol):
    """A contact model that samples can be drawn from."""


def build(
    scene: str | Path,
    preset: str = "quick",
    *,
    cycles: Sequence[str | Path] = (),
    table: str | Path | None = None,
    model: DrawnModel | str = "elements",
    folder: str | Path | None = None,
    progress: Update | None = None,
    executor: Executor | None = None,
    device: str = "cpu",
) -> dict[str, Surrogate]:
    """Sample, train, evaluate and export, as ``casadi-contact build`` does; return the surrogates by structure.

    scene: a ready name or the path of a scene file. cycles: measured cycles to sample around. table: samples of any
    contact model to learn from instead of drawing them (`dataset.read_sample_table`). model: what samples are drawn
    from, "elements" or "foundation" as in the command, or a contact model of the same scene, in this process. folder:
    of all results, results/SCENE-PRESET if left out. progress: called as (what, done, all, remark). device: "cpu", or a
    torch device ("cuda") that samples and trains in this process. Called again after an interruption it goes on where
    it stopped.

    Raises ValueError for input that cannot be used or a device that cannot be had, OSError for a folder that cannot be
    written or that another process works in.
    """
    check_table(table, cycles, model)
    project = Project.open(scene, preset, None if folder is None else Path(folder))
    with folder_lock(project.folder):
        if table is not None:
            take_table(project, Path(table))
        else:
            _draw(project, [Path(path) for path in cycles], model, progress, executor, device)
        train(project, progress, executor, device=device, teacher=None if isinstance(model, str) else model)
        evaluate(project)
        export(project)
        report(project)
    return project_surrogates(project)


def check_table(table: str | Path | None, cycles: Sequence[str | Path], model: DrawnModel | str) -> None:
    """ValueError for cycles or another model beside a table of samples: nothing is drawn then."""
    if table is not None and (cycles or model != "elements"):
        raise ValueError(f"got a table of samples and {'cycles' if cycles else 'a model'}, expected one of them")


def _draw(
    project: Project,
    cycles: Sequence[Path],
    model: DrawnModel | str,
    progress: Update | None,
    executor: Executor | None,
    device: str,
) -> None:
    """Draw the samples of the scene's elastic foundation, of another model by its name, or of a user's own."""

    def tell(done: int, total: int) -> None:
        if progress is not None:
            progress("samples", done, total, "")

    if isinstance(model, str):
        sample(project, cycles, tell, executor, model_pair(model), device)
        return
    if model.scene.digest != project.scene.digest:
        raise ValueError(f"the model stands for another scene than {project.scene.name}: make it for this one")

    with ThreadPoolExecutor(1) as here:  # a user's model may not reach worker processes
        sample(project, cycles, tell, here, models=_Given(model))


@dataclass(frozen=True)
class _Given:
    """A user's own model, to settle on and to evaluate samples on; samples are named after its class."""

    model: DrawnModel

    @property
    def stands_for(self) -> type:
        return type(self.model)

    def __call__(self, scene: Scene, settings: SamplingSettings) -> tuple[ContactModel, WrenchModel]:
        return self.model, self.model


@alone
def sample(
    project: Project,
    cycle_files: Sequence[Path] = (),
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
    models: ModelPair = elastic_foundations,
    device: str = "cpu",
) -> tuple[Samples, ReferenceReport]:
    """Estimate the poses of the reference cycles and draw the samples, or go on where an earlier run stopped.

    cycle_files: measured cycles (§3.3); the built-in reference motion if empty. models: as in `draw_samples`, for
    another contact model than the elastic foundation. device: a torch device evaluates the elastic foundation in this
    process; its samples are those of the processor to rounding, not to the last bit.

    Raises ValueError where more of a domain was dropped than the settings' ``most_dropped`` and for gaps of the wrong
    sign (the file is kept), and for a device that cannot be had, does not know the models, or has an executor beside
    it.
    """
    if device != "cpu":
        if executor is not None:
            raise ValueError(f"got device {device!r} and an executor, expected one of them")
        with ThreadPoolExecutor(1) as here:
            return sample(project, cycle_files, progress, here, _on_device(models, device))
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
    files = np.array([str(path) for path in cycle_files], dtype=str)
    content = {"inputs": inputs, "cycles": names, "files": files, "curves": motion.curves, "poses": motion.poses}
    write_npz(project.motion_path, **content)
    refuse_many_dropped(samples, settings.most_dropped)
    if model_name_of(samples) is None:
        refuse_wrong_gaps(samples, str(project.samples_path), "mend the contact model's gaps and delete that file")
    return samples, report


def _on_device(models: ModelPair, device: str) -> ModelPair:
    if models is not elastic_foundations:
        raise ValueError(f"got device {device!r} with another contact model, expected the elements' (--model elements)")
    arrays_for(device)
    from casadi_contact.bridges.torch_foundation import FoundationsOn  # imports torch

    return FoundationsOn(device)


@alone
def take_table(project: Project, table: Path) -> Samples:
    """Make the samples file from a table of samples (`dataset.read_sample_table`) instead of drawing them.

    Raises ValueError for a table that cannot serve the preset's structures, and for a folder in which other samples are
    drawn or learned already.
    """
    samples = read_sample_table(table, project.scene)
    if "patch" in project.preset.efforts or "trunk" in project.preset.efforts:
        refuse_missing_gaps(samples, str(table))
    if project.samples_path.is_file():
        there = project.samples().provenance
        learned = (project.folder / "training").exists() or surrogates_made(project)
        if there.get("table_digest") != samples.provenance["table_digest"] and (learned or "table" not in there):
            changed = f"was made from {table} as it was before" if there.get("table") == str(table) else "is of others"
            raise ValueError(f"{project.samples_path} {changed}: choose another --out, or remove that folder")
    write_samples(project.samples_path, samples)
    return samples


@alone
def calibrate(project: Project) -> list[Path]:
    """Give the project's surrogates validity and expected error anew, from its samples; `train` does so too.

    Raises ValueError for surrogates of a user's own contact model, calibrated on that model itself.
    """
    samples = project.samples()
    around, model = moved_samples(samples), teacher_of(samples)
    surrogates = project_surrogates(project)
    for structure, surrogate in surrogates.items():
        if around is None and "around" in surrogate.record.get("coverage", {}):
            raise ValueError(
                f"the {structure} surrogate was calibrated on the contact model that its samples come from, which is "
                "not here: build again with that model"
            )
    for structure, surrogate in surrogates.items():
        with_trust(surrogate, samples, around, model).save(project.surrogate_path(structure))
    return [project.surrogate_path(structure) for structure in surrogates]


@alone
def evaluate(project: Project) -> Path:
    """Write ``evaluation.json`` (Tables 2 to 4) and ``evaluation.csv`` (the domain errors); return the first's path."""
    motion = read_motion(project)[0] if has_motion(project) else None
    content = evaluate_models(project_surrogates(project), project.samples(), motion)
    path = project.folder / "evaluation.json"

    with replacing(project.folder / "evaluation.csv") as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("model", "domain", "load", "rms", "max", "mean"))
        for model, domains in content["domain_errors"].items():
            for domain, errors in domains.items():
                for load, error in errors.items():
                    writer.writerow((model, domain, load, error["rms"], error["max"], error["mean"]))
    write_text(path, json.dumps(content, indent=1))
    return path


@alone
def export(
    project: Project, *, kernel_only: bool = False, fmu: bool = False, contact_model: bool = False
) -> list[Path]:
    """Write each surrogate as a ``.casadi`` file and as a C kernel with header and example, or as the kernel alone.

    Where nothing has been built: the scene's shipped surrogates. fmu: a functional mock-up unit of each instead.
    contact_model: `contact.foundation` instead of surrogates, as C or as FMU.
    """
    folder, stem = project.folder / "export", file_stem(project.scene.name)
    models: dict[str, Surrogate | CompiledFoundation]
    if contact_model:
        models = {"foundation": foundation(project.scene)}
        pose = list(contact_pose(ElasticFoundation(project.scene, project.scene.grids.get("settle"))))
    else:
        models = {**surrogates_at_hand(project)}
        motion = not project.begun or has_motion(project)
        poses = motion_at_hand(project).poses[0] if motion else project.samples().poses
        pose = list(poses[len(poses) // 4])
    written = []
    for kind, model in models.items():
        writable_folder(folder / kind)
        if fmu:
            written.append(model.export_fmu(folder / kind / f"{stem}.fmu", start=pose))
            continue
        if isinstance(model, Surrogate) and not kernel_only:
            path = folder / kind / f"{stem}.casadi"
            save_function(model.function(), path)
            written.append(path)
        written += model.export_c(folder / kind, example_pose=pose)
    return written


def report(project: Project) -> Path:
    """Write ``report.html``: what the project's surrogates are fit for, and how wrong they are; return its path."""
    return write_report(project_surrogates(project), project.folder, project.folder / "report.html")


@alone
def chart(
    project: Project,
    *,
    peers: bool = False,
    update: Update | None = None,
    tell: Callable[[str], None] | None = None,
    executor: Executor | None = None,
) -> list[Path]:
    """Measure the project's chart (`benchmark.measure_project`) and draw it; return all paths, the table's first."""
    path = measure_project(project, peers=peers, update=update, tell=tell, executor=executor)
    return [path, *draw_charts(read_front(path), project.folder)]
