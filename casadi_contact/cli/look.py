"""What a surrogate or a scene is: ``info``, ``report``, ``show``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.cli.arguments import SceneName, SurrogateName, check_html, console
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import numbers
from casadi_contact.optimisation.verification.fitness import fitness
from casadi_contact.pictures.contact_picture import draw_contact, loads_text, pressures_text
from casadi_contact.pictures.contact_pose import contact_pose
from casadi_contact.pictures.fit_picture import draw_fit, surface_fits
from casadi_contact.pictures.report.surrogate_page import write_report
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.pose_file import read_poses
from casadi_contact.surrogate.load import load_surrogate


def info(surrogate: SurrogateName) -> None:
    """Say what a surrogate was trained on and how wrong it is."""
    console.print(str(load_surrogate(surrogate).info()), highlight=False, markup=False, soft_wrap=True)


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
    write_report({loaded.title: loaded}, folder, path)
    console.print(str(fitness(loaded)), f"report in {path}", sep="\n", highlight=False, markup=False, soft_wrap=True)


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
    console.print(f"picture{at} in {path}", highlight=False, soft_wrap=True)
    if len(shown) == 1:
        console.print(pressures_text(model, shown[0]), highlight=False, soft_wrap=True)
    if fits := surface_fits(model):
        fit_path = path.with_stem(f"{path.stem}_fit")
        draw_fit(model, fit_path)
        console.print(*fits, f"picture of the fit in {fit_path}", sep="\n", highlight=False, soft_wrap=True)
