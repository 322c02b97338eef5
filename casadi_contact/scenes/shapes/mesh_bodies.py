"""The two bodies of a mesh scene by its [geometry]: their meshes and smooth surfaces, each made once in a process."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, build_field
from casadi_contact.geometry.mesh import FILE_AXES, Placement, load_mesh
from casadi_contact.geometry.mesh_checks import Box
from casadi_contact.geometry.projection import DOWN
from casadi_contact.geometry.smooth_surface import SmoothSurface
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh
from casadi_contact.scenes.shapes.mesh_files import file_digest
from casadi_contact.scenes.shapes.own_model import patch_anchors

_SPACING_SHARE = 0.4  # of a shell's thickness: its surface is then off by up to 0.01 mm, at 0.2 by 0.002 mm
MOST_BOTH_SIDES = 0.2  # of an outer side: some of its rim is kept on both sides
_BELOW_MM = 1e-3  # the surface: where rays into the body begin
THIN_MM = 4.0  # a moving body thinner than this is a shell, which overlaps may reach the middle of


class _Source(NamedTuple):
    """All that a body's mesh and field are made of. about_mm: the points that a shell's outer side faces away from."""

    path: str
    digest: str
    units: str
    axes: tuple[str, ...]
    contact: tuple[Box, ...] | None
    placement: Placement
    about_mm: tuple[tuple[float, ...], ...] | None


Geometry = Mapping[str, Any]
_NO_BOUND = [-np.inf, np.inf]


def body_mesh(geometry: Geometry, body: str) -> TriangleMesh:
    """The mesh of the "moving" or the "fixed" body, in mm and the library's axes.

    Raises FileNotFoundError for a missing file, ValueError for one that changed since the scene was loaded and for a
    geometry that names no such mesh.
    """
    return _mesh(_source(geometry, body))


def body_field(geometry: Geometry, body: str) -> DistanceField:
    """The signed distance from the body's smooth surface, in the body's own frame; its `fit` says how good it is."""
    return _field(_source(geometry, body), field_spacing(geometry, body))


def field_spacing(geometry: Geometry, body: str) -> float:
    """The spacing [mm] of the nodes of the body's distance field."""
    spacing = geometry["spacing"]
    return float(spacing[body] if isinstance(spacing, Mapping) else spacing)


def body_surface(geometry: Geometry, body: str) -> SmoothSurface:
    """The body's smooth surface, in the body's own frame."""
    return _surface(_source(geometry, body))


def check_shells(geometry: Geometry) -> None:
    """Raise ValueError for a moving body that is a thin shell, unless the scene says which side of it counts, and for a
    shell whose distance field is too coarse: its surface would be off by hundredths of a mm and more."""
    for body in ("moving", "fixed"):
        source = _source(geometry, body)
        if source.about_mm is not None or (thickness := _shell_thickness(source)) > THIN_MM:
            continue
        what = f"scene: the {body} mesh {Path(source.path).name} is a thin shell about {thickness:.2g} mm thick"
        if body == "moving" and "shell" not in geometry:
            raise ValueError(
                f"{what}: pressed about as deep, its inside is reached and the load falls. Set geometry.shell to "
                "'outer' to count the side away from the anchors alone, or to 'whole' where overlaps are far smaller"
            )
        if (spacing := field_spacing(geometry, body)) > _SPACING_SHARE * thickness:
            raise ValueError(
                f"{what}, and geometry.spacing = {spacing:g} mm too coarse for it: expected at most "
                f"{_SPACING_SHARE * thickness:.2g} mm"
            )


def shell_thickness(mesh: TriangleMesh) -> float:
    """The way [mm] from its triangles straight through a body, the median; infinite where most rays do not come out of
    it, as behind a single open surface. A shell with a hole, or of two sheets that nothing joins, is as thin as a
    closed one."""
    return float(np.median(_through(mesh)[0]))


def outer_side(mesh: TriangleMesh, anchors_mm: Array) -> tuple[np.ndarray, float]:
    """Which triangles (f,) of a shell face away from the nearest of the anchors (patches, 3), and over which share of
    their area these are both sides of the shell, as of a saddle."""
    centres = mesh.corners_mm.mean(axis=1)
    away = centres - anchors_mm[np.linalg.norm(centres[:, None] - anchors_mm, axis=2).argmin(axis=1)]
    outer = np.einsum("nk,nk->n", away, mesh.area_vectors_mm2) > 0.0
    thickness, behind = _through(mesh)
    areas = mesh.areas_mm2 * outer
    return outer, float(areas @ (outer[behind] & (thickness < THIN_MM)) / max(areas.sum(), 1e-300))


def _through(mesh: TriangleMesh) -> tuple[Array, np.ndarray]:
    """The way (f,) [mm] from each triangle straight through the body, infinite where a ray does not come out, and the
    triangle (f,) that it comes out of."""
    caster, inwards = RayCaster(mesh), -mesh.normals
    distance, face = caster.first_hits(mesh.corners_mm.mean(axis=1) + _BELOW_MM * inwards, inwards)
    return np.where(caster.leaves(inwards, face), distance, np.inf), face


def patch_box(geometry: Geometry, patch: str) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) of the box that bounds a patch, infinite where the scene names no bound [mm]."""
    bounds = geometry["patches"][patch]
    box = np.array([bounds.get(axis, _NO_BOUND) for axis in FILE_AXES])
    return box[:, 0], box[:, 1]


def patch_view(geometry: Geometry, patch: str) -> tuple[list[float], list[float] | None]:
    """How a patch is seen: where to the moving body presses (3,), and, unless the patch states `pressing` itself, the
    scene's `cup_centre` (3,) [mm], if it has one."""
    scene = geometry.get("pressing", DOWN)
    own = geometry["patches"][patch].get("pressing")
    return (list(scene), geometry.get("cup_centre")) if own is None else (own, None)


def _source(geometry: Geometry, body: str) -> _Source:
    if body not in geometry:
        raise ValueError(f"the scene's geometry names no mesh of its {body} body, expected a scene of the shape mesh")
    path = Path(geometry[body])
    digest = file_digest(path)
    if geometry.get(f"{body}_sha256", digest) != digest:
        raise ValueError(f"scene: {path} has changed since the scene was made with it: load it again")
    about = None
    if body == "moving" and geometry.get("shell") == "outer":
        about = tuple(tuple(anchor) for anchor in patch_anchors(geometry).tolist())
    return _Source(
        str(path),
        digest,
        geometry["units"],
        tuple(geometry["axes"]),
        _contact(geometry, body),
        Placement.from_table(geometry.get("placement", {}).get(body, {})),
        about,
    )


def _contact(geometry: Geometry, body: str) -> tuple[Box, ...] | None:
    """Where the fixed body is touched: its patches. The moving one may be touched anywhere."""
    if body == "moving":
        return None
    boxes = (patch_box(geometry, patch) for patch in geometry["patches"])
    return tuple((tuple(low.tolist()), tuple(high.tolist())) for low, high in boxes)


@lru_cache(maxsize=8)
def _mesh(source: _Source) -> TriangleMesh:
    mesh = load_mesh(source.path, source.units, source.axes, source.contact, source.placement)
    if source.about_mm is None:
        return mesh
    outer, both = outer_side(mesh, np.array(source.about_mm))
    if both > MOST_BOTH_SIDES:
        raise ValueError(
            f"scene: geometry.shell = 'outer' keeps both sides of the moving mesh {mesh.name} over {both:.0%} of what "
            "it keeps, expected one: the side away from the anchors is no one side of a saddle or a flat shell. Cut "
            "the mesh to the side that touches, or set geometry.shell to 'whole' where overlaps are far smaller"
        )
    return mesh.part(outer)


@lru_cache(maxsize=8)
def _shell_thickness(source: _Source) -> float:
    return shell_thickness(_mesh(source))


@lru_cache(maxsize=4)
def _surface(source: _Source) -> SmoothSurface:
    return SmoothSurface(_mesh(source))


@lru_cache(maxsize=4)
def _field(source: _Source, spacing_mm: float) -> DistanceField:
    return build_field(_mesh(source), spacing_mm)
