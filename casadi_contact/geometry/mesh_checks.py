"""Requirements for signed distances from a mesh: joined triangles, manifold, consistently oriented, outside out, pieces
apart. Each check raises ValueError, which says where the mesh is wrong and what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh, directed_edges, point_words, undirected_edges

Box = tuple[tuple[float, ...], tuple[float, ...]]  # lowest and highest corner [mm]


def check_joined(mesh: TriangleMesh, few_pieces: int = 20) -> None:
    """The triangles form surfaces: pieces have more than two triangles on average, if there are more than a few."""
    pieces = int(mesh.pieces.max()) + 1
    if pieces > few_pieces and 2 * pieces > len(mesh.faces):
        raise ValueError(
            f"mesh {mesh.name}: {pieces} pieces share no edges, expected a surface: merge vertices that lie close"
        )


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
        raise ValueError(
            f"mesh {mesh.name}: neighbours face opposite ways at {len(twice)} edges, first at {at} mm: turn them"
        )


def check_outside(mesh: TriangleMesh, flat_mm: float = 1e-6) -> None:
    """Every closed piece has outward normals, or is a cavity: inward normals, in the solid of other pieces. flat_mm:
    pieces with a smaller ratio of volume to area are flat and enclose nothing."""
    piece, count = mesh.pieces, int(mesh.pieces.max()) + 1
    areas = mesh.areas_mm2
    a, b, c = np.moveaxis(mesh.corners_mm - mesh.vertices_mm.mean(axis=0), 1, 0)
    volume = np.bincount(piece, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, count)  # to one point, signed
    inward = volume < -flat_mm * np.bincount(piece, areas, count)
    inward[piece[_at_boundary(mesh)]] = False
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
    leaves the other piece. Triangles deeper than ``deep_mm`` do not change distances, and areas below ``least_mm2`` are
    folds of a scan."""
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
    """Mask (n,) of edges or triangles, by their corners (n, k, 3), within a margin of a contact box; all without boxes.
    Normals in a box are fitted to vertices up to two edges away."""
    near = np.full(len(corners_mm), contact is None)
    for low, high in contact or ():
        reaches = (corners_mm.max(axis=1) >= np.subtract(low, margin_mm)) & (
            corners_mm.min(axis=1) <= np.add(high, margin_mm)
        )
        near |= reaches.all(axis=1)
    return near


def _at_boundary(mesh: TriangleMesh) -> np.ndarray:
    """True (f,) for triangles with an edge on the mesh's boundary."""
    size = len(mesh.vertices_mm)
    edges = undirected_edges(mesh.faces) @ [size, 1]
    return np.asarray(np.isin(edges, mesh.boundary_edges @ [size, 1]).reshape(3, -1).any(axis=0))


def _solid_behind(mesh: TriangleMesh, triangles: np.ndarray, below_mm: float = 1e-3) -> np.ndarray:
    """Mask (n,) of the chosen triangles (n,) with solid behind them: the winding number there exceeds 1/2."""
    try:
        import igl
    except ImportError:
        raise ImportError("cavities of meshes need libigl: pip install casadi_contact[mesh]") from None
    behind = mesh.corners_mm[triangles].mean(axis=1) - below_mm * mesh.normals[triangles]
    return np.asarray(igl.winding_number(mesh.vertices_mm, mesh.faces, behind) > 0.5)
