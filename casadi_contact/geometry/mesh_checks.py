"""What a mesh must be for distances from it to have a sign: joined, manifold, of one orientation, outside out, its
pieces apart. Each check raises ValueError, which says where the mesh is wrong and what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh, directed_edges, point_words, undirected_edges

Box = tuple[tuple[float, ...], tuple[float, ...]]  # lowest and highest corner [mm]
_MANIFOLD_MARGIN_MM = 3.0  # about contact: normals there are fitted to vertices two edges away
_FEW_PIECES = 20  # as single triangles: plates and marks
_LEAST_THICKNESS_MM = 1e-6  # volume by area: what is flatter encloses nothing but rounding
_BELOW_MM = 1e-3  # a triangle: where solid begins
_DEEP_MM = 10.0  # in solid: farther from its surface another one changes no distance by 0.002 mm
_LEAST_BURIED_MM2 = 1.0  # folds of a scan are smaller


def check_joined(mesh: TriangleMesh) -> None:
    """Triangles join to a surface: a piece of a mesh that has more than a few is more than two of them."""
    pieces = int(mesh.pieces.max()) + 1
    if pieces > _FEW_PIECES and 2 * pieces > len(mesh.faces):
        raise ValueError(
            f"mesh {mesh.name}: its {len(mesh.faces)} triangles are {pieces} pieces that share no edges, expected a "
            "surface: are corners of neighbours written with different digits? Merge vertices that lie close together"
        )


def check_manifold(mesh: TriangleMesh, contact: Sequence[Box] | None) -> None:
    """Every edge near the contact boxes, or anywhere without such, joins at most two triangles."""
    ends = mesh.vertices_mm[mesh.nonmanifold_edges]
    near = _near(ends, contact)
    if near.any():
        where = "" if contact is None else " near contact"
        raise ValueError(
            f"mesh {mesh.name} is not manifold{where}: {int(near.sum())} edges join more than two triangles, first at "
            f"{point_words(ends[near][0].mean(axis=0))} mm: remove the extra sheets"
        )


def check_orientation(mesh: TriangleMesh) -> None:
    """The two triangles of every manifold edge run through it in opposite directions."""
    size = len(mesh.vertices_mm)
    codes, count = np.unique(directed_edges(mesh.faces) @ [size, 1], return_counts=True)
    directed = np.stack([codes // size, codes % size], axis=1)
    twice = directed[(count > 1) & ~np.isin(np.sort(directed, axis=1) @ [size, 1], mesh.nonmanifold_edges @ [size, 1])]
    if len(twice):
        raise ValueError(
            f"mesh {mesh.name}: neighbouring triangles face opposite ways at {len(twice)} edges, first at "
            f"{point_words(mesh.vertices_mm[twice[0]].mean(axis=0))} mm: make the normals consistent"
        )


def check_outside(mesh: TriangleMesh) -> None:
    """Every closed piece has its outside out, or is a cavity: turned inwards, in the solid of others."""
    piece, count = mesh.pieces, int(mesh.pieces.max()) + 1
    areas = mesh.areas_mm2
    volume = np.bincount(piece, _volumes(mesh), count)
    inward = volume < -_LEAST_THICKNESS_MM * np.bincount(piece, areas, count)
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


def check_apart(mesh: TriangleMesh, contact: Sequence[Box] | None) -> None:
    """No piece lies in the solid of another, near the contact boxes or anywhere without such: there the nearest surface
    would be one inside the body, and distances from it have the wrong sign.

    A ray outwards from such a triangle comes out of the other piece; from any other it meets an outside, or nothing.
    """
    if mesh.pieces.max() == 0:
        return
    out, middles = mesh.normals, mesh.corners_mm.mean(axis=1)
    caster = RayCaster(mesh)
    depth, face = caster.first_hits(middles + _BELOW_MM * out, out)
    buried = caster.leaves(out, face) & (depth < _DEEP_MM) & (mesh.pieces[face] != mesh.pieces)
    buried &= _near(mesh.corners_mm, contact)
    area, count = mesh.areas_mm2[buried].sum(), mesh.pieces.max() + 1
    if area > _LEAST_BURIED_MM2:
        raise ValueError(
            f"mesh {mesh.name}: {area:.3g} mm² of its surface lie inside another of its {count} pieces, first at "
            f"{point_words(middles[buried][0])} mm, expected the outside of the body alone: unite the pieces (boolean "
            "union), or remove those inside"
        )


def _near(corners_mm: Array, contact: Sequence[Box] | None) -> np.ndarray:
    """True (n,) for edges or triangles by their corners (n, k, 3) that reach near a contact box; all without boxes."""
    near = np.full(len(corners_mm), contact is None)
    for low, high in contact or ():
        reaches = (corners_mm.max(axis=1) >= np.subtract(low, _MANIFOLD_MARGIN_MM)) & (
            corners_mm.min(axis=1) <= np.add(high, _MANIFOLD_MARGIN_MM)
        )
        near |= reaches.all(axis=1)
    return near


def _volumes(mesh: TriangleMesh) -> Array:
    """Volume (f,) [mm³] between each triangle and one point, less than 0 where it faces the point."""
    a, b, c = np.moveaxis(mesh.corners_mm - mesh.vertices_mm.mean(axis=0), 1, 0)
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def _at_boundary(mesh: TriangleMesh) -> np.ndarray:
    """True (f,) for triangles with an edge on the mesh's boundary."""
    size = len(mesh.vertices_mm)
    edges = undirected_edges(mesh.faces) @ [size, 1]
    return np.asarray(np.isin(edges, mesh.boundary_edges @ [size, 1]).reshape(3, -1).any(axis=0))


def _solid_behind(mesh: TriangleMesh, triangles: np.ndarray) -> np.ndarray:
    """True (n,) for the chosen triangles (n,) behind which lies solid: the whole mesh winds about the point there."""
    try:
        import igl
    except ImportError:
        raise ImportError("telling cavities of meshes needs libigl: pip install casadi_contact[mesh]") from None
    behind = mesh.corners_mm[triangles].mean(axis=1) - _BELOW_MM * mesh.normals[triangles]
    return np.asarray(igl.winding_number(mesh.vertices_mm, mesh.faces, behind) > 0.5)
