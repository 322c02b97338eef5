"""Commands that look at models: ``info``, ``report``, ``show``, ``page``, ``chart``, ``speed``, ``choose``."""

from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.cli import pipeline
from casadi_contact.cli.options import (
    DEFAULT_PRESET,
    Out,
    PresetName,
    SceneName,
    SceneOrSurrogate,
    SurrogateName,
    check_html,
    console,
    say,
    say_shipped,
)
from casadi_contact.cli.tables import choice_table, front_table
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.terminal import numbers, progress_bars
from casadi_contact.pictures.contact_picture import (
    contact_pose,
    draw_contact,
    draw_fit,
    loads_text,
    pressures_text,
    surface_fits,
)
from casadi_contact.pictures.joint_page import joint_page
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.pose_file import read_poses
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.benchmark.choose import choose as choose_model
from casadi_contact.workflow.benchmark.front_file import read_front
from casadi_contact.workflow.benchmark.measure import measure_project
from casadi_contact.workflow.project import Project


def info(surrogate: SurrogateName) -> None:
    """Say what a surrogate was trained on and how wrong it is."""
    say(load_surrogate(surrogate).info())


def report(
    surrogate: SurrogateName,
    out: Annotated[Path | None, typer.Option(help="page to write; report.html beside the file if left out")] = None,
) -> None:
    """Write one page (HTML) that says what a surrogate is fit for, where it was sampled and how wrong it is."""
    folder = Path(surrogate).parent
    loaded = load_surrogate(surrogate)
    path = folder / "report.html" if out is None else out
    check_html(path)
    writable_folder(path.parent)
    pipeline.write_report({loaded.title: loaded}, folder, path)
    say(loaded.info().fitness, f"report in {path}")


def show(
    scene: SceneName,
    pose: Annotated[
        str | None, typer.Option(help="tx,ty,tz,rx,ry,rz in mm and rad; 0.1 mm of overlap if left out")
    ] = None,
    poses: Annotated[
        Path | None, typer.Option(help="CSV, .sto or .mot of poses (tx ... rz): a strip of small pictures")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="picture file; SCENE_contact.png if left out")] = None,
) -> None:
    """Draw the pressure on the fixed surface and the moving one in section, and how well smooth surfaces fit meshes."""
    model = ElasticFoundation(load_scene(scene))
    if pose is not None and poses is not None:
        raise ValueError("got both --pose and --poses, expected one of them")
    if poses is not None:
        shown = read_poses(poses)
    else:
        expected = "six numbers tx,ty,tz,rx,ry,rz"
        shown = np.array([contact_pose(model) if pose is None else numbers(pose, "pose", expected)])
    path = Path(f"{model.scene.name}_contact.png") if out is None else out
    writable_folder(path.parent)
    draw_contact(model, shown, path)
    at = f" at {loads_text(model, shown[0], model.load_names)}" if len(shown) == 1 else f" of {len(shown)} poses"
    say(f"picture{at} in {path}")
    if len(shown) == 1:
        say(pressures_text(model, shown[0]))
    if fits := surface_fits(model):
        fit_path = path.with_stem(f"{path.stem}_fit")
        draw_fit(model, fit_path)
        say(*fits, f"picture of the fit in {fit_path}")


def page(
    scene: SceneName,
    poses: Annotated[
        Path | None,
        typer.Option(help="CSV, .sto or .mot of poses to scrub through; else a reference cycle"),
    ] = None,
    surrogate: Annotated[
        str | None, typer.Option(help="a ready surrogate or the path of a .h5 file; the scene's shipped one else")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="page to write; SCENE.html if left out")] = None,
) -> None:
    """Write the joint as one HTML file that moves: sliders, loads, pressures and settling, computed in the browser.

    It works offline, from a file. Compiling its kernel takes the extra "page" (ziglang), and a minute.
    """
    path = Path(f"{load_scene(scene).name}.html") if out is None else out
    check_html(path)
    writable_folder(path.parent)
    html, cycle = joint_page(scene, None if poses is None else str(poses), surrogate)
    write_text(path, html)
    size = path.stat().st_size / 1e6
    say(cycle.source, f"page of {size:.2f} MB in {path}")


def chart(
    scene: SceneOrSurrogate,
    preset: PresetName = DEFAULT_PRESET,
    out: Out = None,
) -> None:
    """Train a ladder of sizes, measure speed and accuracy of everything in one run, and draw the charts."""
    project = Project.open(scene, preset, out)
    with progress_bars(console) as update:
        paths = pipeline.chart(project, update=update, tell=partial(update, "measuring", 0, 1))
    for path in paths:
        say(f"written {path}")


def speed(scene: SceneOrSurrogate, preset: PresetName = DEFAULT_PRESET, out: Out = None) -> None:
    """Measure surrogates (compiled, and as CasADi graphs), foundation and elements: the chart, without training.

    Where nothing has been built in the folder, the shipped surrogates of the scene are timed.
    """
    project = Project.open(scene, preset, out)
    say_shipped(project, "timing")
    with progress_bars(console) as update:
        path = measure_project(project, tell=partial(update, "measuring", 0, 1))
    console.print(front_table(read_front(path)))
    say(f"times in {path}")


def choose(
    scene: SceneOrSurrogate,
    force_tol: Annotated[float | None, typer.Option(help="largest RMS error over the forces [N]")] = None,
    torque_tol: Annotated[float | None, typer.Option(help="largest RMS error over the torques [N·mm]")] = None,
    loads: Annotated[str | None, typer.Option(help="only these, as Fy_med,Fy_lat; all if left out")] = None,
    preset: PresetName = DEFAULT_PRESET,
    out: Out = None,
) -> None:
    """Name the cheapest measured model that meets a tolerance.

    Where nothing has been built in the folder, the answer comes from the chart shipped for the scene, or from measuring
    elements and foundation now.
    """
    names = None if loads is None else [name.strip() for name in loads.split(",")]
    wanted = {"force_tolerance_n": force_tol, "torque_tolerance_nmm": torque_tol}
    with progress_bars(console) as update:
        tell = partial(update, "measuring", 0, 1)
        choice = choose_model(scene, **wanted, loads=names, preset=preset, folder=out, tell=tell)
    console.print(choice_table(choice))
    say(choice.measured)
    say(f"in Python: {choice.python}")
    if choice.path is None:
        options = (
            f"--{name} {value:g}" for name, value in (("force-tol", force_tol), ("torque-tol", torque_tol)) if value
        )
        say(f"a network of just this accuracy, which may be faster: casadi-contact build {scene} {' '.join(options)}")
