"""Scenes of a model's contacts: the casting mesh is the fixed body, whose surface carries the layer, the target moves.
Both keep the frames that the model gives them, so that a scene's pose is that of one in the other.

Of JAM each mesh has a layer, except that a lumped contact has one of thickness h_1 + h_2 with the mean E and ν (Smith
et al. 2018). Springs of an ElasticFoundationForce are a layer without Poisson's effect.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from casadi_contact.contact.ray_cast import DEEPEST_MM
from casadi_contact.core.conventions import Array, rotation
from casadi_contact.core.files.writing import write_text
from casadi_contact.geometry.mesh import load_mesh
from casadi_contact.geometry.mesh_formats import read_triangles
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh
from casadi_contact.scenes.material import Friction, Layer
from casadi_contact.scenes.shapes.mesh_bodies import THIN_MM, shell_thickness
from casadi_contact.workflow.opensim_import.model_file import SPRINGS_MM, ContactForce, Surface

LOADS = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
PRESSED = {"reference_load": 1000.0, "gap_slope": 1.0, "boundary_load": 5.0}  # N, √N/mm, N
SPACING_MM = 0.75


@dataclass(frozen=True)
class Body:
    """A surface's mesh, none of a half-space, the file that holds it [m], the layer on it [MPa, mm], with its mean
    thickness where that varies, and the file that it then lies on."""

    file: Path | None
    mesh: TriangleMesh | None
    layer: Layer
    backing: Path | None = None


def body_of(surface: Surface, find: Callable[[str], Path], folder: Path) -> Body:
    """A surface's body, its files as `find` finds them by name; scaled meshes, and spheres, are written to a folder."""
    if surface.kind == "ContactHalfSpace":
        return Body(None, None, surface.layer)
    if surface.kind == "ContactSphere":
        import trimesh

        ball = trimesh.creation.icosphere(4, surface.radius)
        file = _write_obj(folder / f"{surface.name}.obj", ball.vertices, ball.faces)
        return Body(file, load_mesh(file, "m"), surface.layer)
    file, *backing = (_sized(surface, find(name), folder) for name in (surface.file, surface.back) if name)
    mesh = load_mesh(file, "m")
    if not backing:
        return Body(file, mesh, surface.layer)
    way, _ = RayCaster(load_mesh(backing[0], "m")).first_hits(mesh.corners_mm.mean(axis=1), -mesh.normals)
    hit = np.isfinite(way)
    mean = np.average(np.clip(way[hit], surface.bounds_mm[0], surface.bounds_mm[1]), weights=mesh.areas_mm2[hit])
    return Body(file, mesh, replace(surface.layer, thickness=float(mean)), backing[0])


def _sized(surface: Surface, path: Path, folder: Path) -> Path:
    """The file itself, or a copy of it as the model scales it."""
    if all(factor == 1.0 for factor in surface.scale_factors):
        return path
    vertices, faces = read_triangles(path)
    return _write_obj(folder / f"{surface.name}_{path.stem}.obj", np.asarray(vertices) * surface.scale_factors, faces)


def _write_obj(path: Path, vertices: Array, faces: np.ndarray) -> Path:
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*v) for v in vertices]
    write_text(path, "\n".join([*lines, *("f {} {} {}".format(*f) for f in faces + 1), ""]))
    return path


def layers(contact: ContactForce, casting: Body, target: Body) -> tuple[dict[str, Any], list[str]]:
    """The scene's [material] [MPa, mm], and what of the contact it does not say."""
    if contact.springs:
        return {**vars(Layer(contact.springs * SPRINGS_MM, 0.0, SPRINGS_MM)), "law": "linear"}, []
    lost, own, moving = [], casting.layer, target.layer
    if abs(1e3 * contact.max_proximity - DEEPEST_MM) > 1e-6:
        lost.append(f"max_proximity {contact.max_proximity:g} m: rays are {DEEPEST_MM:g} mm long")
    law = {"linear": "linear", "nonlinear": "log"}.get(contact.formulation)
    if law is None:
        lost.append(f"formulation {contact.formulation}: linear is taken")
    if target.backing or (casting.backing and law == "log"):
        which, mean = ("target", moving) if target.backing else ("casting mesh", own)
        lost.append(f"the thickness of its {which} varies: the mean, {mean.thickness:.3g} mm, is taken")
    if contact.lumped:
        E, nu = (0.5 * (getattr(own, key) + getattr(moving, key)) for key in ("youngs_modulus", "poissons_ratio"))
        own, moving = (Layer(E, nu, each.thickness) for each in (own, moving))
        if not casting.backing:
            return {**vars(replace(own, thickness=own.thickness + moving.thickness)), "law": law or "linear"}, lost
    elif law == "log" and own.modulus != moving.modulus:
        lost.append("two nonlinear layers of different moduli: their pressure is right to the first order")
    return {**vars(own), "law": law or "linear", "moving": vars(moving)}, lost


def pressing(casting: TriangleMesh, target: TriangleMesh, pose: Array) -> tuple[Array, bool]:
    """Where to the target presses the casting mesh, as a unit vector in the casting mesh's frame: against the mean
    normal of the triangles from which a ray outwards enters the target at rest, at its pose, or a short one inwards
    leaves it, which those of the far side of a closed mesh do not. And whether the target is inside out, an open one
    that most rays outwards leave: JAM takes it either way round."""
    caster, R, areas = RayCaster(target), rotation(pose[3:]), casting.areas_mm2
    origins, out = (casting.corners_mm.mean(axis=1) - pose[:3]) @ R, casting.normals @ R
    (ahead, face), (behind, back) = (caster.first_hits(origins, side * out) for side in (1.0, -1.0))
    enters, leaves = (ahead < DEEPEST_MM) & ~caster.leaves(out, face), caster.leaves(-out, back)
    turned = len(target.boundary_edges) > 0 and bool(areas @ ((ahead < DEEPEST_MM) & ~enters) > areas @ enters)
    near = ((ahead < DEEPEST_MM) & (enters != turned)) | ((behind < THIN_MM) & (leaves != turned))
    vectors = casting.area_vectors_mm2
    mean = -(vectors[near] if np.linalg.norm(vectors[near].sum(axis=0)) > 1.0 else vectors).sum(axis=0)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-9)), turned


def write_scene(path: Path, contact: ContactForce, casting: Body, target: Body, pose: Array) -> list[str]:
    """Write a contact's scene; pose (6,) [mm, rad]: of the target at rest. Returns what is lost."""
    assert casting.mesh is not None
    way, thickness = rotation(pose[3:])[:, 1], {"moving": THIN_MM}  # the ground presses upwards
    if target.mesh is not None and target.file is not None:
        way, turned = pressing(casting.mesh, target.mesh, pose)
        if turned:
            file = path.with_name(f"{path.stem}_{target.file.stem}.obj")
            _write_obj(file, 1e-3 * target.mesh.vertices_mm, target.mesh.faces[:, ::-1])
            target = replace(target, file=file, mesh=load_mesh(file, "m"))
        thickness["moving"] = shell_thickness(target.mesh)
    material, lost = layers(contact, casting, target)
    files = {"moving": target.file, "fixed": casting.file}
    if material["law"] == "linear" and not contact.springs:
        files["backing"] = casting.backing
    here, geometry = path.parent.resolve(), dict[str, Any]()
    geometry |= {b: Path(os.path.relpath(f.resolve(), here)).as_posix() for b, f in files.items() if f is not None}
    thickness["fixed"] = shell_thickness(casting.mesh)
    geometry |= {"units": "m", "elements": "grid", "pressing": [round(float(v), 3) + 0.0 for v in way]}
    geometry |= {"start_pose": pose.tolist(), "open_edges": "rim", "patches": {"all": {}}}
    geometry["spacing"] = {b: min(SPACING_MM, math.floor(400.0 * min(h, THIN_MM)) / 1e3) for b, h in thickness.items()}
    geometry |= {"shell": "whole"} if thickness["moving"] < THIN_MM else {}
    tables = {
        "format": 1,
        "name": path.stem,
        "shape": "mesh" if target.mesh is not None else "mesh_on_ground",
        "geometry": geometry,
        "material": material,
        "friction": dict(contact.friction) if Friction(**contact.friction) != Friction() else {},
        "grids": {grid: [80, 80] for grid in ("fine", "coarse", "settle", "teacher")},
        "loads": {"names": list(LOADS), "sensitive": ["F"], **PRESSED},
        "tolerances": {load: 2.0 if load[0] == "F" else 50.0 for load in LOADS},
    }
    of = f"# Contact {contact.name} of an OpenSim model: {contact.target} on {contact.casting}\n"
    write_text(path, of + tomli_w.dumps(tables))
    return lost
