"""From a scene to exported surrogates: ``build``, and its stages one by one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.cli import pipeline
from casadi_contact.cli.options import (
    DEFAULT_PRESET,
    Cycles,
    ModelName,
    MoreCycles,
    Out,
    PresetName,
    PresetOrNone,
    SceneName,
    SceneOrSurrogate,
    Table,
    console,
    say,
    say_shipped,
)
from casadi_contact.cli.tables import evaluation_tables, front_table
from casadi_contact.core.files.writing import folder_lock
from casadi_contact.core.quantities import quantity
from casadi_contact.core.terminal import progress_bars
from casadi_contact.workflow import stages as sampling
from casadi_contact.workflow.benchmark.front_file import FILE_NAME, read_front
from casadi_contact.workflow.project import Project, project_surrogates
from casadi_contact.workflow.tolerance import scene_to_tolerance, train_to_tolerance


def build(
    scene: SceneName,
    preset: PresetOrNone = None,
    cycles: Cycles = None,
    more_cycles: MoreCycles = None,
    table: Table = None,
    model: ModelName = "elements",
    out: Out = None,
    force_tol: Annotated[
        float | None,
        typer.Option(help="largest RMS error of every force in every domain [N]: samples and sizes follow it"),
    ] = None,
    torque_tol: Annotated[float | None, typer.Option(help="largest RMS error of every torque [N·mm], likewise")] = None,
    on: Annotated[
        str | None, typer.Option(help="foundation: learn what it misses, without networks, from 30 samples or more")
    ] = None,
) -> None:
    """Sample, train, evaluate and export; run again after an interruption to go on.

    Of an assembly's folder, as import writes it, each contact is built around motions: --cycles, .sto or .mot."""
    if on not in (None, "foundation"):
        raise ValueError(f"got --on {on}, expected foundation")
    files, to_tolerance = [*(cycles or []), *(more_cycles or [])], force_tol is not None or torque_tol is not None
    pipeline.check_single_source(table, files, model)
    if (Path(scene) / "assembly.toml").is_file():
        if table is not None or model != "elements" or to_tolerance or on is not None:
            raise ValueError(f"{scene} is an assembly: expected --preset, --cycles and --out alone")
        with progress_bars(console) as update:
            built = pipeline.build_contacts(scene, files, preset or DEFAULT_PRESET, folder=out, progress=update)
        return say(*(f"{name}: {surrogate.info().fitness}" for name, surrogate in built.items()))
    if to_tolerance:
        refused: dict[str, object] = {"--preset": preset, "--table": table, "--on": on}
        project = _project_to_tolerance(scene, out, refused, force_tol, torque_tol)
    else:
        project = Project.open(scene, preset or DEFAULT_PRESET, out)
    with folder_lock(project.folder):
        stages: dict[str, Callable[[], None]] = {"samples": lambda: _sample(project, files, table, model)}
        if on is not None:
            stages |= {"what the foundation misses": lambda: _fit_on_foundation(project)}
        else:
            if to_tolerance:
                stages = {"samples and training": lambda: _train_to_tolerance(project, files, model)}
            else:
                stages |= {"training": lambda: _train(project)}
            stages |= {
                "evaluation": lambda: _evaluate(project),
                "export": lambda: _export(project),
                "report": lambda: _report(project),
            }
        for number, (stage, run) in enumerate(stages.items(), start=1):
            say(f"stage {number} of {len(stages)}: {stage}")
            run()


def _project_to_tolerance(
    scene: str, out: Path | None, refused: dict[str, object], force_tol: float | None, torque_tol: float | None
) -> Project:
    """The project of a build whose scene has these tolerances [N, N·mm]; ValueError for a refused option."""
    for option, value in refused.items():
        if value is not None:
            raise ValueError(f"got {option} {value} and a tolerance, expected one: the tolerance decides")
    names = [f"{tol:.15g}{unit}" for tol, unit in ((force_tol, "N"), (torque_tol, "Nmm")) if tol is not None]
    folder = Path("results") / "-".join([Path(scene).stem, *names]) if out is None else out
    project = Project.open(scene, DEFAULT_PRESET, folder)
    return replace(project, scene=scene_to_tolerance(project.scene, force_tol, torque_tol))


def sample(
    scene: SceneName,
    preset: PresetName = DEFAULT_PRESET,
    cycles: Cycles = None,
    more_cycles: MoreCycles = None,
    table: Table = None,
    model: ModelName = "elements",
    out: Out = None,
) -> None:
    """Draw samples of the contact model in domains D1 to D7."""
    files = [*(cycles or []), *(more_cycles or [])]
    pipeline.check_single_source(table, files, model)
    project = Project.open(scene, preset, out)
    _sample(project, files, table, model)


def train(
    scene: SceneName,
    preset: PresetName = DEFAULT_PRESET,
    structure: Annotated[str | None, typer.Option(help="only this structure; all of the preset if left out")] = None,
    out: Out = None,
) -> None:
    """Train the preset's networks on the samples."""
    project = Project.open(scene, preset, out)
    _train(project, structure)


def calibrate(scene: SceneName, preset: PresetName = DEFAULT_PRESET, out: Out = None) -> None:
    """Give trained surrogates validity and expected error anew, from the project's samples (train does so too)."""
    project = Project.open(scene, preset, out)
    with progress_bars(console, cure="what is calibrated so far is kept, the rest is as it was") as update:
        paths = pipeline.calibrate(project, update)
    say(*(f"calibrated {path}" for path in paths))


def evaluate(scene: SceneOrSurrogate, preset: PresetName = DEFAULT_PRESET, out: Out = None) -> None:
    """Print and write the errors per domain and the speed on unseen poses of the scene's motion."""
    _evaluate(Project.open(scene, preset, out))


def export(
    scene: SceneOrSurrogate,
    preset: PresetName = DEFAULT_PRESET,
    out: Out = None,
    fmu: Annotated[
        bool, typer.Option("--fmu", help="a functional mock-up unit (FMI 3.0) for other simulators, instead of C")
    ] = False,
    foundation: Annotated[
        bool, typer.Option("--foundation", help="the contact model that needs no training, instead of surrogates")
    ] = False,
) -> None:
    """Write CasADi files and C kernels with an example, or FMUs; of shipped surrogates where nothing has been built."""
    _export(Project.open(scene, preset, out), fmu=fmu, contact_model=foundation)


def _sample(project: Project, cycle_files: list[Path], table: Path | None, model: str) -> None:
    if table is not None:
        samples = pipeline.take_table(project, table)
        say(f"{len(samples)} samples of {table} in {project.samples_path}")
        return
    with progress_bars(console) as update:
        samples, report = sampling.sample(project, cycle_files, update, model=model)
    say(report)
    for domain, share in samples.dropped_shares().items():
        if listed := samples.dropped_reasons(domain):
            say(f"{domain}: {share:.1%} of the plan dropped: {listed}")
    for domain, reason in samples.provenance.get("left_out", {}).items():
        say(f"{domain} left out: {reason}")
    say(f"{len(samples)} samples in {project.samples_path}")


def _train_to_tolerance(project: Project, files: list[Path], model: str) -> None:
    with progress_bars(console) as update:
        train_to_tolerance(project, files, update, model=model)


def _train(project: Project, structure: str | None = None) -> None:
    with progress_bars(console) as update:
        paths = pipeline.train(project, update, structure=structure)
    say(*(f"surrogate in {path}" for path in paths))


def _fit_on_foundation(project: Project) -> None:
    path, errors = pipeline.fit_on_foundation(project)
    lines = (f"{n}: RMS {error:.3g} {quantity(n).unit} on the samples held back" for n, error in errors.items())
    say(*lines, f"surrogate in {path}: cc.OnFoundation.load")


def _evaluate(project: Project) -> None:
    errors = pipeline.evaluate(project)
    for table in evaluation_tables(errors, project.samples()):
        console.print(table)
    if (front := project.folder / FILE_NAME).is_file():
        console.print(front_table(read_front(front)))
    say(f"evaluation in {project.folder / 'evaluation.csv'}")


def _report(project: Project) -> None:
    path = pipeline.report(project)
    found = project_surrogates(project).items()
    say(*(f"{structure}: {surrogate.info().fitness}" for structure, surrogate in found), f"report in {path}")


def _export(project: Project, *, fmu: bool = False, contact_model: bool = False) -> None:
    if not contact_model:
        say_shipped(project, "exporting")
    say(*(f"exported {path}" for path in pipeline.export(project, fmu=fmu, contact_model=contact_model)))
