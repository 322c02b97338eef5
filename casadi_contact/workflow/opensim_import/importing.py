"""A model file becomes a folder that `cc.load_assembly` reads.

    my_knee/assembly.toml      bodies, joints, contacts, ligaments, muscles (see `optimisation.assembly.file`)
    my_knee/NAME.toml          a scene for each contact; meshes stay where they are, scaled ones are copied
    my_knee/paths.h5           what wrapping adds to lengths, and muscles' curves
    my_knee/import.txt         what was read, how exact paths are, and what is lost, by name

First the joint moves passively, with paths that do not wrap: its first coordinate goes through its range, the others
settle. About these states, or those of a given motion, lengths are sampled and wraps fitted.
"""

import re
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array, Update
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.networks.frames import pose_of
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.file import write_assembly
from casadi_contact.optimisation.assembly.joints import compose, frame
from casadi_contact.optimisation.assembly.paths import Wrap
from casadi_contact.optimisation.assembly.settling import CoordinateSettling
from casadi_contact.scenes.opensim import Table, read_opensim_table
from casadi_contact.workflow.opensim_import.contacts import body_of, write_scene
from casadi_contact.workflow.opensim_import.excess import described, fit_excesses
from casadi_contact.workflow.opensim_import.model_file import ModelFile, find_mesh, read_model
from casadi_contact.workflow.opensim_import.process import describe

CELLS_MM = 1.4
PASSIVE = np.linspace(0.0, 1.75, 22)  # rad from rest, either way, within the range of the joint's first coordinate
ACTIVATION = 0.02
FAR_LARGER = 2.0  # a mesh that bends out of sight, or reaches beyond the other's open edge, is not to cast rays


def import_model(
    model: str | Path,
    out: str | Path,
    *,
    joint: str | None = None,
    geometry: Sequence[str | Path] = (),
    motion: str | Path | None = None,
    progress: Update | None = None,
) -> str:
    """Read an OpenSim or JAM model file and write an assembly; returns what `import.txt` says.

    joint: whose first coordinate moves while the others of the joints in contact follow; that between the meshes of
    most contacts if left out. geometry: folders that hold the meshes, before the model's own. motion: a .sto or .mot
    file of coordinates, whose states take the place of the passive motion. Raises ImportError without the opensim wheel
    or the extra `mesh`, FileNotFoundError for a missing file, ValueError for a model that cannot be read.
    """
    model, out = Path(model), Path(out)
    source = read_model(model)
    writable_folder(out)
    with tempfile.TemporaryDirectory(prefix="casadi_contact_") as temporary:
        draft, bare = Path(temporary), Path(temporary) / "model.osim"
        write_text(bare, source.rest)
        said = describe(bare)
        tables, curves = said["tables"], said["curves"]
        if progress:
            progress("model", 1.0, 3.0, "scenes")
        lost = [*source.unmapped, *said["lost"]]
        assembly = write_assembly(draft, tables, curves)
        folders = [*map(Path, geometry), model.parent]
        tables["contacts"], of_contacts = _contacts(source, said["frames"], assembly, folders, out)
        lost += of_contacts
        assembly = write_assembly(draft, tables, curves)
        loose = replace(assembly, contacts=[of for of in assembly.contacts if assembly.ground not in of.bodies])
        moving, following = _coordinates(loose, joint)
        centres, how = _centres(loose, moving, following, motion)
        if progress:
            progress("model", 2.0, 3.0, "paths")
        about = [*moving, *following] if len(centres) > 1 else []  # else the whole ranges count
        excess = fit_excesses(assembly, str(bare), said["wraps"], centres, about, progress)
    for name, (wrap, _) in excess.items():
        kind = "ligaments" if name in tables["ligaments"] else "muscles"
        tables[kind][name]["wrap"] = {key: value for key, value in vars(wrap).items() if key != "network"}
    for table in tables["contacts"].values():
        table["scene"] = Path(table["scene"]).name
    networks = {name: wrap.network for name, (wrap, _) in excess.items() if isinstance(wrap, Wrap)}
    write_assembly(out, tables, curves, networks)
    kinds = ("bodies", "coordinates", "contacts", "ligaments", "muscles")
    counts = ", ".join(f"{len(tables[kind])} {kind}" for kind in kinds)
    exact = described({name: error for name, (_, error) in excess.items()}) if excess else []
    report = "\n".join([f"{model.name}: {counts}", how, *exact, *(f"lost: {each}" for each in lost)])
    write_text(out / "import.txt", f"{report}\n")
    return report


def _contacts(
    source: ModelFile, places: Mapping[str, Any], assembly: Assembly, folders: list[Path], out: Path
) -> tuple[dict[str, Any], list[str]]:
    """Write the scenes; the table of contacts, and what is lost."""
    tables, lost, bodies, frames = dict[str, Any](), list[str](), {}, {}
    for name, surface in source.surfaces.items():
        if name in {end for contact in source.contacts for end in (contact.target, contact.casting)}:
            if surface.frame not in places:
                raise ValueError(f"{name} lies in {surface.frame}, expected a frame of the model")
            bodies[name] = body_of(surface, partial(find_mesh, folders=folders), out)
            at, own = places[surface.frame], np.append(1e3 * np.array(surface.location), surface.orientation)
            place = compose(frame(at["pose"]), frame(own))
            if bodies[name].mesh is None:  # a half-space, whose outside is -x there, and y in a scene
                place = compose(place, frame(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5 * np.pi])))
            frames[name] = at["body"], pose_of(*place).full().ravel().tolist()
    areas = {name: body.mesh.areas_mm2.sum() for name, body in bodies.items() if body.mesh}
    for contact in source.contacts:
        if not contact.applied:
            lost.append(f"{contact.name}: it applies no force, so it is left out")
            continue
        name = re.sub(r"[\W_]+", "_", contact.name, flags=re.ASCII).strip("_")
        name = name if name[:1].isalpha() else f"contact_{name or len(tables)}"
        name += f"_{len(tables)}" if name in tables else ""
        if not contact.springs and areas[contact.casting] > FAR_LARGER * areas[contact.target]:
            contact = replace(contact, casting=contact.target, target=contact.casting)
            lost.append(f"{contact.name}: rays run from {contact.casting}, its far smaller mesh")
        (fixed, fixed_at), (moving, moving_at) = frames[contact.casting], frames[contact.target]
        symbolic = assembly.pose_between(fixed, fixed_at, moving, moving_at)
        pose = ca.Function("pose", [assembly._q], [symbolic])(assembly.default).full().ravel() + 0.0
        scene = out / f"{name}.toml"
        ends = bodies[contact.casting], bodies[contact.target]
        lost += [f"{contact.name}: {what}" for what in write_scene(scene, contact, *ends, pose)]
        table = {"scene": str(scene.resolve()), "fixed": fixed, "moving": moving, "cells_mm": CELLS_MM}
        table |= {"fixed_frame": fixed_at, "moving_frame": moving_at}
        tables[name] = table
    return tables, lost


def _coordinates(assembly: Assembly, joint: str | None) -> tuple[list[str], list[str]]:
    """The coordinate that moves the joint, and those that follow: others between bodies in contact, unless locked."""
    joints = {each.name: each for each in assembly.joints}
    if joint is not None and joint not in joints:
        raise ValueError(f"joint is {joint!r}, expected one of {', '.join(joints)}")
    counts = Counter[str]()
    for contact in assembly.contacts:
        up, down = (assembly._chain.ancestors(body) for body in contact.bodies)
        between = [*(body for body in up if body not in down), *(body for body in down if body not in up)]
        carriers = (assembly._chain.above[body] for body in between)
        counts.update(each.name for each in carriers if each.coordinates)
    chosen = ([joint] if joint else []) + [name for name, _ in counts.most_common() if name != joint]
    names = list(dict.fromkeys(name for each in chosen for name in joints[each].coordinates))
    table = assembly.coordinate_table
    return names[:1], [name for name in names[1:] if table[name].low < table[name].high]


def _centres(
    assembly: Assembly, moving: Sequence[str], following: Sequence[str], motion: str | Path | None
) -> tuple[Array, str]:
    """States (k, n) about which lengths are sampled, and in words where they come from."""
    if motion is not None:
        states = states_of(assembly, read_opensim_table(motion))
        return states, f"paths are fitted about the states of {Path(motion).name}"
    if not (moving and following and assembly.contacts):
        return assembly.default[None], "paths are fitted about the model's rest"
    q, c = assembly.default, assembly.coordinate_table[moving[0]]
    row, way = assembly.rows(moving)[0], 1.0 if c.high - c.default >= c.default - c.low else -1.0
    rest, centres, told = CoordinateSettling(assembly, following), [], 0
    most = abs((c.high if way > 0.0 else c.low) - c.default)
    for turn in (turn for turn in PASSIVE if turn <= most):
        q = q.copy()
        q[row] = c.default + way * turn
        found = rest(q, ACTIVATION, tolerance=1.0)
        q, told = (found.q, told + 1) if found.converged else (q, told)
        centres.append(q)
    of = f"{moving[0]} to {np.degrees(abs(q[row] - c.default)):.0f} degrees"
    return np.array(centres), f"paths are fitted about passive motion, {of}: {told} of {len(centres)} states settle"


def states_of(assembly: Assembly, table: Table) -> Array:
    """Coordinates (n, c) [m, rad] of an OpenSim table, whose labels are names or paths
    (/jointset/knee_r/knee_flex_r/value); those that it lacks are at rest. Raises ValueError where it has none."""
    names = {label: label.removesuffix("/value").split("/")[-1] for label in table.columns}
    found = {label: name for label, name in names.items() if name in assembly.coordinate_table}
    if not found:
        raise ValueError(f"got columns {', '.join(table.columns)}, expected some of {', '.join(assembly.coordinates)}")
    states = np.tile(assembly.default, (len(table), 1))
    for label, name in found.items():
        turns, column = assembly.coordinate_table[name].kind == "rotation", table.columns[label]
        states[:, assembly.rows([name])[0]] = np.radians(column) if turns and table.in_degrees else column
    return states
