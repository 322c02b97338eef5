"""Creases of a mesh: edges at which the surface has two normals, one to each side."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from casadi_contact.geometry.mesh import TriangleMesh

_LEAST_COS = np.cos(np.deg2rad(40.0))  # between the normals of two triangles: beyond, their edge is a crease


def split_at_creases(mesh: TriangleMesh) -> TriangleMesh:
    """The same triangles, none of which shares a vertex with one that lies across a crease.

    Around each vertex, triangles that are joined by edges which are no creases keep it in common; every other group of
    them gets a copy of it. An edge of more than two triangles joins none.
    """
    faces, count = mesh.faces, len(mesh.faces)
    normals = mesh.area_vectors_mm2
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    first, second = _joined_sides(faces)
    smooth = np.einsum("nk,nk->n", normals[first % count], normals[second % count]) >= _LEAST_COS
    first, second = first[smooth], second[smooth]
    # Side s of a triangle runs from its corner s to the next; corners are numbered like sides, corner·count + triangle.
    ends = [np.stack([side, (side + count) % (3 * count)]) for side in (first, second)]
    same = faces.T.ravel()[ends[0]] == faces.T.ravel()[ends[1]]
    ends[1] = np.where(same, ends[1], ends[1][::-1])
    links = sparse.coo_matrix((np.ones(ends[0].size), (ends[0].ravel(), ends[1].ravel())), shape=(3 * count,) * 2)
    _, group = connected_components(links, directed=False)
    _, one, numbers = np.unique(group, return_index=True, return_inverse=True)
    vertices = mesh.vertices_mm[faces.T.ravel()[one]]
    return TriangleMesh(mesh.name, vertices, numbers.reshape(3, count).T, mesh.dropped)


def _joined_sides(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of sides, side·faces + triangle, that are one edge of two triangles."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, edge, times = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    pairs = order[times[edge.ravel()[order]] == 2]
    return pairs[::2], pairs[1::2]
