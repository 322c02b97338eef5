"""Commands that make scenes, assemblies and cycles, and that look at models."""

from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.cli import pipeline
from casadi_contact.cli.options import (
    DEFAULT_PRESET,
    Force,
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
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.terminal import numbers, progress_bars
from casadi_contact.geometry.mesh import MM_PER_UNIT
from casadi_contact.pictures.contact_picture import (
    contact_pose,
    draw_contact,
    draw_fit,
    loads_text,
    pressures_text,
    surface_fits,
)
from casadi_contact.pictures.joint_page import joint_page
from casadi_contact.scenes.cycle import cycle_from_curves, write_cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.opensim import SIDES, TIME, ColumnMap, femur_in_insert, mapped_curves, read_opensim_table
from casadi_contact.scenes.pose_file import poses_from_curves, read_poses, write_poses
from casadi_contact.scenes.shapes.checks import scene_name
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.benchmark.choose import choose as choose_model
from casadi_contact.workflow.benchmark.front_file import read_front
from casadi_contact.workflow.benchmark.measure import measure_project
from casadi_contact.workflow.opensim_import.importing import import_model
from casadi_contact.workflow.project import Project
from casadi_contact.workflow.proposal.joint_geometry import JOINTS
from casadi_contact.workflow.proposal.propose import propose
from casadi_contact.workflow.proposal.tables import MATERIALS, scene_text


def name_of_mesh(mesh: Path) -> str:
    """A scene's name made of a mesh file's; raises ValueError, which names --out, where it cannot be one."""
    try:
        return scene_name("_".join(mesh.stem.split()))
    except ValueError as error:
        raise ValueError(f"the scene cannot be named after {mesh.name} ({error}): name it with --out") from None


def scene(
    moving: Annotated[Path, typer.Argument(help="mesh of the moving body: STL, OBJ, PLY, VTP, VTK or OFF")],
    fixed: Annotated[Path, typer.Argument(help="mesh of the fixed body, which carries the elements")],
    side: Annotated[str | None, typer.Option(help=f"of the body: {' or '.join(SIDES)}")] = None,
    joint: Annotated[str | None, typer.Option(help=f"{', '.join(JOINTS)}; recognised if left out")] = None,
    axes: Annotated[
        str | None,
        typer.Option(
            help="file axes that are posterior, superior, medial (left: lateral), as -x,y,-z; recognised if left out"
        ),
    ] = None,
    material: Annotated[str | None, typer.Option(help=f"{' or '.join(MATERIALS)}; guessed if left out")] = None,
    units: Annotated[
        str | None, typer.Option(help=f"of both files: {', '.join(MM_PER_UNIT)}; mm or m, by size, if left out")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="scene file; the fixed mesh's name and .toml if left out")] = None,
    force: Force = False,
) -> None:
    """Propose a scene for two mesh files, try it, and write it with a picture of what was recognised."""
    options = {"side": (side, SIDES), "joint": (joint, JOINTS), "material": (material, MATERIALS)}
    for option, (value, allowed) in {**options, "units": (units, MM_PER_UNIT)}.items():
        if value is not None and value not in tuple(allowed):
            raise ValueError(f"--{option} is {value!r}, expected {' or '.join(allowed)}")
    path = Path(f"{name_of_mesh(fixed)}.toml") if out is None else out
    if path.suffix != ".toml":
        raise ValueError(f"--out is {path}, expected a scene file, for example my.toml")
    name, picture = scene_name(path.stem), path.with_suffix(".png")
    _check_free([path, picture], force)
    with progress_bars(console, cure="nothing is written") as progress:
        given = {"name": name, "side": side, "kind": joint, "material": material, "units": units}
        along = None if axes is None else [axis.strip() for axis in axes.split(",")]
        proposal = propose(moving, fixed, **given, axes=along, progress=progress)  # type: ignore[arg-type]
    remarks = ["Proposed from two meshes:", *str(proposal).splitlines()]
    write_text(path, scene_text(proposal.scene, remarks, path.parent))
    draw_contact(ElasticFoundation(load_scene(path)), proposal.rest_pose[None], picture)
    say(proposal, f"scene in {path}, picture in {picture}")


def import_(
    model: Annotated[Path, typer.Argument(help="an OpenSim or JAM model, .osim")],
    out: Annotated[Path, typer.Option(help="folder of the assembly")],
    joint: Annotated[str | None, typer.Option(help="whose first coordinate moves; left out: of most contacts")] = None,
    geometry: Annotated[
        list[Path] | None, typer.Option(help="folder with contact meshes, once per folder; last the model's")
    ] = None,
    motion: Annotated[
        Path | None,
        typer.Option(help=".sto or .mot of states to fit paths about; the joint's passive motion if left out"),
    ] = None,
    force: Force = False,
) -> None:
    """Turn an OpenSim or JAM model into an assembly for cc.load_assembly: one function of all coordinates.

    Needs the extra opensim. Lists by name what of the model is lost."""
    _check_free([out / "assembly.toml"], force)
    with progress_bars(console) as update:
        say(import_model(model, out, joint=joint, geometry=geometry or (), motion=motion, progress=update))
    say(f"assembly in {out}")


import_.__name__ = "import"


def cycle(
    file: Annotated[Path, typer.Argument(help="an OpenSim .mot or .sto file")],
    maps: Annotated[list[str], typer.Option("--map", help="COLUMN=NAME:UNIT, as knee_angle_r=-rz:deg; once a curve")],
    out: Annotated[Path | None, typer.Option(help="CSV file to write; else cycle.csv or poses.csv, here")] = None,
    scene: Annotated[str | None, typer.Option(help="scene (name or file) of the cycle; a knee's if left out")] = None,
    tibia_in_femur: Annotated[
        str | None, typer.Option(help=f"{' or '.join(SIDES)}: tx to rz are OpenSim's knee coordinates")
    ] = None,
) -> None:
    """Turn columns of an OpenSim file into a load cycle, for --cycles and the problems: rz, ry, Fy_med, Fy_lat, and
    cop_ap or Tz, cop_ml or Tx; of another joint's --scene the pose parameters that were measured and a load for each
    other one; or into poses, for show --poses: tx, ty, tz, rx, ry, rz. With --tibia-in-femur these are knee_tx,
    knee_ty, knee_tz, knee_add, knee_rot, knee_flex, and come out as poses of the femur in the insert."""
    own = None if scene is None else load_scene(scene)
    table = read_opensim_table(file)
    try:
        curves = mapped_curves(table, [ColumnMap.parse(text) for text in maps])
        are_poses = set(curves) <= {TIME, *POSE_NAMES}
        if tibia_in_femur is not None:
            turned = dict(zip(POSE_NAMES, femur_in_insert(poses_from_curves(curves), tibia_in_femur).T, strict=True))
            loads = {name: curve for name, curve in curves.items() if name not in turned}
            curves = loads | (turned if are_poses else {name: turned[name] for name in ("rz", "ry")})
        path = out or Path("poses.csv" if are_poses else "cycle.csv")
        if are_poses:
            write_poses(curves[TIME], poses_from_curves(curves), path)
        else:
            write_cycle(cycle_from_curves(path.stem, curves, own), path)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    count = len(curves[TIME])
    say(f"{count} poses in {path}" if are_poses else f"cycle of {count} frames in {path}")


def _check_free(paths: list[Path], force: bool) -> None:
    """Raises, before minutes of work, ValueError for files that would be replaced and OSError for no right to write."""
    if not force and (existing := [str(path) for path in paths if path.exists()]):
        raise ValueError(f"{' and '.join(existing)} would be replaced: give another --out, or --force")
    writable_folder(paths[0].parent)


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
        Path | None, typer.Option(help="CSV, .sto or .mot of poses to scrub through; else a reference cycle")
    ] = None,
    surrogate: Annotated[
        str | None, typer.Option(help="a ready surrogate or the path of a .h5 file; the scene's shipped one else")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="page to write; SCENE.html if left out")] = None,
) -> None:
    """Write the joint as one offline HTML file: sliders, loads, pressures, settling (extra "page", a minute)."""
    path = Path(f"{load_scene(scene).name}.html") if out is None else out
    check_html(path)
    writable_folder(path.parent)
    html, cycle = joint_page(scene, None if poses is None else str(poses), surrogate)
    write_text(path, html)
    size = path.stat().st_size / 1e6
    say(cycle.source, f"page of {size:.2f} MB in {path}")


def chart(scene: SceneOrSurrogate, preset: PresetName = DEFAULT_PRESET, out: Out = None) -> None:
    """Train a ladder of sizes, measure speed and accuracy of everything in one run, and draw the charts."""
    project = Project.open(scene, preset, out)
    with progress_bars(console) as update:
        paths = pipeline.chart(project, update=update, tell=partial(update, "measuring", 0, 1))
    say(*(f"written {path}" for path in paths))


def speed(scene: SceneOrSurrogate, preset: PresetName = DEFAULT_PRESET, out: Out = None) -> None:
    """Measure surrogates, shipped ones where nothing has been built, foundation and elements: a chart, untrained."""
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
    """Name the cheapest measured model that meets a tolerance, by the chart that was built, shipped, or made now."""
    names = None if loads is None else [name.strip() for name in loads.split(",")]
    wanted = {"force_tolerance_n": force_tol, "torque_tolerance_nmm": torque_tol}
    with progress_bars(console) as update:
        tell = partial(update, "measuring", 0, 1)
        choice = choose_model(scene, **wanted, loads=names, preset=preset, folder=out, tell=tell)
    console.print(choice_table(choice))
    say(choice.measured)
    say(f"in Python: {choice.python}")
    if choice.path is None:
        asked = {"force-tol": force_tol, "torque-tol": torque_tol}
        options = (f"--{name} {value:g}" for name, value in asked.items() if value)
        say(f"a network of just this accuracy, which may be faster: casadi-contact build {scene} {' '.join(options)}")
