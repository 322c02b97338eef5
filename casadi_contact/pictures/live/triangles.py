"""Surfaces as triangles, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array

_LEAST_AREA = 1e-12  # of a triangle [mm²]
_FLAT = 0.7  # size of the mean normal above which a layer goes down in one direction: not so for a cup


@dataclass(frozen=True, eq=False)
class Triangles:
    """points_mm (m, 3), their unit normals outwards (m, 3), and corners (k, 3) anticlockwise seen from outside."""

    points_mm: Array
    normals: Array
    corners: np.ndarray

    @classmethod
    def of_grid(cls, points_mm: Array, normals: Array, every: int = 1) -> Triangles:
        """Of points (n, m, 3) in a grid with normals that say which side is outside; corners are in every so many-th
        row and column, and in the last."""
        n, m = points_mm.shape[:2]
        rows, columns = (np.unique([*range(0, count, every), count - 1]) for count in (n, m))
        at = np.arange(n * m).reshape(n, m)[np.ix_(rows, columns)]
        quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], -1).reshape(-1, 4)
        return cls.of_quads(points_mm.reshape(-1, 3), normals.reshape(-1, 3), quads)

    @classmethod
    def of_quads(cls, points_mm: Array, normals: Array, quads: np.ndarray) -> Triangles:
        """Of four-sided faces (k, 4), their corners in order around."""
        corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        a, b, c = np.moveaxis(points_mm[corners], 1, 0)
        across = np.cross(b - a, c - a)
        inward = np.einsum("ij,ij->i", across, normals[corners[:, 0]]) < 0.0
        corners[inward] = corners[inward][:, ::-1]
        return cls(points_mm, normals, corners[np.einsum("ij,ij->i", across, across) > _LEAST_AREA**2])

    @classmethod
    def together(cls, parts: list[Triangles]) -> Triangles:
        """Several as one."""
        starts = np.cumsum([0, *(len(part.points_mm) for part in parts)])
        corners = [part.corners + start for part, start in zip(parts, starts, strict=False)]
        points, normals = [part.points_mm for part in parts], [part.normals for part in parts]
        return cls(np.concatenate(points), np.concatenate(normals), np.concatenate(corners))

    @property
    def rim(self) -> np.ndarray:
        """Edges (e, 2) that belong to one triangle alone."""
        edges = np.concatenate([self.corners[:, [0, 1]], self.corners[:, [1, 2]], self.corners[:, [2, 0]]])
        _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
        return edges[first[count == 1]]

    def behind(self, thickness_mm: float) -> Triangles:
        """The other side of a layer below the surface, with a wall from rim to rim: together they look like a body."""
        mean = self.normals.mean(axis=0)
        size = float(np.linalg.norm(mean))
        into = -mean / size if size > _FLAT else -self.normals
        below = self.points_mm + thickness_mm * into
        used, corners = np.unique(self.corners[:, ::-1], return_inverse=True)
        underside = Triangles(below[used], -self.normals[used], corners.reshape(-1, 3))
        first, second = self.rim.T
        points = np.stack([self.points_mm[first], self.points_mm[second], below[second], below[first]], 1)
        outward = np.cross(points[:, 1] - points[:, 0], self.normals[first])
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
        quads = np.arange(4 * len(points)).reshape(-1, 4)
        wall = Triangles.of_quads(points.reshape(-1, 3), np.repeat(outward, 4, axis=0), quads)
        return Triangles.together([underside, wall])
