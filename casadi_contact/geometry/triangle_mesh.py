"""A triangle mesh in mm: its triangles, edges, parts and creases (edges with two normals), and exact rays."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from casadi_contact.core.conventions import Array


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A checked mesh: vertices_mm (v, 3), faces (f, 3) anticlockwise seen from outside; dropped: degenerate and
    repeated ones; slivers (s, 3): those of the dropped that have three corners but no area."""

    name: str
    vertices_mm: Array
    faces: np.ndarray
    dropped: int = 0
    slivers: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))

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
    def areas_mm2(self) -> Array:
        """Area of every triangle (f,)."""
        return np.asarray(np.linalg.norm(self.area_vectors_mm2, axis=1))

    @property
    def normals(self) -> Array:
        """Outward unit normal of every triangle (f, 3)."""
        vectors = self.area_vectors_mm2
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

    @cached_property
    def joined_sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of sides that are one edge of just two triangles; side k·f + triangle begins at its corner k."""
        _, edge, count = distinct_edges(self.faces)
        order = np.argsort(edge, kind="stable")
        pairs = order[count[edge[order]] == 2]
        return pairs[::2], pairs[1::2]

    @cached_property
    def nonmanifold_edges(self) -> np.ndarray:
        """Edges (e, 2) that join more than two triangles."""
        edges, _, count = distinct_edges(self.faces)
        return edges[count > 2]

    @cached_property
    def boundary_edges(self) -> np.ndarray:
        """Edges (e, 2) that belong to one triangle only; none if the mesh is closed. Edges of a gap that dropped
        slivers filled do not count: the gap has no width."""
        edges, _, count = distinct_edges(self.faces)
        single = edges[count == 1]
        filled, _, times = distinct_edges(self._gap_fillers)
        size = len(self.vertices_mm)
        return single[~np.isin(single @ [size, 1], filled[times % 2 == 1] @ [size, 1])]

    @cached_property
    def open_sides(self) -> np.ndarray:
        """True (f, 3) for the sides of triangles, from corner k to the next, that are boundary edges."""
        size = len(self.vertices_mm)
        codes = undirected_edges(self.faces) @ [size, 1]
        return np.asarray(np.isin(codes, self.boundary_edges @ [size, 1]).reshape(3, -1).T)

    @cached_property
    def open_corners(self) -> np.ndarray:
        """True (f, 3) for the corners of triangles at which a boundary edge ends."""
        return np.isin(self.faces, self.boundary_edges)

    @property
    def _gap_fillers(self) -> np.ndarray:
        """The slivers (s, 3) that fill gaps: of groups joined by edges that share each outer edge with a triangle. A
        group at an open rim has an outer edge that no triangle shares."""
        if not len(self.slivers):
            return self.slivers
        group, edges, edge_group, times = joined_by_edges(self.slivers)
        size = len(self.vertices_mm)
        beside = np.isin(edges @ [size, 1], undirected_edges(self.faces) @ [size, 1])
        return self.slivers[~np.isin(group, edge_group[~beside & (times == 1)])]

    @cached_property
    def pieces(self) -> np.ndarray:
        """The number (f,) of the piece that each triangle belongs to: one of triangles joined by edges and slivers."""
        group = joined_by_edges(np.concatenate([self.faces, self._gap_fillers]))[0][: len(self.faces)]
        return np.unique(group, return_inverse=True)[1].reshape(-1)

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
            box = f"between {point_words(low)} and {point_words(high)} mm"
            raise ValueError(f"mesh {self.name}: no triangle {box} of {self.extent}: check the box, units and axes")
        return self.part(inside)

    def part(self, chosen: np.ndarray) -> TriangleMesh:
        """The chosen triangles (f,) with the vertices that they use."""
        used, renumbered = np.unique(self.faces[chosen], return_inverse=True)
        number = np.full(len(self.vertices_mm), -1)
        number[used] = np.arange(len(used))
        slivers = number[self.slivers]
        slivers = slivers[(slivers >= 0).all(axis=1)]
        return TriangleMesh(self.name, self.vertices_mm[used], renumbered.reshape(-1, 3), self.dropped, slivers)

    def subdivided(self, longest_mm: float) -> TriangleMesh:
        """The mesh with edges halved, the longest of their triangles first, until none is longer; joined still."""
        vertices, faces = self.vertices_mm, self.faces
        while True:
            edges, number, times = distinct_edges(faces)
            lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
            rank, sides = np.argsort(np.argsort(lengths, kind="stable")), number.reshape(3, -1)
            longest = rank[sides].argmax(axis=0)
            own = sides[longest, np.arange(len(faces))]
            halved = (np.bincount(own, minlength=len(edges)) == times) & (lengths > longest_mm)
            cut = halved[own]
            if not cut.any():
                return TriangleMesh(self.name, vertices, faces)
            middle = (len(vertices) - 1 + np.cumsum(halved))[own[cut]]
            a, b, c = (faces[cut, (longest[cut] + k) % 3] for k in range(3))
            halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
            vertices = np.concatenate([vertices, vertices[edges[halved]].mean(axis=1)])
            faces = np.concatenate([faces[~cut], *halves])


def directed_edges(faces: np.ndarray) -> np.ndarray:
    """Sides (3f, 2) as their triangles run through them: all first ones, then all second, then all third."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def undirected_edges(faces: np.ndarray) -> np.ndarray:
    """The same with the lower vertex first."""
    return np.sort(directed_edges(faces), axis=1)


def distinct_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each edge once (e, 2), rising; the edge of every side (3f,) of `directed_edges`; sides of each edge (e,)."""
    size = int(faces.max(initial=0)) + 1  # one whole number for an edge sorts ten times as fast as two
    codes, edge, times = np.unique(undirected_edges(faces) @ [size, 1], return_inverse=True, return_counts=True)
    return np.stack([codes // size, codes % size], axis=1), edge.reshape(-1), times


def joined_by_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Groups of triangles joined by edges: of each triangle (f,); the edges (e, 2), their groups and triangles (e,)."""
    count, (edges, edge, times) = len(faces), distinct_edges(faces)
    triangle = np.tile(np.arange(count), 3)
    links = sparse.coo_matrix((np.ones(3 * count), (triangle, count + edge)), shape=(count + len(edges),) * 2)
    _, group = connected_components(links, directed=False)
    return group[:count], edges, group[count:], times


def point_words(point: Array) -> str:
    """A point's coordinates for a message."""
    return "(" + ", ".join(f"{v:.4g}" for v in point) + ")"


class RayCaster:
    """First hits of rays on a mesh, by Embree (through trimesh and embreex), which works in single precision. It is
    given the mesh about the mesh's own middle: a scan's coordinates leave single precision no room for the mesh."""

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
        Where nothing is hit the distance is infinite and the triangle -1."""
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


def split_at_creases(mesh: TriangleMesh) -> TriangleMesh:
    """The same triangles, none of which shares a vertex with one that lies across a crease. Around each vertex,
    triangles joined by edges that are no creases keep it; other groups get a copy. An edge of three joins none."""
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
