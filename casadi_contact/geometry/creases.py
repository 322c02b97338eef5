"""Creases of a mesh: edges at which the surface has two normals, one to each side."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from casadi_contact.geometry.triangle_mesh import TriangleMesh

_LEAST_COS = np.cos(np.deg2rad(40.0))  # between the normals of two triangles: beyond, their edge is a crease


def split_at_creases(mesh: TriangleMesh) -> TriangleMesh:
    """The same triangles, none of which shares a vertex with one that lies across a crease.

    Around each vertex, triangles that are joined by edges which are no creases keep it in common; every other group of
    them gets a copy of it. An edge of more than two triangles joins none.
    """
    count, normals = len(mesh.faces), mesh.normals
    first, second = mesh.joined_sides
    smooth = np.einsum("nk,nk->n", normals[first % count], normals[second % count]) >= _LEAST_COS
    first, second = first[smooth], second[smooth]
    # Corners are numbered like the sides that begin there; a side ends where the next one begins.
    corner = mesh.faces.T.ravel()
    ends = [np.stack([side, (side + count) % (3 * count)]) for side in (first, second)]
    ends[1] = np.where(corner[ends[0]] == corner[ends[1]], ends[1], ends[1][::-1])
    links = sparse.coo_matrix((np.ones(ends[0].size), (ends[0].ravel(), ends[1].ravel())), shape=(3 * count,) * 2)
    _, group = connected_components(links, directed=False)
    _, one, numbers = np.unique(group, return_index=True, return_inverse=True)
    return TriangleMesh(mesh.name, mesh.vertices_mm[corner[one]], numbers.reshape(3, count).T, mesh.dropped)
