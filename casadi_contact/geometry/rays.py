"""Exact rays against flat triangles: Embree finds the triangle, the hit on it is worked out in double precision."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.triangle_mesh import TriangleMesh


class RayCaster:
    """First hits of rays on a mesh, by Embree (through trimesh and embreex), which works in single precision.

    It is given the mesh about the mesh's own middle: a scan's coordinates leave single precision no room for the mesh.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        try:
            import trimesh
            from trimesh.ray.ray_pyembree import RayMeshIntersector
        except ImportError:
            raise ImportError("casting rays needs trimesh and embreex: pip install casadi_contact[mesh]") from None
        self._middle = 0.5 * (mesh.vertices_mm.min(axis=0) + mesh.vertices_mm.max(axis=0))
        self._caster = RayMeshIntersector(trimesh.Trimesh(mesh.vertices_mm - self._middle, mesh.faces, process=False))
        self._corner = mesh.corners_mm[:, 0]
        self._area_vectors = mesh.area_vectors_mm2

    def first_hits(self, origins_mm: Array, directions: Array) -> tuple[Array, np.ndarray]:
        """Distance (n,) [mm] along each unit direction to the plane of the first triangle hit, and that triangle (n,).

        Where nothing is hit the distance is infinite and the triangle -1.
        """
        face = self._caster.intersects_first(origins_mm - self._middle, directions)
        hit = np.flatnonzero(face >= 0)
        area = self._area_vectors[face[hit]]
        distance = np.full(len(origins_mm), np.inf)
        along = np.einsum("nk,nk->n", directions[hit], area)
        distance[hit] = np.einsum("nk,nk->n", self._corner[face[hit]] - origins_mm[hit], area) / along
        return distance, face

    def leaves(self, directions: Array, face: np.ndarray) -> np.ndarray:
        """True (n,) where a ray that hit the face runs from the inside of the body to its outside."""
        out = np.einsum("nk,nk->n", directions, self._area_vectors[face]) > 0.0
        return out & (face >= 0)
