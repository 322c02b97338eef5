"""The command line, thin over `pipeline` and `benchmark`: ``casadi-contact build | sample | train | ...``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact import __version__, benchmark, pipeline
from casadi_contact.command_examples import examples
from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import POSE_NAMES
from casadi_contact.files import file_stem, folder_lock, short
from casadi_contact.motion.load_cycle import cycle_from_curves, write_cycle
from casadi_contact.motion.opensim import TIME, ColumnMap, mapped_curves, read_opensim_table
from casadi_contact.motion.pose_file import poses_from_curves, read_poses, write_poses
from casadi_contact.pipeline import PRESETS, Project
from casadi_contact.progress import progress_bars
from casadi_contact.project import project_surrogates
from casadi_contact.proposal.command import scene as propose_scene
from casadi_contact.report import (
    evaluation_tables,
    kernel_speed_tables,
    read_evaluation,
    read_kernel_speed,
    write_report,
)
from casadi_contact.report.choice_table import choice_table
from casadi_contact.sampling import MODELS, model_pair
from casadi_contact.sampling.drops import dropped_shares
from casadi_contact.scenes import load_scene, ready_scenes
from casadi_contact.show import contact_pose, draw_contact, draw_fit, loads_text, pressures_text, surface_fits
from casadi_contact.structures import load_surrogate
from casadi_contact.terminal import PlainConsole, printable
from casadi_contact.verification.fitness import fitness

app = typer.Typer(
    help="Surrogate models of deformable joint contact as CasADi functions.",
    epilog=examples(""),
    pretty_exceptions_enable=False,
)
console = PlainConsole()

SceneName = Annotated[str, typer.Argument(help=f"a ready scene ({', '.join(ready_scenes())}) or the path of a .toml")]
PresetName = Annotated[str, typer.Option(help=f"how much to sample and train: {', '.join(PRESETS)}")]
Cycles = Annotated[
    list[Path] | None, typer.Option(help="cycle files (CSV) of the reference motion; the built-in one if left out")
]
MoreCycles = Annotated[list[Path] | None, typer.Argument(help="further cycle files")]
Table = Annotated[
    Path | None, typer.Option(help="a table of samples (CSV, HDF5) of any contact model, instead of sampling")
]
ModelName = Annotated[
    str,
    typer.Option(help=f"contact model that samples are settled and evaluated on: {', '.join(MODELS)} (faster)"),
]
Out = Annotated[Path | None, typer.Option(help="folder of all results; results/SCENE-PRESET if left out")]


def _project(scene: str, preset: str, out: Path | None) -> Project:
    return Project.open(scene, preset, out)


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(f"casadi_contact {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and end")
    ] = False,
) -> None:
    """Options that come before a command."""


app.command("scene", epilog=examples("scene"))(propose_scene)


@app.command(epilog=examples("build"))
def build(
    scene: SceneName,
    preset: PresetName = "quick",
    cycles: Cycles = None,
    more_cycles: MoreCycles = None,
    table: Table = None,
    model: ModelName = "elements",
    out: Out = None,
) -> None:
    """Sample, train, evaluate and export; run again after an interruption to go on."""
    project = _project(scene, preset, out)
    with folder_lock(project.folder):
        _sample(project, [*(cycles or []), *(more_cycles or [])], table, model)
        _train(project)
        _evaluate(project)
        _export(project)
        _report(project)


@app.command(epilog=examples("sample"))
def sample(
    scene: SceneName,
    preset: PresetName = "quick",
    cycles: Cycles = None,
    more_cycles: MoreCycles = None,
    table: Table = None,
    model: ModelName = "elements",
    out: Out = None,
) -> None:
    """Draw samples of the elastic foundation in domains D1 to D7."""
    _sample(_project(scene, preset, out), [*(cycles or []), *(more_cycles or [])], table, model)


@app.command(epilog=examples("train"))
def train(
    scene: SceneName,
    preset: PresetName = "quick",
    structure: Annotated[str | None, typer.Option(help="only this structure; all of the preset if left out")] = None,
    out: Out = None,
) -> None:
    """Train the preset's networks on the samples."""
    _train(_project(scene, preset, out), structure)


@app.command(epilog=examples("calibrate"))
def calibrate(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Give trained surrogates validity and expected error anew, from the project's samples (train does so too)."""
    for path in pipeline.calibrate(_project(scene, preset, out)):
        console.print(f"calibrated {path}", highlight=False)


@app.command(epilog=examples("evaluate"))
def evaluate(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Print and write the errors per domain and the speed on an unseen walking sequence."""
    _evaluate(_project(scene, preset, out))


@app.command(epilog=examples("export"))
def export(
    scene: SceneName,
    preset: PresetName = "quick",
    out: Out = None,
    kernel: Annotated[bool, typer.Option("--kernel", help="the C kernel alone, without the CasADi file")] = False,
    fmu: Annotated[
        bool, typer.Option("--fmu", help="a functional mock-up unit (FMI 3.0) for other simulators, instead of C")
    ] = False,
    foundation: Annotated[
        bool, typer.Option("--foundation", help="the contact model that needs no training, instead of surrogates")
    ] = False,
) -> None:
    """Write CasADi files, and C kernels without dependencies, with an example; or FMUs.

    Where nothing has been built in the folder, the shipped surrogates of the scene are exported.
    """
    if kernel and (fmu or foundation):
        raise ValueError("got --kernel with --fmu or --foundation, which write no CasADi file: leave it out")
    _export(_project(scene, preset, out), kernel_only=kernel, fmu=fmu, contact_model=foundation)


@app.command(epilog=examples("chart"))
def chart(
    scene: SceneName,
    preset: PresetName = "quick",
    peers: Annotated[
        bool, typer.Option("--peers", help=r"measure the peers too (pip install casadi_contact\[peers])")
    ] = False,
    out: Out = None,
) -> None:
    """Train a ladder of sizes, measure speed and accuracy of everything in one run, and draw the charts."""
    project = _project(scene, preset, out)
    with progress_bars(console) as update:
        paths = pipeline.chart(project, peers=peers, update=update, tell=lambda what: update("measuring", 0, 1, what))
    for path in paths:
        console.print(f"written {path}", highlight=False)


@app.command(epilog=examples("speed"))
def speed(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Time compiled kernels against CasADi graphs, elastic foundations and the machine's limit.

    Where nothing has been built in the folder, the shipped surrogates of the scene are timed.
    """
    project = _project(scene, preset, out)
    _say_shipped(project, "timing")
    path = benchmark.speed(project)
    for table in kernel_speed_tables(read_kernel_speed(path)):
        console.print(table)
    console.print(f"times in {path}", highlight=False)


@app.command(epilog=examples("choose"))
def choose(
    scene: SceneName,
    force_tol: Annotated[float | None, typer.Option(help="RMS error wanted over the forces [N]")] = None,
    torque_tol: Annotated[float | None, typer.Option(help="RMS error wanted over the torques [N·mm]")] = None,
    loads: Annotated[str | None, typer.Option(help="only these, as Fy_med,Fy_lat; all if left out")] = None,
    preset: PresetName = "quick",
    out: Out = None,
) -> None:
    """Name the cheapest model of the chart that meets a tolerance, and train it if it is not on disk.

    Where nothing has been built in the folder, the answer comes from the chart shipped for the scene.
    """
    names = None if loads is None else [name.strip() for name in loads.split(",")]
    with progress_bars(console) as update:
        choice = benchmark.choose(
            scene,
            force_tolerance_n=force_tol,
            torque_tolerance_nmm=torque_tol,
            loads=names,
            preset=preset,
            folder=out,
            update=update,
        )
    console.print(choice_table(choice))
    console.print(choice.measured, highlight=False, markup=False, soft_wrap=True)
    console.print(f"in Python: {choice.python}", highlight=False, soft_wrap=True)


@app.command(epilog=examples("info"))
def info(surrogate: Annotated[str, typer.Argument(help="a ready surrogate (knee) or the path of a .h5 file")]) -> None:
    """Say what a surrogate was trained on and how wrong it is."""
    console.print(str(load_surrogate(surrogate).info()), highlight=False, markup=False, soft_wrap=True)


@app.command(epilog=examples("report"))
def report(
    surrogate: Annotated[str, typer.Argument(help="a ready surrogate (knee) or the path of a .h5 file")],
    out: Annotated[Path | None, typer.Option(help="page to write; report.html beside the file if left out")] = None,
) -> None:
    """Write one page (HTML) that says what a surrogate is fit for, where it was sampled and how wrong it is."""
    folder = Path(surrogate).parent
    loaded = load_surrogate(surrogate)
    path = write_report({loaded.title: loaded}, folder, folder / "report.html" if out is None else out)
    console.print(str(fitness(loaded)), f"report in {path}", sep="\n", highlight=False, markup=False, soft_wrap=True)


@app.command(epilog=examples("cycle"))
def cycle(
    file: Annotated[Path, typer.Argument(help="an OpenSim .mot or .sto file")],
    maps: Annotated[
        list[str], typer.Option("--map", help="COLUMN=NAME:UNIT, such as knee_angle_r=-rz:deg; once per curve")
    ],
    out: Annotated[
        Path | None, typer.Option(help="CSV file to write; cycle.csv or poses.csv in this folder if left out")
    ] = None,
) -> None:
    """Turn columns of an OpenSim file into a load cycle, for --cycles and the problems: rz, ry, Fy_med, Fy_lat, and
    cop_ap or Tz, cop_ml or Tx; or into poses, for show --poses: tx, ty, tz, rx, ry, rz.
    """
    table = read_opensim_table(file)
    try:
        curves = mapped_curves(table, [ColumnMap.parse(text) for text in maps])
        if set(curves) <= {TIME, *POSE_NAMES}:
            poses, path = poses_from_curves(curves), out or Path("poses.csv")
            write_poses(curves[TIME], poses, path)
            console.print(f"{len(poses)} poses in {path}", highlight=False)
            return
        path = out or Path("cycle.csv")
        written = cycle_from_curves(path.stem, curves)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    write_cycle(written, path)
    console.print(f"cycle of {len(written)} frames in {path}", highlight=False)


@app.command(epilog=examples("show"))
def show(
    scene: SceneName,
    pose: Annotated[
        str | None, typer.Option(help="tx,ty,tz,rx,ry,rz in mm and rad; 0.1 mm of overlap if left out")
    ] = None,
    poses: Annotated[
        Path | None, typer.Option(help="CSV, .sto or .mot of poses (tx ... rz): a strip of small pictures")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="picture file; SCENE.png if left out")] = None,
) -> None:
    """Draw the pressure on the fixed surface and the moving one in section, and how well smooth surfaces fit meshes."""
    model = ElasticFoundation(load_scene(scene))
    if pose is not None and poses is not None:
        raise ValueError("got both --pose and --poses, expected one of them")
    if poses is not None:
        shown = read_poses(poses)
    else:
        shown = np.array([contact_pose(model) if pose is None else _numbers(pose)])
    path = Path(f"{file_stem(model.scene.name)}.png") if out is None else out
    draw_contact(model, shown, path)
    at = f" at {loads_text(model, shown[0], model.load_names)}" if len(shown) == 1 else f" of {len(shown)} poses"
    console.print(f"picture{at} in {path}", highlight=False, soft_wrap=True)
    if len(shown) == 1:
        console.print(pressures_text(model, shown[0]), highlight=False, soft_wrap=True)
    if fits := surface_fits(model):
        fit_path = path.with_stem(f"{path.stem}_fit")
        draw_fit(model, fit_path)
        console.print(*fits, f"picture of the fit in {fit_path}", sep="\n", highlight=False, soft_wrap=True)


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--pose is {text!r}, expected six numbers tx,ty,tz,rx,ry,rz") from None


def _say_shipped(project: Project, doing: str) -> None:
    if not project.begun:
        console.print(f"nothing built in {project.folder}: {doing} the shipped surrogates", highlight=False)


def _sample(project: Project, cycle_files: list[Path], table: Path | None, model: str) -> None:
    if table is not None:
        if cycle_files:
            raise ValueError("got cycle files and a table of samples, expected one of them")
        samples = pipeline.take_table(project, table)
        console.print(f"{len(samples)} samples of {table} in {project.samples_path}", highlight=False)
        return
    with progress_bars(console) as update:
        samples, report = pipeline.sample(
            project,
            cycle_files,
            lambda done, total: update("samples", done, total, ""),
            models=model_pair(model),
        )
    if report is not None:
        console.print(str(report), highlight=False)
    for domain, share in dropped_shares(samples).items():
        reasons = samples.provenance["dropped"].get(domain, {})
        listed = "; ".join(f"{reason} ({count})" for reason, count in reasons.items())
        if listed:
            console.print(f"{domain}: {share:.1%} of the plan dropped: {listed}", highlight=False)
    for domain, reason in samples.provenance.get("left_out", {}).items():
        console.print(f"{domain} left out: {reason}", highlight=False)
    console.print(f"{len(samples)} samples in {project.samples_path}", highlight=False)


def _train(project: Project, structure: str | None = None) -> None:
    with progress_bars(console) as update:
        paths = pipeline.train(project, update, structure=structure)
    for path in paths:
        console.print(f"surrogate in {path}", highlight=False)


def _evaluate(project: Project) -> None:
    path = pipeline.evaluate(project)
    for table in evaluation_tables(read_evaluation(path)):
        console.print(table)
    console.print(f"evaluation in {path}", highlight=False)


def _report(project: Project) -> None:
    path = pipeline.report(project)
    for structure, surrogate in project_surrogates(project).items():
        console.print(f"{structure}: {fitness(surrogate)}", highlight=False, markup=False, soft_wrap=True)
    console.print(f"report in {path}", highlight=False)


def _export(project: Project, *, kernel_only: bool = False, fmu: bool = False, contact_model: bool = False) -> None:
    if not contact_model:
        _say_shipped(project, "exporting")
    for path in pipeline.export(project, kernel_only=kernel_only, fmu=fmu, contact_model=contact_model):
        console.print(f"exported {path}", highlight=False)


# An unknown command, option or value; typer does not export it, and where it comes from depends on typer's version.
_UsageError: type[Exception] = typer.BadParameter.__bases__[0]


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1, never a traceback."""
    arguments = sys.argv[1:] or ["--help"]
    try:
        sys.exit(app(arguments, standalone_mode=False))
    except typer.Abort:
        sys.exit(130)
    except _UsageError as error:
        said = error.format_message()  # type: ignore[attr-defined]
    except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
        said = str(error)
    sys.exit(f"casadi-contact: {printable(short(said, 2000))}")


if __name__ == "__main__":
    main()
