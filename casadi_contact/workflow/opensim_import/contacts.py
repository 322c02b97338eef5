"""Scenes of a JAM model's contacts: the casting mesh is the fixed body, whose surface carries the layer, the target
moves. Both keep the frames that the model gives them, so that a scene's pose is that of one mesh in the other.

Each mesh has a layer, except that a lumped contact has one of thickness h_1 + h_2 with the mean E and ν (Smith et al.
2018).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
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
from casadi_contact.scenes.material import Layer
from casadi_contact.scenes.shapes.mesh_bodies import THIN_MM, shell_thickness
from casadi_contact.workflow.opensim_import.model_file import ContactForce, ContactMesh

LOADS = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
SPACING_MM = 0.75


def layers(contact: ContactForce, casting: ContactMesh, target: ContactMesh) -> tuple[dict[str, Any], list[str]]:
    """The scene's [material] [MPa, mm], and what of the contact it does not say."""
    lost = [
        f"the thickness of {mesh.name} varies, {mesh.layer.thickness:g} mm is taken"
        for mesh in (casting, target)
        if mesh.variable
    ]
    if abs(1e3 * contact.max_proximity - DEEPEST_MM) > 1e-6:
        lost.append(f"max_proximity {contact.max_proximity:g} m: rays are {DEEPEST_MM:g} mm long")
    law = {"linear": "linear", "nonlinear": "log"}.get(contact.formulation)
    if law is None:
        lost.append(f"formulation {contact.formulation}: linear is taken")
    own, moving = casting.layer, target.layer
    if contact.lumped:
        E, nu = (0.5 * (getattr(own, key) + getattr(moving, key)) for key in ("youngs_modulus", "poissons_ratio"))
        own = Layer(E, nu, own.thickness + moving.thickness)
        return {**vars(own), "law": law or "linear"}, lost
    if law == "log" and own.modulus != moving.modulus:
        lost.append("two nonlinear layers of different moduli: their pressure is right to the first order")
    return {**vars(own), "law": law or "linear", "moving": vars(moving)}, lost


def mesh_file(mesh: ContactMesh, path: Path, folder: Path) -> tuple[Path, TriangleMesh]:
    """A contact mesh's file in m, and the mesh: the file itself, or a copy of it in a folder as the model scales it."""
    if any(factor != 1.0 for factor in mesh.scale_factors):
        vertices, faces = read_triangles(path)
        scaled = np.asarray(vertices) * mesh.scale_factors
        lines = [
            *("v {:.9g} {:.9g} {:.9g}".format(*v) for v in scaled),
            *("f {} {} {}".format(*f) for f in faces + 1),
        ]
        path = folder / f"{mesh.name}.obj"
        write_text(path, "\n".join(lines) + "\n")
    return path, load_mesh(path, "m")


def pressing(casting: TriangleMesh, target: TriangleMesh, pose: Array) -> list[float]:
    """Where to the target presses the casting mesh, as a unit vector in the casting mesh's frame: against the mean
    normal of the triangles from which a ray outwards, or a short one inwards, meets the target at rest, at its pose."""
    t, R = pose[:3], rotation(pose[3:])
    caster, normals, centres = RayCaster(target), casting.normals, casting.corners_mm.mean(axis=1)
    near = np.zeros(len(normals), dtype=bool)
    for side, reach_mm in ((1.0, DEEPEST_MM), (-1.0, THIN_MM)):
        depth, face = caster.first_hits((centres - t) @ R, side * normals @ R)
        near |= (face >= 0) & (depth < reach_mm)
    vectors = casting.area_vectors_mm2
    mean = -(vectors[near] if np.linalg.norm(vectors[near].sum(axis=0)) > 1.0 else vectors).sum(axis=0)
    return [round(float(v), 3) + 0.0 for v in mean / max(float(np.linalg.norm(mean)), 1e-9)]


def write_scene(
    path: Path,
    contact: ContactForce,
    meshes: Mapping[str, ContactMesh],
    files: Mapping[str, tuple[Path, TriangleMesh]],
    pose: Array,
) -> list[str]:
    """Write a contact's scene; pose (6,) [mm, rad]: of the target at rest. Returns what is lost."""
    (fixed, casting), (moving, target) = files[contact.casting], files[contact.target]
    material, lost = layers(contact, meshes[contact.casting], meshes[contact.target])
    thickness = min(shell_thickness(each) for each in (casting, target))
    geometry: dict[str, Any] = {
        body: Path(os.path.relpath(file.resolve(), path.parent.resolve())).as_posix()
        for body, file in (("moving", moving), ("fixed", fixed))
    }
    geometry |= {"units": "m", "elements": "grid", "pressing": pressing(casting, target, pose)}
    geometry |= {"start_pose": pose.tolist(), "patches": {"all": {}}}
    if thickness <= THIN_MM:
        geometry |= {"shell": "whole", "spacing": round(min(SPACING_MM, 0.4 * thickness), 3)}
    tables = {
        "format": 1,
        "name": contact.name,
        "shape": "mesh",
        "geometry": geometry,
        "material": material,
        "grids": {grid: [80, 80] for grid in ("fine", "coarse", "settle", "teacher")},
        "loads": {
            "names": list(LOADS),
            "sensitive": ["F"],
            "reference_load": 1000.0,
            "gap_slope": 1.0,
            "boundary_load": 5.0,
        },
        "tolerances": {load: 2.0 if load[0] == "F" else 50.0 for load in LOADS},
    }
    write_text(
        path,
        f"# Contact {contact.name} of an OpenSim model: {contact.target} on {contact.casting}\n"
        + tomli_w.dumps(tables),
    )
    return lost
