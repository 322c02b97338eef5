"""``casadi-contact scene``: from two mesh files to a scene file, and a picture of what was understood."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.cli.arguments import console
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.terminal import progress_bars
from casadi_contact.geometry.mesh import MM_PER_UNIT
from casadi_contact.pictures.scene_picture import draw_scene
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.shapes.checks import scene_name
from casadi_contact.workflow.proposal.joint import JOINTS
from casadi_contact.workflow.proposal.propose import propose
from casadi_contact.workflow.proposal.tables import MATERIALS
from casadi_contact.workflow.proposal.text import proposal_lines, scene_text

SIDES = ("right", "left")


def name_of_mesh(mesh: Path) -> str:
    """A scene's name made of a mesh file's; a ValueError says --out where it cannot be one."""
    try:
        return scene_name("_".join(mesh.stem.split()))
    except ValueError as error:
        raise ValueError(f"the scene cannot be named after {mesh.name} ({error}): name it with --out") from None


def scene(
    moving: Annotated[Path, typer.Argument(help="mesh of the moving body: STL, OBJ, PLY or VTP")],
    fixed: Annotated[Path, typer.Argument(help="mesh of the fixed body, which carries the elements")],
    side: Annotated[str | None, typer.Option(help=f"of the body: {' or '.join(SIDES)}")] = None,
    joint: Annotated[str | None, typer.Option(help=f"{', '.join(JOINTS)}; found if left out")] = None,
    axes: Annotated[
        str | None,
        typer.Option(
            help="file axes that are posterior, superior, medial (left: lateral), as -x,y,-z; found if left out"
        ),
    ] = None,
    material: Annotated[str | None, typer.Option(help=f"{' or '.join(MATERIALS)}; guessed if left out")] = None,
    units: Annotated[
        str | None, typer.Option(help=f"of both files: {', '.join(MM_PER_UNIT)}; mm or m, by size, if left out")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="scene file; the fixed mesh's name and .toml if left out")] = None,
    force: Annotated[bool, typer.Option("--force", help="replace a scene file that is there")] = False,
) -> None:
    """Propose a scene for two mesh files, try it, and write it with a picture of what was understood."""
    given = {"side": (side, SIDES), "joint": (joint, JOINTS), "material": (material, MATERIALS)}
    for option, (value, allowed) in {**given, "units": (units, MM_PER_UNIT)}.items():
        if value is not None and value not in tuple(allowed):
            raise ValueError(f"--{option} is {value!r}, expected {' or '.join(allowed)}")
    path = Path(f"{name_of_mesh(fixed)}.toml") if out is None else out
    if path.suffix != ".toml":
        raise ValueError(f"--out is {path}, expected a scene file, for example my.toml")
    named: Sequence[str] | None = None if axes is None else [axis.strip() for axis in axes.split(",")]
    name = scene_name(path.stem)
    picture = path.with_suffix(".png")
    if not force and (there := [str(each) for each in (path, picture) if each.exists()]):
        raise ValueError(f"{' and '.join(there)} would be replaced: give another --out, or --force")
    writable_folder(path.parent)  # before minutes of trying
    known = {"side": side, "kind": joint, "material": material, "units": units}
    with progress_bars(console, cure="nothing is written") as progress:
        proposal = propose(moving, fixed, name=name, axes=named, progress=progress, **known)
    write_text(path, scene_text(proposal, path.parent))
    written = load_scene(path)
    draw_scene(ElasticFoundation(written), proposal.rest_pose, proposal.poses, picture)
    console.print(*proposal_lines(proposal), sep="\n", highlight=False, soft_wrap=True)
    console.print(f"scene in {path}, picture in {picture}", highlight=False, soft_wrap=True)
