"""A triangle mesh in mm: its triangles, its edges and parts of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casadi_contact.conventions import Array


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A checked mesh: vertices_mm (v, 3), faces (f, 3) anticlockwise seen from outside; dropped: degenerate and
    repeated ones."""

    name: str
    vertices_mm: Array
    faces: np.ndarray
    dropped: int = 0

    @property
    def corners_mm(self) -> Array:
        """Corners of every triangle (f, 3, 3)."""
        return self.vertices_mm[self.faces]

    @property
    def area_vectors_mm2(self) -> Array:
        """Outward normal times area of every triangle (f, 3)."""
        a, b, c = np.moveaxis(self.corners_mm, 1, 0)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def normals(self) -> Array:
        """Outward unit normal of every triangle (f, 3)."""
        vectors = self.area_vectors_mm2
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

    @property
    def joined_sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of sides that are one edge of just two triangles; side k·f + triangle runs from its corner k to the
        next."""
        _, edge, count = np.unique(undirected_edges(self.faces), axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(edge.ravel(), kind="stable")
        pairs = order[count[edge.ravel()[order]] == 2]
        return pairs[::2], pairs[1::2]

    @cached_property
    def nonmanifold_edges(self) -> np.ndarray:
        """Edges (e, 2) that join more than two triangles."""
        edges, count = np.unique(undirected_edges(self.faces), axis=0, return_counts=True)
        return edges[count > 2]

    @cached_property
    def boundary_edges(self) -> np.ndarray:
        """Edges (e, 2) that belong to one triangle only; none if the mesh is closed."""
        edges, count = np.unique(undirected_edges(self.faces), axis=0, return_counts=True)
        return edges[count == 1]

    @property
    def extent(self) -> str:
        """Lowest and highest coordinates [mm] in words."""
        return f"{point_words(self.vertices_mm.min(axis=0))} to {point_words(self.vertices_mm.max(axis=0))}"

    def inside_box(self, low: Array, high: Array, *, reaching: bool = False) -> TriangleMesh:
        """The triangles whose centre lies inside the box [mm], or all that reach into it; ValueError if none does."""
        corners = self.corners_mm
        lowest, highest = (corners.min(axis=1), corners.max(axis=1)) if reaching else (corners.mean(axis=1),) * 2
        inside = np.all((highest >= low) & (lowest < high), axis=1)
        if not inside.any():
            raise ValueError(
                f"mesh {self.name}: no triangle between {point_words(low)} and {point_words(high)} mm, "
                f"expected a part of {self.extent}: check the box, units and axes"
            )
        return self.part(inside)

    def part(self, chosen: np.ndarray) -> TriangleMesh:
        """The chosen triangles (f,) with the vertices that they use."""
        used, renumbered = np.unique(self.faces[chosen], return_inverse=True)
        return TriangleMesh(self.name, self.vertices_mm[used], renumbered.reshape(-1, 3), self.dropped)


def directed_edges(faces: np.ndarray) -> np.ndarray:
    """Sides (3f, 2) as their triangles run through them: all first ones, then all second, then all third."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def undirected_edges(faces: np.ndarray) -> np.ndarray:
    """The same with the lower vertex first."""
    return np.sort(directed_edges(faces), axis=1)


def point_words(point: Array) -> str:
    """A point's coordinates for a message."""
    return "(" + ", ".join(f"{v:.4g}" for v in point) + ")"
