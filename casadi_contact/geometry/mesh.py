"""Triangle meshes of real joints: read, checked and cleaned, in mm and in the library's axes.

`geometry.mesh_formats` reads files. Errors say what was got, expected, and the remedy. Degenerate and repeated
triangles are dropped and counted. Signed distances need joined, manifold, outwards triangles and pieces apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import Array, rotation
from casadi_contact.core.files.reading import MOST_MESH, checked_size, existing_file, sha256_of
from casadi_contact.geometry.mesh_formats import FORMATS, read_triangles
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh, directed_edges, point_words

MM_PER_UNIT = {"m": 1000.0, "mm": 1.0, "cm": 10.0, "inch": 25.4}
FILE_AXES = ("x", "y", "z")  # axes as they are in the file
Box = tuple[tuple[float, ...], tuple[float, ...]]  # lowest and highest corner [mm]


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
    """SHA-256 of a mesh file; raises FileNotFoundError, and ValueError for a file larger than any mesh's."""
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist: paths are absolute, or relative to the scene file")
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
    largest_mm: float = 10000.0,
    least_height: float = 1e-6,
) -> TriangleMesh:
    """A mesh with equal vertices merged and without degenerate and repeated triangles; raises as `load_mesh` does.
    smallest_mm, largest_mm: extent of a joint's part and of the ground, to detect wrong units. least_height: of a
    triangle over its longest edge, below which it has no usable normal. Half of the triangles may be dropped: a sheet
    written twice is still the same sheet."""
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
        expected = f"expected {smallest_mm:g} to {largest_mm:g} mm: {remedy}"
        raise ValueError(f"mesh {name} is {across:.3g} mm across with units = {units!r}, {expected}")
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


def check_joined(mesh: TriangleMesh, few_pieces: int = 20) -> None:
    """The triangles form surfaces: pieces have more than two triangles on average, if there are more than a few."""
    pieces = int(mesh.pieces.max()) + 1
    if pieces > few_pieces and 2 * pieces > len(mesh.faces):
        raise ValueError(f"mesh {mesh.name}: {pieces} pieces share no edges, expected a surface: merge close vertices")


def check_manifold(mesh: TriangleMesh, contact: Sequence[Box] | None) -> None:
    """Every edge near the contact boxes (without boxes: every edge) joins at most two triangles."""
    ends = mesh.vertices_mm[mesh.nonmanifold_edges]
    near = _near(ends, contact)
    if near.any():
        where = "" if contact is None else " near contact"
        at = f"{int(near.sum())} edges join 3 triangles or more, first at {point_words(ends[near][0].mean(axis=0))} mm"
        raise ValueError(f"mesh {mesh.name} is not manifold{where}: {at}: remove the extra sheets")


def check_orientation(mesh: TriangleMesh) -> None:
    """The two triangles of every manifold edge run through it in opposite directions."""
    size = len(mesh.vertices_mm)
    codes, count = np.unique(directed_edges(mesh.faces) @ [size, 1], return_counts=True)
    directed = np.stack([codes // size, codes % size], axis=1)
    twice = directed[(count > 1) & ~np.isin(np.sort(directed, axis=1) @ [size, 1], mesh.nonmanifold_edges @ [size, 1])]
    if len(twice):
        at = point_words(mesh.vertices_mm[twice[0]].mean(axis=0))
        raise ValueError(f"mesh {mesh.name}: {len(twice)} edges join opposite faces, first at {at} mm: turn them")


def check_outside(mesh: TriangleMesh, flat_mm: float = 1e-6) -> None:
    """Every closed piece has outward normals, or is a cavity: inward normals, in the solid of other pieces. flat_mm:
    pieces with a smaller ratio of volume to area are flat and enclose nothing."""
    piece, count = mesh.pieces, int(mesh.pieces.max()) + 1
    areas = mesh.areas_mm2
    a, b, c = np.moveaxis(mesh.corners_mm - mesh.vertices_mm.mean(axis=0), 1, 0)
    volume = np.bincount(piece, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, count)  # to one point, signed
    inward = volume < -flat_mm * np.bincount(piece, areas, count)
    inward[piece[mesh.open_sides.any(axis=1)]] = False
    wrong = np.flatnonzero(inward)
    if count > 1 and len(wrong):
        largest = np.lexsort((-areas, piece))[np.searchsorted(np.sort(piece), wrong)]
        wrong = wrong[~_solid_behind(mesh, largest)]
    if len(wrong):
        middle = mesh.corners_mm[piece == wrong[0]].mean(axis=(0, 1))
        pieces = f" in {len(wrong)} of its {count} pieces, first about {point_words(middle)} mm" if count > 1 else ""
        raise ValueError(
            f"mesh {mesh.name} is inside-out{pieces} (closed, of volume {volume[wrong[0]]:.3g} mm³), expected outward "
            f"normals: reverse {'their' if pieces else 'its'} triangles and save it again"
        )


def check_apart(
    mesh: TriangleMesh,
    contact: Sequence[Box] | None,
    *,
    below_mm: float = 1e-3,
    deep_mm: float = 10.0,
    least_mm2: float = 1.0,
) -> None:
    """No piece lies in the solid of another near the contact boxes (without boxes: anywhere). There the nearest surface
    would lie inside the body, and distances from it would have the wrong sign. An outward ray from such a triangle
    leaves the other piece. Those deeper than ``deep_mm`` change no distance; below ``least_mm2`` lie folds."""
    if mesh.pieces.max() == 0:
        return
    out, middles = mesh.normals, mesh.corners_mm.mean(axis=1)
    caster = RayCaster(mesh)
    depth, face = caster.first_hits(middles + below_mm * out, out)
    buried = caster.leaves(out, face) & (depth < deep_mm) & (mesh.pieces[face] != mesh.pieces)
    buried &= _near(mesh.corners_mm, contact)
    area, count = mesh.areas_mm2[buried].sum(), mesh.pieces.max() + 1
    if area > least_mm2:
        raise ValueError(
            f"mesh {mesh.name}: {area:.3g} mm² of its surface lie inside another of its {count} pieces, first at "
            f"{point_words(middles[buried][0])} mm, expected the outside of the body alone: unite the pieces (boolean "
            "union), or remove those inside"
        )


def _near(corners_mm: Array, contact: Sequence[Box] | None, margin_mm: float = 3.0) -> np.ndarray:
    """Mask (n,) of edges or triangles, by corners (n, k, 3), within a margin of a contact box; all without boxes."""
    near = np.full(len(corners_mm), contact is None)
    for low, high in contact or ():
        reaches = (corners_mm.max(axis=1) >= np.subtract(low, margin_mm)) & (
            corners_mm.min(axis=1) <= np.add(high, margin_mm)
        )
        near |= reaches.all(axis=1)
    return near


def _solid_behind(mesh: TriangleMesh, triangles: np.ndarray, below_mm: float = 1e-3) -> np.ndarray:
    """Mask (n,) of the chosen triangles (n,) with solid behind them: the winding number there exceeds 1/2."""
    try:
        import igl
    except ImportError:
        raise ImportError("cavities of meshes need libigl: pip install casadi_contact[mesh]") from None
    behind = mesh.corners_mm[triangles].mean(axis=1) - below_mm * mesh.normals[triangles]
    return np.asarray(igl.winding_number(mesh.vertices_mm, mesh.faces, behind) > 0.5)
