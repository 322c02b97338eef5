"""The stages from a scene to a surrogate, each restarting alone from the files of the one before it.

cycles -> motion.npz, samples.h5 -> training/ -> patch.h5, two_stage.h5 -> evaluation.csv -> export/, report.html
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.contact.choice import foundation
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Update
from casadi_contact.core.files.writing import folder_lock, writable_folder, write_text
from casadi_contact.core.workers import worker_pool
from casadi_contact.export.c_source import export_c
from casadi_contact.export.fmu import export_fmu
from casadi_contact.optimisation.assembly.file import load_assembly
from casadi_contact.pictures.charts import draw_speed_accuracy, save
from casadi_contact.pictures.contact_picture import contact_pose
from casadi_contact.pictures.surrogate_page import surrogate_page
from casadi_contact.samples.models import model_name_of, teacher_of
from casadi_contact.samples.samples import TEST, LoadErrors, load_errors, read_samples
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.opensim import TIME, read_opensim_table
from casadi_contact.scenes.pose_file import write_poses
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import calibrate as calibrated
from casadi_contact.surrogate.on_foundation import OnFoundation
from casadi_contact.workflow.benchmark.candidates import refuse_without_elements, train_sizes
from casadi_contact.workflow.benchmark.front_file import FILE_NAME, read_front, shipped_front
from casadi_contact.workflow.benchmark.measure import Peers, measure_project
from casadi_contact.workflow.benchmark.measure import evaluate as evaluate_models
from casadi_contact.workflow.opensim_import.importing import states_of
from casadi_contact.workflow.project import (
    Project,
    available_poses,
    available_surrogates,
    exclusive,
    project_surrogates,
    read_motion,
)
from casadi_contact.workflow.proposal.propose import motion_tolerances
from casadi_contact.workflow.stages import check_single_source, sample, take_table, train

_EXAMPLE_FRAME = 25  # a quarter of the first cycle: in contact


def build(
    scene: str | Path | Scene,
    preset: str = "quick",
    *,
    cycles: Sequence[str | Path] = (),
    table: str | Path | None = None,
    model: ContactModel | str = "elements",
    folder: str | Path | None = None,
    progress: Update | None = None,
    executor: Executor | None = None,
) -> dict[str, Surrogate]:
    """Sample, train, evaluate and export, as ``casadi-contact build`` does, going on where an earlier call stopped;
    return the surrogates by structure.

    scene: itself, a ready name or the path of a file. cycles: measured cycles to sample around. table: samples of any
    contact model, instead of drawing them. model: what samples are drawn from, a name as in the command, or a contact
    model of the same scene, in this process. folder: of all results, results/SCENE-PRESET if left out. progress: called
    as (what, done, all, remark). Raises ValueError for input that cannot be used, OSError for a folder in use."""
    check_single_source(table, cycles, model)
    project = Project.open(scene, preset, None if folder is None else Path(folder))
    with folder_lock(project.folder):
        if table is not None:
            take_table(project, Path(table))
        else:
            sample(project, [Path(path) for path in cycles], progress, executor, model)
        train(project, progress, executor, teacher=None if isinstance(model, str) else model)
        evaluate(project)
        export(project)
        report(project)
    return project_surrogates(project)


def build_contacts(
    assembly: str | Path,
    motions: Sequence[str | Path],
    preset: str = "quick",
    *,
    folder: str | Path | None = None,
    progress: Update | None = None,
    executor: Executor | None = None,
) -> dict[str, Surrogate]:
    """Build a surrogate of each contact of an assembly (its folder) that touches along motions, which are OpenSim's
    files of coordinates. It learns the contact's own model around the poses of the motions, with tolerances of 0.5 % of
    the peak of each load. Returns surrogates by contact. Each lies in a subfolder, named as the contact, of ``folder``
    (results/ASSEMBLY-PRESET if left out), which `project.trained_in` reads. progress, executor, errors: as of `build`,
    and ValueError where nothing touches."""
    loaded, found = load_assembly(assembly), dict[str, Surrogate]()
    function, tables = loaded.function(["contact_poses"]), [read_opensim_table(path) for path in motions]
    if not tables:
        raise ValueError(f"got no motion of {assembly}, expected files of its coordinates: --cycles values.sto")
    moved = [function.map(len(t))(states_of(loaded, t).T, 0.0, 0.0, 0.0).full() for t in tables]
    out = Path("results") / f"{Path(assembly).resolve().name}-{preset}" if folder is None else Path(folder)
    for k, part in enumerate(loaded.contacts):
        poses = [each[:, k :: len(loaded.contacts)].T for each in moved]
        together = np.concatenate(poses)
        if not part.model(together).any():
            continue
        scene = part.model.scene.with_tolerances(**motion_tolerances(part.model, together, 0.005))
        writable_folder(here := out / part.name)
        files = [here / f"motion_{number}.csv" for number in range(1, len(poses) + 1)]
        for file, table, each in zip(files, tables, poses, strict=True):
            write_poses(table.columns[TIME], each, file)
        made = build(scene, preset, cycles=files, model=part.model, folder=here, progress=progress, executor=executor)
        found[part.name] = made["patch"]
    if not found:
        raise ValueError(f"no contact of {assembly} touches along {', '.join(map(str, motions))}")
    return found


@exclusive
def calibrate(project: Project, update: Update | None = None) -> list[Path]:
    """Give the project's surrogates validity and expected error anew, from its samples; `train` does so too.

    Raises ValueError for surrogates of a user's own contact model, calibrated on that model itself."""
    samples = project.samples()
    model = teacher_of(samples)
    surrogates = project_surrogates(project)
    for structure, surrogate in surrogates.items():
        if model is None and "around" in surrogate.record.get("coverage", {}):
            raise ValueError(f"{structure} was calibrated on a contact model that is not here: build again with it")
    with worker_pool() as workers:
        for structure, surrogate in surrogates.items():
            made = calibrated(surrogate, samples, model, update, executor=workers)
            made.save(project.surrogate_path(structure))
    return [project.surrogate_path(structure) for structure in surrogates]


@exclusive
def fit_on_foundation(project: Project) -> tuple[Path, dict[str, float]]:
    """Learn what the scene's foundation misses of the project's samples; returns the file, ``on_foundation.h5``, and
    the RMS error of each load on the samples held back."""
    samples, path = project.samples(), project.folder / "on_foundation.h5"
    model, held = OnFoundation.fit(samples), samples.select(role=TEST)
    errors = load_errors(model.load_names, model(held.poses), held.loads(model.load_names))
    model.record["test_errors"] = {load: error["rms"] for load, error in errors.items()}
    model.save(path)
    return path, model.record["test_errors"]


@exclusive
def evaluate(project: Project) -> dict[str, dict[str, LoadErrors]]:
    """Errors by model, domain and load, also written to ``evaluation.csv`` (Tables 2 and 3); where the samples are of
    the library's models, also ``speed_accuracy.csv`` (Table 4), which `cc.choose` reads."""
    samples = project.samples()
    found = evaluate_models(project_surrogates(project), samples)
    rows = [
        (model, domain, load, error["rms"], error["max"], error["mean"])
        for model, domains in found.items()
        for domain, errors in domains.items()
        for load, error in errors.items()
    ]
    columns = zip(("model", "domain", "load", "rms", "max", "mean"), map(list, zip(*rows, strict=True)), strict=True)
    write_columns(project.folder / "evaluation.csv", dict(columns))
    if model_name_of(samples) is not None:
        measure_project(project)
    return found


@exclusive
def export(project: Project, *, fmu: bool = False, contact_model: bool = False) -> list[Path]:
    """Write each surrogate, the scene's shipped ones where nothing has been built, as a ``.casadi`` file and as a C
    kernel with header and example; fmu: as FMU instead. contact_model: `cc.foundation` instead of surrogates."""
    folder, stem = project.folder / "export", project.scene.name
    models: dict[str, Surrogate | CompiledFoundation]
    if contact_model:
        models = {"foundation": foundation(project.scene)}
        pose = list(contact_pose(ElasticFoundation(project.scene, project.scene.grids.get("settle"))))
    else:
        models = {**available_surrogates(project)}
        pose = list(available_poses(project)[: _EXAMPLE_FRAME + 1][-1])
    written = []
    for kind, model in models.items():
        writable_folder(folder / kind)
        if fmu:
            written.append(export_fmu(model, folder / kind / f"{stem}.fmu", start=pose))
            continue
        if isinstance(model, Surrogate):
            path = folder / kind / f"{stem}.casadi"
            file = ca.StringSerializer()  # casadi.Function.load reads what it writes
            file.pack(model.function(compiled=False))
            write_text(path, file.encode())
            written.append(path)
        written += export_c(model, folder / kind, example_pose=pose)
    return written


def report(project: Project) -> Path:
    """Write ``report.html``: what the project's surrogates are fit for, and how wrong they are; return its path."""
    return write_report(project_surrogates(project), project.folder, project.folder / "report.html")


def write_report(surrogates: Mapping[str, Surrogate], folder: Path, path: Path) -> Path:
    """Write `surrogate_page` of surrogates, with the samples and the chart of their scene that lie in a folder, or the
    chart shipped for it; return the page's path."""
    scene = next(iter(surrogates.values())).scene
    samples = read_samples(folder / "samples.h5") if (folder / "samples.h5").is_file() else None
    if samples is not None and samples.scene.digest != scene.digest:
        samples = None
    chart, shipped = folder / FILE_NAME, shipped_front(scene)
    front = read_front(chart) if chart.is_file() else (shipped[1] if shipped else None)
    if front is not None and front.header["scene_digest"] != scene.digest:
        front = None
    write_text(path, surrogate_page(surrogates, samples, front))
    return path


@exclusive
def chart(
    project: Project,
    *,
    peers: Peers | None = None,
    update: Update | None = None,
    tell: Callable[[str], None] | None = None,
) -> list[Path]:
    """Train the sizes of the project's chart, measure them beside all else and draw it; return all paths, the table's
    first. Raises FileNotFoundError without samples, ValueError for samples of a table."""
    refuse_without_elements(project)
    read_motion(project)  # refuses samples of a table, before an hour of training
    train_sizes(project, update=update)
    path = measure_project(project, peers=peers, tell=tell)
    return [path, *save(draw_speed_accuracy(read_front(path)), project.folder, "speed_accuracy")]
