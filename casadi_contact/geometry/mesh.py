"""Triangle meshes of real joints: read, checked and cleaned, in mm and in the library's axes.

`geometry.mesh_formats` reads files. Errors say what was got, expected, and the remedy. Degenerate and repeated
triangles are dropped and counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import Array, rotation
from casadi_contact.core.files.reading import MOST_MESH, checked_size, existing_file, sha256_of
from casadi_contact.geometry.mesh_checks import (
    Box,
    check_apart,
    check_joined,
    check_manifold,
    check_orientation,
    check_outside,
)
from casadi_contact.geometry.mesh_formats import FORMATS, read_triangles
from casadi_contact.geometry.triangle_mesh import TriangleMesh

MM_PER_UNIT = {"m": 1000.0, "mm": 1.0, "cm": 10.0, "inch": 25.4}
FILE_AXES = ("x", "y", "z")  # axes as they are in the file


@dataclass(frozen=True)
class Placement:
    """p' = R·M·p + offset [mm] for points p [mm] of a mesh in the library's axes: a scene's [geometry.placement].
    offset: along x, y, z. rotation_deg: about x, y, z as of a pose, R = Rx·Ry·Rz. mirror: the axis whose sign M turns
    ("z" makes a left joint a right one), none if empty."""

    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotation_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    mirror: str = ""

    def points(self, points_mm: Array) -> Array:
        """Points (n, 3) [mm] where they lie in the body's frame."""
        if self == Placement():
            return points_mm
        signs = [-1.0 if axis == self.mirror else 1.0 for axis in FILE_AXES]
        return (points_mm * signs) @ rotation(np.radians(self.rotation_deg)).T + self.offset


AS_IN_FILE = Placement()


def axes_rotation(axes: Sequence[str]) -> Array:
    """R (3, 3) with (x, y, z) = R·(file coordinates); raises ValueError for axes that are no rotation."""
    named = [str(axis) for axis in axes] if isinstance(axes, list | tuple) else []
    rows = [
        (-1.0 if axis.startswith("-") else 1.0) * np.eye(3)[FILE_AXES.index(axis.removeprefix("-"))]
        for axis in named
        if axis.removeprefix("-") in FILE_AXES
    ]
    rotation = np.array(rows)
    if rotation.shape != (3, 3) or len(named) != 3 or np.linalg.det(rotation) < 0.5:
        raise ValueError(
            f"scene: geometry.axes = {axes!r}, expected three file axes that keep the hand, e.g. ['x', 'y', 'z'] or "
            "['-x', 'y', '-z']; the third is medial of a right joint, and lateral of a left one"
        )
    return rotation


def load_mesh(
    path: str | Path,
    units: str,
    axes: Sequence[str] = FILE_AXES,
    contact: Sequence[Box] | None = None,
    placement: Placement = AS_IN_FILE,
) -> TriangleMesh:
    """Read and check a mesh file (one of `FORMATS`).

    units: of the file, one of `MM_PER_UNIT`. axes: which file axis each of the library's x, y, z is, e.g. ("-x", "y",
    "-z") for a right knee of OpenSim (x anterior, z lateral). placement: where the mesh lies in these axes. contact:
    boxes in the body's frame within 3 mm of which the mesh must be manifold and its pieces apart; everywhere if left
    out. Raises FileNotFoundError, or ValueError for what cannot work.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"mesh {path} is a {path.suffix or 'nameless'} file, expected one of {', '.join(FORMATS)}")
    existing_file(path, "mesh file")
    return checked_mesh(path.name, *read_triangles(path), units, axes, contact, placement)


def file_digest(path: Path) -> str:
    """SHA-256 of a mesh file; raises FileNotFoundError, saying how a scene finds its meshes, and ValueError for a file
    larger than any mesh's."""
    if not path.is_file():
        raise FileNotFoundError(
            f"mesh file {path} does not exist: a scene's mesh paths are absolute or relative to the scene file"
        )
    checked_size(path, MOST_MESH)
    return sha256_of(path)


def checked_mesh(
    name: str,
    vertices: Array,
    faces: np.ndarray,
    units: str = "mm",
    axes: Sequence[str] = FILE_AXES,
    contact: Sequence[Box] | None = None,
    placement: Placement = AS_IN_FILE,
    *,
    smallest_mm: float = 4.0,
    largest_mm: float = 1000.0,
    least_height: float = 1e-6,
) -> TriangleMesh:
    """A mesh with equal vertices merged and without degenerate and repeated triangles; raises as `load_mesh` does.
    smallest_mm, largest_mm: extent of a joint's parts, to detect wrong units. least_height: of a triangle over its
    longest edge, below which it has no usable normal. Half of the triangles may be dropped: a sheet written twice is
    still the same sheet."""
    if units not in MM_PER_UNIT:
        raise ValueError(f"mesh {name}: units = {units!r}, expected {' or '.join(MM_PER_UNIT)}")
    vertices, faces = np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int64)
    for what, array in (("vertices", vertices), ("triangles", faces)):
        if array.size and (array.ndim != 2 or array.shape[1] != 3):
            raise ValueError(f"mesh {name}: its {what} have shape {array.shape}, expected (n, 3)")
    if not len(vertices) or not len(faces):
        got = f"{len(vertices)} vertices, {len(faces)} triangles"
        raise ValueError(f"mesh {name} is empty ({got}), expected triangles: is the file whole?")
    if len(wrong := faces[(faces < 0) | (faces >= len(vertices))]):
        raise ValueError(f"mesh {name}: a triangle names vertex {wrong[0]} of {len(vertices)}: the file is damaged")
    used, index = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], index.reshape(-1, 3)
    if len(wrong := np.flatnonzero(~np.isfinite(vertices).all(axis=1))):
        got = f"vertex {used[wrong[0]]} is {vertices[wrong[0]]}"
        raise ValueError(f"mesh {name}: {got}, expected finite numbers: export it again")
    vertices = placement.points(MM_PER_UNIT[units] * vertices @ axes_rotation(axes).T)
    faces = faces[:, ::-1] if placement.mirror else faces
    # One vertex for each position: an STL file repeats them for every triangle, an OBJ file for every normal.
    vertices, index = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    wide, once = _heights(vertices, faces) > least_height, _first_of_equals(faces)
    sound, sliver = wide & once, ~wide & once & (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not sound.any():
        raise ValueError(f"mesh {name}: all {len(faces)} triangles are degenerate (no area), expected a surface")
    mesh = TriangleMesh(name, vertices, faces, int((~sound).sum()), faces[sliver]).part(sound)  # without lone corners
    across = float(np.linalg.norm(np.ptp(mesh.vertices_mm, axis=0)))
    if not smallest_mm < across < largest_mm:
        sizes = {unit: across * size / MM_PER_UNIT[units] for unit, size in MM_PER_UNIT.items()}
        fitting = [unit for unit, size in sizes.items() if smallest_mm < size < largest_mm]
        remedy = f"is the file in {' or '.join(fitting)}?" if fitting else "which no unit makes a joint's: scale it"
        raise ValueError(
            f"mesh {name} is {across:.3g} mm across with units = {units!r}, expected {smallest_mm:g} to "
            f"{largest_mm:g} mm: {remedy}"
        )
    if 2 * mesh.dropped > len(faces):
        dropped = f"{mesh.dropped} of {len(faces)} triangles are degenerate or repeated"
        raise ValueError(f"mesh {name}: {dropped}, expected half at most: the file is damaged, export it again")
    check_joined(mesh)
    check_manifold(mesh, contact)
    check_orientation(mesh)
    check_outside(mesh)
    check_apart(mesh, contact)
    return mesh


def _heights(vertices: Array, faces: np.ndarray) -> Array:
    """Height of each triangle over its longest edge, by that edge."""
    corners = vertices[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return doubled / np.maximum(edges**2, 1e-300)


def _first_of_equals(faces: np.ndarray) -> np.ndarray:
    """False (f,) for a triangle that an earlier one repeats, with the same corners in the same turn."""
    first = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    kept = np.zeros(len(faces), dtype=bool)
    kept[np.unique(turned, axis=0, return_index=True)[1]] = True
    return kept
