"""The two bodies of a mesh scene by its [geometry]: their meshes and smooth surfaces, each made once in a process."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, build_field
from casadi_contact.geometry.mesh import FILE_AXES, Box, TriangleMesh, load_mesh
from casadi_contact.geometry.placement import Placement
from casadi_contact.shapes.mesh_files import file_digest

# Path, digest, units, axes, contact, placement.
_Source = tuple[str, str, str, tuple[str, ...], tuple[Box, ...] | None, Placement]
Geometry = Mapping[str, Any]
_NO_BOUND = [-np.inf, np.inf]


def body_mesh(geometry: Geometry, body: str) -> TriangleMesh:
    """The mesh of the "moving" or the "fixed" body, in mm and the library's axes.

    Raises FileNotFoundError for a missing file, ValueError for one that changed since the scene was loaded and for a
    geometry that names no such mesh.
    """
    return _mesh(*_source(geometry, body))


def body_field(geometry: Geometry, body: str) -> DistanceField:
    """The signed distance from the body's smooth surface, in the body's own frame; its `fit` says how good it is."""
    return _field(_source(geometry, body), geometry["spacing"])


def patch_box(geometry: Geometry, patch: str) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) of the box that bounds a patch, infinite where the scene names no bound [mm]."""
    bounds = geometry["patches"][patch]
    box = np.array([bounds.get(axis, _NO_BOUND) for axis in FILE_AXES])
    return box[:, 0], box[:, 1]


def _source(geometry: Geometry, body: str) -> _Source:
    if body not in geometry:
        raise ValueError(f"the scene's geometry names no mesh of its {body} body, expected a scene of the shape mesh")
    path = Path(geometry[body])
    digest = file_digest(path)
    if geometry.get(f"{body}_sha256", digest) != digest:
        raise ValueError(f"scene: {path} has changed since the scene was made with it: load it again")
    placement = Placement.from_table(geometry.get("placement", {}).get(body, {}))
    return str(path), digest, geometry["units"], tuple(geometry["axes"]), _contact(geometry, body), placement


def _contact(geometry: Geometry, body: str) -> tuple[Box, ...] | None:
    """Where the fixed body is touched: its patches. The moving one may be touched anywhere."""
    if body == "moving":
        return None
    boxes = (patch_box(geometry, patch) for patch in geometry["patches"])
    return tuple((tuple(low.tolist()), tuple(high.tolist())) for low, high in boxes)


@lru_cache(maxsize=8)
def _mesh(
    path: str,
    digest: str,
    units: str,
    axes: tuple[str, ...],
    contact: tuple[Box, ...] | None,
    placement: Placement,
) -> TriangleMesh:
    return load_mesh(path, units, axes, contact, placement)


@lru_cache(maxsize=4)
def _field(source: _Source, spacing_mm: float) -> DistanceField:
    return build_field(_mesh(*source), spacing_mm)
