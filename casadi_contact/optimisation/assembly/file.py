"""Assemblies as TOML files: bodies on joints or free, contacts by their scenes, ligaments, muscles.

format = 1
name = "my_joint"
ground = "tibia"
[bodies.femur]                                       # pose: of a free body in the ground at rest, whose coordinates are
pose = [0.0, 28.0, 0.0, 0.0, 0.0, 0.0]               # femur_tx ... femur_rz; mass_kg, centre_mm, inertia_kgmm2 (xx yy
                                                     # zz xy xz yz)
[contacts.tibiofemoral]
scene = "knee"                                       # ready scene, or scene .toml beside this file
fixed = "tibia"
moving = "femur"                                     # fixed_frame, moving_frame: where the scene's frames lie;
                                                     # change = {thickness = 9.0}: other parameters of the scene;
                                                     # cells_mm: side of its cells, else they are chosen
[ligaments.mcl]                                      # two points or more
bodies = ["femur", "tibia"]
points_mm = [[0.0, 0.0, 40.0], [0.0, -40.0, 30.0]]
stiffness_n = 2750.0                                 # per unit of strain; toe_strain, damping_n_s;
slack_length_mm = 78.0                               # wrap = {body, points}: inputs of its network, or with frame,
                                                     # radius_mm and side of a cylinder, `paths.Roll`
[muscles.quadriceps]                                 # bodies, points_mm, wrap, and the fields of `paths.Muscle`
[coordinate_springs.soft_tissue]                     # of, stiffness, rest, viscosity, in OpenSim's units

What `casadi-contact import` writes besides (mm, rad, N, kg, s, and names as in OpenSim):

gravity_m_s2 = [0.0, -9.80665, 0.0]
paths = "paths.h5"                                   # networks of wraps by path, muscles' curves by name
[coordinates.knee_flex_r]                            # kind, default, low, high; in OpenSim's order
[joints.knee_r]                                      # parent, child, parent_frame, child_frame,
                                                     # rotations and translations: {axis, of, offset, slope} or
                                                     # {axis, of, knots}, each knot x, y and dy/dx
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from casadi_contact.contact.cells.choice import CellChoice
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.ray_cast import RayCastFoundation
from casadi_contact.contact.symbolic import SymbolicContact, symbolic
from casadi_contact.core.files.containers import new_hdf5, open_hdf5
from casadi_contact.core.files.reading import toml_tables, toml_text
from casadi_contact.core.files.writing import write_text
from casadi_contact.networks.network import Network, read_network, write_network
from casadi_contact.optimisation.assembly.assembly import Assembly, Contact, CoordinateSpring
from casadi_contact.optimisation.assembly.joints import Axis, Body, Coordinate, Joint, free_joint
from casadi_contact.optimisation.assembly.paths import Bundle, Muscle, MuscleCurves, Roll, Wrap
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import fail, identifier, number, plain_values, scene_name, table_of

FORMAT = 1
_PACKAGE = "casadi_contact.optimisation.assembly"
_NAMES = ("bodies", "body", "fixed", "moving", "kind", "parent", "child", "of", "curves")
MakeContact = Callable[[Scene], ContactModel | None]


def ready_assemblies() -> list[str]:
    """Names of the assemblies that come with the library."""
    folder = resources.files(_PACKAGE) / "ready"
    return sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml"))


def load_assembly(name_or_path: str | Path, contact: MakeContact | None = None) -> Assembly:
    """Load a ready assembly by name, or an assembly file by its path or its folder's.

    contact: makes the contact model of a scene, whose loads hold the whole wrench, `symbolic` where it has no CasADi
    functions of its own; where it is left out or gives None, cells as the file says, or `joint_foundation`.
    Raises ValueError for an unknown name, key or value, FileNotFoundError for a missing file.
    """
    path = Path(name_or_path)
    path = path / "assembly.toml" if (path / "assembly.toml").is_file() else path
    if path.suffix == ".toml":
        text = toml_text(path, "assembly")
    elif str(name_or_path) in ready_assemblies():
        text = (resources.files(_PACKAGE) / "ready" / f"{name_or_path}.toml").read_text("utf-8")
    else:
        possible = ", ".join(ready_assemblies())
        raise ValueError(f"unknown assembly {str(name_or_path)!r}, expected a .toml file or one of {possible}")
    tables = toml_tables(text, str(name_or_path))
    try:
        return _assembly(tables, path.parent, contact)
    except ValueError as error:  # of checks that are a scene's too
        raise ValueError(f"{name_or_path}: {str(error).removeprefix('scene: ')}") from None


def joint_foundation(scene: Scene) -> SymbolicContact:
    """The scene's `foundation`, with 16 rays at least where it is polar: equilibrium needs second derivatives, and
    those of 16 rays are exact to 1e-6 of the largest (of 8 rays to 5e-6)."""
    model, rays = foundation(scene), Rays(16, 3)
    few = isinstance(model, PolarFoundation) and model.rays.count < rays.count
    return PolarFoundation(scene, rays) if few else model


def ray_casting(scene: Scene) -> RayCastFoundation:
    """The scene on all its flat triangles, whichever way they face, as JAM evaluates it: for ``load_assembly(folder,
    contact=ray_casting)``."""
    geometry = {key: value for key, value in scene.tables["geometry"].items() if key != "pressing"}
    changed = {"geometry": {**geometry, "elements": "triangles"}, "friction": {}}
    return RayCastFoundation(Scene.from_tables({**scene.tables, **changed}))


def _assembly(tables: Mapping[str, Any], folder: Path, contact: MakeContact | None) -> Assembly:
    plain_values("", tables)
    kinds = ("coordinates", "joints", "contacts", "ligaments", "muscles", "coordinate_springs")
    optional = (*kinds, "gravity_m_s2", "paths")
    given = table_of("assembly", tables, ("format", "name", "ground", "bodies"), complete=True, optional=optional)
    if given["format"] != FORMAT:
        raise fail("format", given["format"], f"{FORMAT} (this version reads assembly format {FORMAT})")
    for kind in ("bodies", *kinds):
        if not isinstance(given.setdefault(kind, {}), Mapping):
            raise fail(kind, given[kind], "a table of tables")
    wraps, curves = read_paths(folder / Path(str(given["paths"])).name) if "paths" in given else ({}, {})
    ground, free = identifier("ground", given["ground"]), dict[str, Any]()
    for body, table in given["bodies"].items():
        if isinstance(table, Mapping) and "pose" in table:
            key = f"bodies.{identifier('body', body)}"
            free[body] = _numbers(f"{key}.pose", table["pose"])
            if np.shape(free[body]) != (6,):
                raise fail(f"{key}.pose", free[body], "six numbers, tx ty tz [mm] rx ry rz [rad]")
            given["bodies"][body] = {k: v for k, v in table.items() if k != "pose"}
    of_free = {body: free_joint(body, ground, pose) for body, pose in free.items()}

    def each(kind: str, make: type) -> list[Any]:
        """Objects of a kind of tables."""
        return [_object(f"{kind}.{name}", table, make, name, wraps) for name, table in given[kind].items()]

    return Assembly(
        name=scene_name(given["name"]),
        ground=ground,
        gravity_m_s2=np.array(_numbers("gravity_m_s2", given.get("gravity_m_s2", [0.0, 0.0, 0.0]))),
        coordinate_table=dict(zip(given["coordinates"], each("coordinates", Coordinate), strict=True))
        | {name: c for table, _ in of_free.values() for name, c in table.items()},
        bodies=dict(zip(given["bodies"], each("bodies", Body), strict=True)),
        joints=[*each("joints", Joint), *(joint for _, joint in of_free.values())],
        contacts=[_contact(name, table, folder, contact) for name, table in given["contacts"].items()],
        ligaments=each("ligaments", Bundle),
        muscles=each("muscles", Muscle),
        springs=each("coordinate_springs", CoordinateSpring),
        curves=curves,
    )


def _object(key: str, table: object, make: type, name: str = "", wraps: Mapping[str, Network] | None = None) -> Any:
    """An object of a class of a table with its fields, but for its name."""
    known = {f.name: f.default is MISSING and f.default_factory is MISSING for f in fields(make)}
    own = {"name": name} if known.pop("name", False) else {}
    needed, optional = (tuple(k for k, required in known.items() if required is want) for want in (True, False))
    values = table_of(key, table, needed, complete=True, optional=optional)
    for k, value in values.items():
        if k == "wrap":
            values[k] = _wrap(f"{key}.wrap", value, (wraps or {}).get(name))
        elif k in ("rotations", "translations"):
            values[k] = [_object(f"{key}.{k}", axis, Axis) for axis in value]
        elif k not in _NAMES:
            values[k] = _numbers(f"{key}.{k}", value)
    return make(**own, **values)


def _wrap(key: str, table: object, network: Network | None) -> Wrap | Roll:
    rolls = ("frame", "radius_mm", "side")
    given = table_of(key, table, ("body", "points"), complete=True, optional=rolls)
    body, points = str(given["body"]), [int(number(f"{key}.points", i)) for i in given["points"]]
    if "radius_mm" in given:
        frame, radius, side = (_numbers(f"{key}.{name}", given[name]) for name in rolls)
        return Roll(body, points, frame, radius, side)
    if network is None:
        raise ValueError(f"{key}: the path has neither a cylinder nor a network in the file of paths")
    return Wrap(body, points, network)


def write_assembly(
    folder: Path,
    tables: Mapping[str, Any],
    curves: Mapping[str, Mapping[str, Any]],
    wraps: Mapping[str, Network] | None = None,
) -> Assembly:
    """Write and load a folder: assembly.toml, and paths.h5 with muscles' curves and networks of paths that wrap."""
    with new_hdf5(folder / "paths.h5") as file:
        for name, network in (wraps or {}).items():
            write_network(file.create_group(f"wraps/{name}"), network)
        for name, curve in curves.items():
            for part in fields(MuscleCurves):
                file[f"curves/{name}/{part.name}"] = np.asarray(curve[part.name], dtype="<f8")
    write_text(folder / "assembly.toml", tomli_w.dumps(tables))
    return load_assembly(folder)


def read_paths(path: Path) -> tuple[dict[str, Network], dict[str, MuscleCurves]]:
    """Networks and curves of paths.h5; raises FileNotFoundError, and ValueError for a damaged file."""
    with open_hdf5(path) as file:
        wraps = {name: read_network(group) for name, group in file.get("wraps", {}).items()}
        curves = {
            name: MuscleCurves(**{part.name: group[part.name][()] for part in fields(MuscleCurves)})
            for name, group in file.get("curves", {}).items()
        }
        return wraps, curves


def _contact(name: str, table: object, folder: Path, contact: MakeContact | None) -> Contact:
    key, needed, frames = f"contacts.{name}", ("scene", "fixed", "moving"), ("fixed_frame", "moving_frame")
    given = table_of(key, table, needed, complete=True, optional=(*frames, "change", "cells_mm"))
    scene, change, cells = str(given.pop("scene")), given.pop("change", {}), given.pop("cells_mm", None)
    if not isinstance(change, Mapping):
        raise fail(f"{key}.change", change, "a table of the scene's parameters")
    try:
        found = load_scene(folder / scene if scene.endswith(".toml") else scene, **change)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None
    otherwise: Callable[[Scene], ContactModel] = joint_foundation
    if cells is not None:
        otherwise = partial(CellFoundation, cells=CellChoice().cells(*2 * (number(f"{key}.cells_mm", cells, low=0.1),)))
    whole = whole_wrench(found)
    model = (contact(whole) if contact else None) or otherwise(whole)
    placed = {k: _numbers(f"{key}.{k}", given[k]) for k in frames if k in given}
    return Contact(name, symbolic(model), given["fixed"], given["moving"], **placed)


def _numbers(key: str, value: object) -> Any:
    return [_numbers(key, part) for part in value] if isinstance(value, list) else number(key, value)
