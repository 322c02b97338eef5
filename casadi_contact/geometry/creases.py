"""Creases of a mesh: edges at which the surface has two normals, one to each side."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from casadi_contact.conventions import Array
from casadi_contact.geometry.triangle_mesh import TriangleMesh, directed_edges

_LEAST_COS = np.cos(np.deg2rad(40.0))  # between the normals of two triangles: beyond, their edge is a crease


def split_at_creases(mesh: TriangleMesh) -> TriangleMesh:
    """The same triangles, none of which shares a vertex with one that lies across a crease.

    Around each vertex, triangles that are joined by edges which are no creases keep it in common; every other group of
    them gets a copy of it. An edge of more than two triangles joins none.
    """
    count, (first, second) = len(mesh.faces), mesh.joined_sides
    smooth = ~_are_creases(mesh, first, second)
    first, second = first[smooth], second[smooth]
    # Corners are numbered like the sides that begin there; a side ends where the next one begins.
    corner = mesh.faces.T.ravel()
    ends = [np.stack([side, (side + count) % (3 * count)]) for side in (first, second)]
    ends[1] = np.where(corner[ends[0]] == corner[ends[1]], ends[1], ends[1][::-1])
    links = sparse.coo_matrix((np.ones(ends[0].size), (ends[0].ravel(), ends[1].ravel())), shape=(3 * count,) * 2)
    _, group = connected_components(links, directed=False)
    _, one, numbers = np.unique(group, return_index=True, return_inverse=True)
    return TriangleMesh(mesh.name, mesh.vertices_mm[corner[one]], numbers.reshape(3, count).T, mesh.dropped)


def creases(mesh: TriangleMesh) -> tuple[Array, np.ndarray]:
    """Ends (e, 2, 3) [mm] of the creases, and the two triangles (e, 2) that meet there."""
    first, second = mesh.joined_sides
    sides = np.stack([first, second], axis=1)[_are_creases(mesh, first, second)]
    return mesh.vertices_mm[directed_edges(mesh.faces)[sides[:, 0]]], sides % len(mesh.faces)


def smooth_regions(mesh: TriangleMesh) -> np.ndarray:
    """The number (f,) of the region that each triangle lies in: within one, triangles hang together by edges that are
    no creases. A crease that ends in a region has it on both sides."""
    first, second = mesh.joined_sides
    smooth, count = ~_are_creases(mesh, first, second), len(mesh.faces)
    pairs = first[smooth] % count, second[smooth] % count
    links = sparse.coo_matrix((np.ones(len(pairs[0])), pairs), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])


def _are_creases(mesh: TriangleMesh, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Which pairs of sides (e,), (e,) are creases."""
    count, normals = len(mesh.faces), mesh.normals
    return np.asarray(np.einsum("nk,nk->n", normals[first % count], normals[second % count]) < _LEAST_COS)
