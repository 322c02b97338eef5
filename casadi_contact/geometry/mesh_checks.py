"""What a mesh must be for distances from it to have a sign: manifold, of one orientation, with its outside out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.geometry.triangle_mesh import TriangleMesh, directed_edges, point_words

Box = tuple[tuple[float, ...], tuple[float, ...]]  # lowest and highest corner [mm]
_MANIFOLD_MARGIN_MM = 3.0  # about contact: normals there are fitted to vertices two edges away


def check_manifold(mesh: TriangleMesh, contact: Sequence[Box] | None) -> None:
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
            f"{point_words(ends[near][0].mean(axis=0))} mm: remove the extra sheets"
        )


def check_orientation(mesh: TriangleMesh) -> None:
    """The two triangles of every manifold edge run through it in opposite directions."""
    directed, count = np.unique(directed_edges(mesh.faces), axis=0, return_counts=True)
    size = len(mesh.vertices_mm)
    twice = directed[(count > 1) & ~np.isin(np.sort(directed, axis=1) @ [size, 1], mesh.nonmanifold_edges @ [size, 1])]
    if len(twice):
        raise ValueError(
            f"mesh {mesh.name}: neighbouring triangles face opposite ways at {len(twice)} edges, first at "
            f"{point_words(mesh.vertices_mm[twice[0]].mean(axis=0))} mm: make the normals consistent"
        )


def check_outside(mesh: TriangleMesh) -> None:
    """A closed mesh has its outside out."""
    if not len(mesh.boundary_edges) and (volume := _volume(mesh)) < 0.0:
        raise ValueError(
            f"mesh {mesh.name} is inside-out (closed, of volume {volume:.3g} mm³), expected outward normals: "
            "reverse its triangles and save it again"
        )


def _volume(mesh: TriangleMesh) -> float:
    a, b, c = np.moveaxis(mesh.corners_mm - mesh.vertices_mm.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
