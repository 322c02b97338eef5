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

from casadi_contact.contact.choice import foundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.symbolic import SymbolicContact, symbolic
from casadi_contact.core.files.reading import toml_tables, toml_text
from casadi_contact.optimisation.assembly import Assembly
from casadi_contact.optimisation.assembly.connections import Contact, Ligament, Pull, Spring
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import fail, number, plain_values, scene_name, table_of

FORMAT = 1
_PACKAGE = "casadi_contact.optimisation.assembly"
_NAMES = ("bodies", "body", "fixed", "moving")
_PARTS: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "ligaments": (Ligament, ("bodies", "points_mm", "stiffness_n", "slack_length_mm")),
    "pulls": (Pull, ("bodies", "points_mm")),
    "springs": (Spring, ("body", "stiffness", "rest")),
}


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
        raise ValueError(f"unknown assembly {str(name_or_path)!r}, expected a .toml file or one of {possible}")
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
    kinds = ("contacts", *_PARTS)
    given = table_of("assembly", tables, ("format", "name", "ground", "bodies"), complete=True, optional=kinds)
    if given["format"] != FORMAT:
        raise fail("format", given["format"], f"{FORMAT} (this version reads assembly format {FORMAT})")
    for kind in ("bodies", *kinds):
        if not isinstance(given.setdefault(kind, {}), Mapping):
            raise fail(kind, given[kind], "a table of tables")
    return Assembly(
        name=scene_name(given["name"]),
        ground=str(given["ground"]),
        start={body: _values(f"bodies.{body}", table, ("pose",))["pose"] for body, table in given["bodies"].items()},
        contacts=[_contact(name, table, folder, contact) for name, table in given["contacts"].items()],
        **{
            kind: [make(name, **_values(f"{kind}.{name}", table, keys)) for name, table in given[kind].items()]
            for kind, (make, keys) in _PARTS.items()
        },
    )


def _contact(name: str, table: object, folder: Path, contact: Callable[[Scene], ContactModel]) -> Contact:
    key, needed, frames = f"contacts.{name}", ("scene", "fixed", "moving"), ("fixed_frame", "moving_frame")
    given = table_of(key, table, needed, complete=True, optional=(*frames, "change"))
    scene, change = str(given.pop("scene")), given.pop("change", {})
    if not isinstance(change, Mapping):
        raise fail(f"{key}.change", change, "a table of the scene's parameters")
    try:
        found = load_scene(folder / scene if scene.endswith(".toml") else scene, **change)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None
    return Contact(name, symbolic(contact(whole_wrench(found))), **_values(key, given, tuple(given)))


def _values(key: str, table: object, keys: tuple[str, ...]) -> dict[str, Any]:
    """A table's values by key: names of bodies as they are, all others as numbers."""
    given = table_of(key, table, keys, complete=True)
    return {k: v if k in _NAMES else _numbers(f"{key}.{k}", v) for k, v in given.items()}


def _numbers(key: str, value: object) -> Any:
    return [_numbers(key, part) for part in value] if isinstance(value, list) else number(key, value)
