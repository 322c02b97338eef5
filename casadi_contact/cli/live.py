"""A joint in a page: ``page``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.cli.arguments import SceneName, check_html, console
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.pictures.live.joint_page import write_joint_page
from casadi_contact.scenes.loading import load_scene


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
    cycle = write_joint_page(scene, path, None if poses is None else str(poses), surrogate)
    size = path.stat().st_size / 1e6
    console.print(cycle.source, f"page of {size:.2f} MB in {path}", sep="\n", highlight=False, soft_wrap=True)
