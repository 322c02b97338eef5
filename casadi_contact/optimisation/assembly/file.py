"""Assemblies as TOML files: bodies, contacts by their scenes, ligaments, pulls and springs.

format = 1
name = "my_joint"
ground = "tibia"
[bodies.femur]
pose = [0.0, 28.0, 0.0, 0.0, 0.0, 0.0]               # start, in the ground
[contacts.tibiofemoral]
scene = "knee"                                       # ready scene, or scene .toml beside this file
fixed = "tibia"
moving = "femur"                                     # fixed_frame, moving_frame: where the scene's frames lie;
                                                     # change = {thickness = 9.0}: other parameters of the scene
[ligaments.mcl]
bodies = ["femur", "tibia"]
points_mm = [[0.0, 0.0, 40.0], [0.0, -40.0, 30.0]]
stiffness_n = 2750.0                                 # per unit of strain
slack_length_mm = 78.0
[pulls.quadriceps]                                   # bodies and points_mm
[springs.soft_tissue]                                # body, stiffness and rest (6 each)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.choice import foundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.symbolic import SymbolicContact, symbolic
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import toml_tables, toml_text
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.connections import Contact, Ligament, Pull, Spring
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import fail, number, plain_values, scene_name, table_of

FORMAT = 1
_FRAMES = ("fixed_frame", "moving_frame")
_PACKAGE = "casadi_contact.optimisation.assembly"


def ready_assemblies() -> list[str]:
    """Names of the assemblies that come with the library."""
    folder = resources.files(_PACKAGE) / "ready"
    return sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml"))


def load_assembly(name_or_path: str | Path, contact: Callable[[Scene], ContactModel] | None = None) -> Assembly:
    """Load a ready assembly by name, or an assembly file by its path.

    contact: makes the contact model of a scene, whose loads hold the whole wrench, `symbolic` where it has no CasADi
    functions of its own; `joint_foundation` if left out.
    Raises ValueError for an unknown name, key or value, FileNotFoundError for a missing file.
    """
    path = Path(name_or_path)
    if str(name_or_path).endswith(".toml"):
        text = toml_text(path, "assembly")
    elif str(name_or_path) in ready_assemblies():
        text = (resources.files(_PACKAGE) / "ready" / f"{name_or_path}.toml").read_text("utf-8")
    else:
        possible = ", ".join(ready_assemblies())
        raise ValueError(
            f"unknown assembly {str(name_or_path)!r}, expected one of {possible}, or a path to a .toml file"
        )
    tables = toml_tables(text, str(name_or_path))
    try:
        return _assembly(tables, path.parent, contact or joint_foundation)
    except ValueError as error:  # of checks that are a scene's too
        raise ValueError(f"{name_or_path}: {str(error).removeprefix('scene: ')}") from None


def joint_foundation(scene: Scene) -> SymbolicContact:
    """The scene's `foundation`, with 16 rays at least where it is polar: equilibrium needs second derivatives, and
    those of 16 rays are exact to 1e-6 of the largest (of 8 rays to 5e-6)."""
    model, rays = foundation(scene), Rays(16, 3)
    few = isinstance(model, PolarFoundation) and model.rays.count < rays.count
    return PolarFoundation(scene, rays) if few else model


def _assembly(tables: Mapping[str, Any], folder: Path, contact: Callable[[Scene], ContactModel]) -> Assembly:
    plain_values("", tables)
    kinds = ("contacts", "ligaments", "pulls", "springs")
    given = table_of("assembly", tables, ("format", "name", "ground", "bodies"), complete=True, optional=kinds)
    if given["format"] != FORMAT:
        raise fail("format", given["format"], f"{FORMAT} (this version reads assembly format {FORMAT})")
    contacts, ligaments, pulls, springs = (_tables(kind, given.get(kind, {})) for kind in kinds)
    bodies = _tables("bodies", given["bodies"])
    return Assembly(
        name=scene_name(given["name"]),
        ground=str(given["ground"]),
        start={name: _body_pose(f"bodies.{name}", table) for name, table in bodies.items()},
        contacts=[_contact(name, table, folder, contact) for name, table in contacts.items()],
        ligaments=[_ligament(name, table) for name, table in ligaments.items()],
        pulls=[_pull(name, table) for name, table in pulls.items()],
        springs=[_spring(name, table) for name, table in springs.items()],
    )


def _tables(key: str, value: object) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise fail(key, value, "a table of tables")
    return dict(value)


def _body_pose(key: str, table: object) -> Array:
    return _numbers(f"{key}.pose", table_of(key, table, ("pose",), complete=True)["pose"], 6)


def _contact(name: str, table: object, folder: Path, contact: Callable[[Scene], ContactModel]) -> Contact:
    key = f"contacts.{name}"
    given = table_of(key, table, ("scene", "fixed", "moving"), complete=True, optional=(*_FRAMES, "change"))
    scene, change = str(given["scene"]), given.get("change", {})
    if not isinstance(change, Mapping):
        raise fail(f"{key}.change", change, "a table of the scene's parameters")
    try:
        found = load_scene(folder / scene if scene.endswith(".toml") else scene, **change)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None
    frames = {frame: _numbers(f"{key}.{frame}", given[frame], 6) for frame in _FRAMES if frame in given}
    return Contact(name, symbolic(contact(whole_wrench(found))), str(given["fixed"]), str(given["moving"]), **frames)


def _line(name: str, key: str, given: Mapping[str, Any]) -> tuple[str, tuple[str, str], tuple[Array, Array]]:
    """Name, bodies and points of a line."""
    bodies, points = given["bodies"], given["points_mm"]
    for part, value in (("bodies", bodies), ("points_mm", points)):
        if not isinstance(value, list) or len(value) != 2:
            raise fail(f"{key}.{part}", value, "two, one of each end")
    first, second = (_numbers(f"{key}.points_mm", point, 3) for point in points)
    return name, (str(bodies[0]), str(bodies[1])), (first, second)


def _ligament(name: str, table: object) -> Ligament:
    key = f"ligaments.{name}"
    given = table_of(key, table, ("bodies", "points_mm", "stiffness_n", "slack_length_mm"), complete=True)
    stiffness, slack = (number(f"{key}.{size}", given[size], low=0.0) for size in ("stiffness_n", "slack_length_mm"))
    return Ligament(*_line(name, key, given), stiffness, slack)


def _pull(name: str, table: object) -> Pull:
    key = f"pulls.{name}"
    return Pull(*_line(name, key, table_of(key, table, ("bodies", "points_mm"), complete=True)))


def _spring(name: str, table: object) -> Spring:
    key = f"springs.{name}"
    given = table_of(key, table, ("body", "stiffness", "rest"), complete=True)
    stiffness, rest = (_numbers(f"{key}.{part}", given[part], 6) for part in ("stiffness", "rest"))
    return Spring(name, str(given["body"]), stiffness, rest)


def _numbers(key: str, value: object, count: int) -> Array:
    if not isinstance(value, list) or len(value) != count:
        raise fail(key, value, f"{count} numbers")
    return np.array([number(key, part) for part in value])
