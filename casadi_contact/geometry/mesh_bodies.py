"""The two bodies of a mesh scene: their meshes, smooth surfaces and elements, each made once in a process."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, build_field
from casadi_contact.geometry.mesh import Box, TriangleMesh, load_mesh
from casadi_contact.scenes import Scene
from casadi_contact.scenes.mesh_files import file_digest

_Source = tuple[str, str, str, tuple[str, ...], tuple[Box, ...] | None]  # path, digest, units, axes, contact
_NO_BOUND = [-np.inf, np.inf]


def body_mesh(scene: Scene, body: str) -> TriangleMesh:
    """The mesh of the scene's "moving" or "fixed" body, in mm and the library's axes.

    Raises FileNotFoundError for a missing file, ValueError for one that changed since the scene was loaded.
    """
    return _mesh(*_source(scene, body))


def body_field(scene: Scene, body: str) -> DistanceField:
    """The signed distance from the body's smooth surface, in the body's own frame; its `fit` says how good it is."""
    return _field(_source(scene, body), scene.geometry["spacing"])


def patch_box(scene: Scene, patch: str) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) of the box that bounds a patch, infinite where the scene names no bound [mm]."""
    bounds = scene.geometry["patches"][patch]
    box = np.array([bounds.get("x", _NO_BOUND), _NO_BOUND, bounds.get("z", _NO_BOUND)])
    return box[:, 0], box[:, 1]


def patch_mesh(scene: Scene, patch: str, *, reaching: bool = False) -> TriangleMesh:
    """The triangles of the fixed mesh that belong to a patch by their centres, or all that reach into its box."""
    return body_mesh(scene, "fixed").inside_box(*patch_box(scene, patch), reaching=reaching)


def _source(scene: Scene, body: str) -> _Source:
    if scene.shape != "mesh":
        raise ValueError(f"scene {scene.name} has the shape {scene.shape}, expected mesh: it has no mesh files")
    geometry: Mapping[str, Any] = scene.geometry
    path = Path(geometry[body])
    digest = file_digest(path)
    if geometry.get(f"{body}_sha256", digest) != digest:
        raise ValueError(f"scene {scene.name}: {path} has changed since the scene was made with it: load it again")
    return str(path), digest, geometry["units"], tuple(geometry["axes"]), _contact(scene, body)


def _contact(scene: Scene, body: str) -> tuple[Box, ...] | None:
    """Where the fixed body is touched: its patches. The moving one may be touched anywhere."""
    if body == "moving":
        return None
    boxes = (patch_box(scene, patch) for patch in scene.patch_names)
    return tuple((tuple(low.tolist()), tuple(high.tolist())) for low, high in boxes)


@lru_cache(maxsize=8)
def _mesh(path: str, digest: str, units: str, axes: tuple[str, ...], contact: tuple[Box, ...] | None) -> TriangleMesh:
    return load_mesh(path, units, axes, contact)


@lru_cache(maxsize=4)
def _field(source: _Source, spacing_mm: float) -> DistanceField:
    return build_field(_mesh(*source), spacing_mm)
