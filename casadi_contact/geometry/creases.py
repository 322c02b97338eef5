"""Creases of a mesh: edges at which the surface has two normals, one to each side."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.triangle_mesh import TriangleMesh, directed_edges


def split_at_creases(mesh: TriangleMesh) -> TriangleMesh:
    """The same triangles, none of which shares a vertex with one that lies across a crease. Around each vertex,
    triangles that are joined by edges which are no creases keep it in common; every other group of them gets a copy of
    it. An edge of more than two triangles joins none."""
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


def beside_creases(mesh: TriangleMesh, points: Array, face: np.ndarray, reach_mm: float) -> np.ndarray:
    """Numbers of the points (m, 3) within reach of a relevant crease. A crease counts if one of its two triangles alone
    is among the triangles (k,), or both in different smooth regions. A crease that ends within a region is a fillet of
    few triangles, and the edge of a region smaller than the reach is noise; both are ignored."""
    ends, triangles = creases(mesh)
    regions = smooth_regions(mesh)
    large = np.bincount(regions, mesh.areas_mm2)[regions] > reach_mm**2
    inside, parted = np.isin(triangles, face), np.diff(regions[triangles])[:, 0] != 0
    ends = ends[inside.any(axis=1) & (~inside.all(axis=1) | (parted & large[triangles].all(axis=1)))]
    if not len(ends):
        return np.zeros(0, dtype=int)
    longest = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max()
    share = np.linspace(0.0, 1.0, 2 + int(2.0 * longest / reach_mm))[:, None, None]
    along = ((1.0 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 3)
    return np.flatnonzero(cKDTree(along).query(points, distance_upper_bound=reach_mm)[0] < np.inf)


def _are_creases(mesh: TriangleMesh, first: np.ndarray, second: np.ndarray, least_deg: float = 40.0) -> np.ndarray:
    """Mask of pairs of sides (e,), (e,) that are creases: the normals of their triangles differ by more than 40°."""
    count, normals = len(mesh.faces), mesh.normals
    return np.asarray(
        np.einsum("nk,nk->n", normals[first % count], normals[second % count]) < np.cos(np.deg2rad(least_deg))
    )
