"""The scene of two mesh files, proposed where there is none yet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from casadi_contact.cli.propose import name_of_mesh
from casadi_contact.cli.propose import scene as propose_scene
from casadi_contact.core.files.reading import existing_file
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.geometry.mesh import FORMATS
from casadi_contact.scenes.loading import load_scene


def is_mesh(path: Path) -> bool:
    """Whether a file is a mesh by its name."""
    return path.suffix.lower() in FORMATS


def fixed_and_cycles(moving: Path, given: Sequence[Path]) -> tuple[Path, list[Path]]:
    """The fixed body's mesh and the cycles that follow the moving one's; ValueError for anything else, and
    FileNotFoundError, before minutes of trying."""
    fixed, *cycles = given
    if not is_mesh(fixed) or not cycles:
        raise ValueError(
            f"got the mesh {moving} and {', '.join(map(str, given))}, expected the fixed body's mesh and measured "
            "cycles after it"
        )
    for mesh in (moving, fixed):
        existing_file(mesh, "mesh file")
    for cycle in cycles:
        existing_file(cycle, "cycle file")
    return fixed, cycles


def scene_of_meshes(moving: Path, fixed: Path, folder: Path) -> Path:
    """Scene file in the folder, proposed as ``casadi-contact scene`` does; one that is there is kept, edits and all.

    Raises ValueError where that one names other meshes, and where none can be proposed.
    """
    path = folder / f"{name_of_mesh(fixed)}.toml"
    if not path.exists():
        writable_folder(folder)
        propose_scene(moving, fixed, out=path)
        return path
    geometry = load_scene(path).geometry
    named = [Path(geometry.get(body, "")).resolve() for body in ("moving", "fixed")]
    if named != [moving.resolve(), fixed.resolve()]:
        raise ValueError(f"{path} is there and names other meshes ({', '.join(map(str, named))}): give another --out")
    typer.echo(f"scene {path} is there and kept; without it a new one is proposed")
    return path
