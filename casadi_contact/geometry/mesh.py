"""Triangle meshes of real joints: read, checked and cleaned, in mm and in the library's axes.

STL, OBJ and PLY are read by trimesh, VTP by `geometry.vtp`. What cannot work is refused with what was got, what was
expected and the cure; degenerate and repeated triangles are dropped and counted.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.files import MOST_MESH, checked_size, one_line
from casadi_contact.geometry.placement import Placement
from casadi_contact.geometry.vtp import read_vtp

MM_PER_UNIT = {"m": 1000.0, "mm": 1.0, "cm": 10.0}
FILE_AXES = ("x", "y", "z")  # axes as they are in the file
Box = tuple[tuple[float, ...], tuple[float, ...]]  # lowest and highest corner [mm]
AS_IN_FILE = Placement()
FORMATS = (".stl", ".obj", ".ply", ".vtp")
_SMALLEST_MM, _LARGEST_MM = 4.0, 1000.0  # across: a joint's parts lie well between, a wrong unit does not
_MANIFOLD_MARGIN_MM = 3.0  # about contact: normals there are fitted to vertices two edges away
_LEAST_HEIGHT = 1e-6  # of a triangle over its longest edge: flatter ones have no usable normal


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A checked mesh: vertices_mm (v, 3), faces (f, 3) anticlockwise seen from outside; dropped: degenerate and
    repeated ones."""

    name: str
    vertices_mm: Array
    faces: np.ndarray
    dropped: int = 0

    @property
    def corners_mm(self) -> Array:
        """Corners of every triangle (f, 3, 3)."""
        return self.vertices_mm[self.faces]

    @property
    def area_vectors_mm2(self) -> Array:
        """Outward normal times area of every triangle (f, 3)."""
        a, b, c = np.moveaxis(self.corners_mm, 1, 0)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def normals(self) -> Array:
        """Outward unit normal of every triangle (f, 3)."""
        vectors = self.area_vectors_mm2
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

    @property
    def joined_sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of sides that are one edge of just two triangles; side k·f + triangle runs from its corner k to the
        next."""
        _, edge, count = np.unique(_undirected_edges(self.faces), axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(edge.ravel(), kind="stable")
        pairs = order[count[edge.ravel()[order]] == 2]
        return pairs[::2], pairs[1::2]

    @cached_property
    def nonmanifold_edges(self) -> np.ndarray:
        """Edges (e, 2) that join more than two triangles."""
        edges, count = np.unique(_undirected_edges(self.faces), axis=0, return_counts=True)
        return edges[count > 2]

    @cached_property
    def boundary_edges(self) -> np.ndarray:
        """Edges (e, 2) that belong to one triangle only; none if the mesh is closed."""
        edges, count = np.unique(_undirected_edges(self.faces), axis=0, return_counts=True)
        return edges[count == 1]

    @property
    def extent(self) -> str:
        """Lowest and highest coordinates [mm] in words."""
        return f"{_point(self.vertices_mm.min(axis=0))} to {_point(self.vertices_mm.max(axis=0))}"

    def inside_box(self, low: Array, high: Array, *, reaching: bool = False) -> TriangleMesh:
        """The triangles whose centre lies inside the box [mm], or all that reach into it; ValueError if none does."""
        corners = self.corners_mm
        lowest, highest = (corners.min(axis=1), corners.max(axis=1)) if reaching else (corners.mean(axis=1),) * 2
        inside = np.all((highest >= low) & (lowest < high), axis=1)
        if not inside.any():
            raise ValueError(
                f"mesh {self.name}: no triangle between {_point(low)} and {_point(high)} mm, "
                f"expected a part of {self.extent}: check the box, units and axes"
            )
        return self.part(inside)

    def part(self, chosen: np.ndarray) -> TriangleMesh:
        """The chosen triangles (f,) with the vertices that they use."""
        used, renumbered = np.unique(self.faces[chosen], return_inverse=True)
        return TriangleMesh(self.name, self.vertices_mm[used], renumbered.reshape(-1, 3), self.dropped)


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
            "['-x', 'y', '-z']"
        )
    return rotation


def load_mesh(
    path: str | Path,
    units: str,
    axes: Sequence[str] = FILE_AXES,
    contact: Sequence[Box] | None = None,
    placement: Placement = AS_IN_FILE,
) -> TriangleMesh:
    """Read and check a mesh file (STL, OBJ, PLY or VTP).

    units: of the file, "m" or "mm". axes: which file axis each of the library's x, y, z is, e.g. ("-x", "y", "-z")
    for a right knee of OpenSim (x anterior, z lateral). placement: where the mesh lies in these axes. contact: boxes in
    the body's frame within 3 mm of which the mesh must be manifold; everywhere if left out. Raises FileNotFoundError,
    or ValueError for what cannot work.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"mesh {path} is a {path.suffix or 'nameless'} file, expected one of {', '.join(FORMATS)}")
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    vertices, faces = read_vtp(path) if path.suffix.lower() == ".vtp" else _read_by_trimesh(path)
    return checked_mesh(path.name, vertices, faces, units, axes, contact, placement)


def checked_mesh(
    name: str,
    vertices: Array,
    faces: np.ndarray,
    units: str = "mm",
    axes: Sequence[str] = FILE_AXES,
    contact: Sequence[Box] | None = None,
    placement: Placement = AS_IN_FILE,
) -> TriangleMesh:
    """Merge equal vertices, drop degenerate and repeated triangles; refuse what cannot work (see `load_mesh`)."""
    if units not in MM_PER_UNIT:
        raise ValueError(f"mesh {name}: units = {units!r}, expected {' or '.join(MM_PER_UNIT)}")
    vertices, faces = np.asarray(vertices, dtype=float).reshape(-1, 3), np.asarray(faces, dtype=np.int64)
    if not len(vertices) or not len(faces):
        raise ValueError(
            f"mesh {name} is empty ({len(vertices)} vertices, {len(faces)} triangles), expected triangles: is the file "
            "whole?"
        )
    if not np.isfinite(vertices).all():
        row = int(np.argwhere(~np.isfinite(vertices))[0, 0])
        raise ValueError(f"mesh {name}: vertex {row} is {vertices[row]}, expected finite numbers: export it again")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"mesh {name}: a triangle names vertex {faces.max()} of {len(vertices)}: the file is damaged")
    vertices = placement.points(MM_PER_UNIT[units] * vertices @ axes_rotation(axes).T)
    faces = placement.faces(faces)
    across = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if not _SMALLEST_MM < across < _LARGEST_MM:
        other = "mm" if units == "m" else "m"
        raise ValueError(
            f"mesh {name} is {across:.3g} mm across with units = {units!r}, expected {_SMALLEST_MM:g} to "
            f"{_LARGEST_MM:g} mm: is the file in {other}?"
        )
    vertices, faces = _merge_vertices(vertices, faces)
    sound = (_heights(vertices, faces) > _LEAST_HEIGHT) & _first_of_equals(faces)
    mesh = TriangleMesh(name, vertices, faces[sound], int((~sound).sum()))
    if not sound.any():
        raise ValueError(f"mesh {name}: all {len(faces)} triangles are degenerate (no area), expected a surface")
    _check_manifold(mesh, contact)
    _check_orientation(mesh)
    if not len(mesh.boundary_edges) and (volume := _volume(mesh)) < 0.0:
        raise ValueError(
            f"mesh {name} is inside-out (closed, of volume {volume:.3g} mm³), expected outward normals: "
            "reverse its triangles and save it again"
        )
    return mesh


def _read_by_trimesh(path: Path) -> tuple[Array, np.ndarray]:
    try:
        import trimesh
    except ImportError:
        raise ImportError(f"reading {path.name} needs trimesh: pip install casadi_contact[mesh]") from None
    checked_size(path, MOST_MESH)
    kind = path.suffix[1:].lower()
    try:
        whole = path.read_bytes()
        if kind == "stl":
            _check_stl_size(whole)
        # Not by its path: trimesh would read files that the mesh names.
        content: Any = trimesh.load(io.BytesIO(whole), file_type=kind, force="mesh", process=False)
        return np.asarray(content.vertices), np.asarray(content.faces)
    except Exception as error:  # trimesh's readers raise whatever the damage led to
        raise ValueError(
            f"mesh {path} cannot be read ({one_line(error)}), expected a whole {kind.upper()} file"
        ) from None


def _check_stl_size(content: bytes) -> None:
    """Raise ValueError for binary STL of another size than its triangles need (STL: 84 bytes, 50 a triangle)."""
    claimed = int.from_bytes(content[80:84], "little")
    if b"facet" not in content[:1000] and len(content) != 84 + 50 * claimed:
        raise ValueError(f"it claims {claimed} triangles in {len(content)} bytes, expected {84 + 50 * claimed}")


def _merge_vertices(vertices: Array, faces: np.ndarray) -> tuple[Array, np.ndarray]:
    """One vertex for each position: an STL file repeats them for every triangle, an OBJ file for every normal."""
    unique, index = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    used, renumbered = np.unique(faces, return_inverse=True)
    return unique[used], renumbered.reshape(-1, 3)


def _heights(vertices: Array, faces: np.ndarray) -> Array:
    """Height of each triangle over its longest edge, by that edge."""
    corners = vertices[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return doubled / np.maximum(edges, 1e-300) ** 2


def _first_of_equals(faces: np.ndarray) -> np.ndarray:
    """False (f,) for a triangle that an earlier one repeats, with the same corners in the same turn."""
    first = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    kept = np.zeros(len(faces), dtype=bool)
    kept[np.unique(turned, axis=0, return_index=True)[1]] = True
    return kept


def _directed_edges(faces: np.ndarray) -> np.ndarray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _undirected_edges(faces: np.ndarray) -> np.ndarray:
    return np.sort(_directed_edges(faces), axis=1)


def _check_manifold(mesh: TriangleMesh, contact: Sequence[Box] | None) -> None:
    """Every edge near the contact boxes, or anywhere without such, joins at most two triangles."""
    ends = mesh.vertices_mm[mesh.nonmanifold_edges]
    near = np.full(len(ends), contact is None)
    for low, high in contact or ():
        reaches = (ends.max(axis=1) >= np.subtract(low, _MANIFOLD_MARGIN_MM)) & (
            ends.min(axis=1) <= np.add(high, _MANIFOLD_MARGIN_MM)
        )
        near |= reaches.all(axis=1)
    if near.any():
        where = "" if contact is None else " near contact"
        raise ValueError(
            f"mesh {mesh.name} is not manifold{where}: {int(near.sum())} edges join more than two triangles, first at "
            f"{_point(ends[near][0].mean(axis=0))} mm: remove the extra sheets"
        )


def _check_orientation(mesh: TriangleMesh) -> None:
    """The two triangles of every manifold edge run through it in opposite directions."""
    directed, count = np.unique(_directed_edges(mesh.faces), axis=0, return_counts=True)
    size = len(mesh.vertices_mm)
    twice = directed[(count > 1) & ~np.isin(np.sort(directed, axis=1) @ [size, 1], mesh.nonmanifold_edges @ [size, 1])]
    if len(twice):
        raise ValueError(
            f"mesh {mesh.name}: neighbouring triangles face opposite ways at {len(twice)} edges, first at "
            f"{_point(mesh.vertices_mm[twice[0]].mean(axis=0))} mm: make the normals consistent"
        )


def _volume(mesh: TriangleMesh) -> float:
    a, b, c = np.moveaxis(mesh.corners_mm - mesh.vertices_mm.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _point(point: Array) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in point) + ")"
