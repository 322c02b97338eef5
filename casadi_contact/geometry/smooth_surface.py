"""The smooth surface that a mesh's vertices lie on, and the signed distance from it.

Flat triangles cut the corners of a curved surface: at edges of 1 mm on a radius of 30 mm by 5 µm on average, tens of
per cent of the force at 0.1 mm overlap. Each triangle is therefore replaced by a curved point-normal (PN) patch
(Vlachos et al. 2001), a cubic through its corners and normal to the corners' normals, whose error falls with the
fourth power of the edge. The normals must be as good as that: they come from a quadric fitted to the vertices within
two edges of each vertex (an osculating jet, Cazals and Pouget 2005), not from averages of facet normals. At a crease,
such as a rim, each side has normals of its own: one between would bend long triangles of a flat wall by millimetres.
"""

from functools import partial

import numpy as np
from scipy import sparse

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import tangents
from casadi_contact.geometry.triangle_mesh import TriangleMesh, split_at_creases

EDGE_RADIUS_MM = 3.0


class SmoothSurface:
    """Signed distance from the smooth surface through a mesh's vertices: negative behind its triangles.

    Beyond an open edge of the mesh the surface is taken to round off with EDGE_RADIUS_MM, so that the distance stays
    continuous there. Closest points on the mesh come from libigl (exact, bounding-box tree).
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        try:
            import igl
        except ImportError:
            raise ImportError("smooth surfaces of meshes need libigl: pip install casadi_contact[mesh]") from None
        # The sign is that of the pseudonormal of the nearest triangle, edge or vertex (Bærentzen and Aanæs 2005).
        self._closest = partial(igl.signed_distance, sign_type=igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL)
        self._winding = partial(igl.fast_winding_number, mesh.vertices_mm, mesh.faces)
        self.mesh = mesh
        smooth = split_at_creases(mesh)
        self._corner_normals = fitted_normals(smooth)[smooth.faces]
        self._open_opposite = np.roll(mesh.open_sides, -1, axis=1)  # where share k is 0, the side opposite corner k

    def distance(self, points_mm: Array, chunk: int = 200_000) -> Array:
        """Signed distances (n,) [mm] of points (n, 3)."""
        starts = range(0, len(points_mm), chunk)
        return np.concatenate([self._distance(np.ascontiguousarray(points_mm[k : k + chunk])) for k in starts])

    def beyond_open_edges(self, points_mm: Array) -> np.ndarray:
        """True (n,) for points (n, 3) whose nearest point of the mesh lies on an open edge."""
        points = np.ascontiguousarray(points_mm, dtype=float)
        _, face, closest, _ = self._closest(points, self.mesh.vertices_mm, self.mesh.faces)
        return self._at_open_edge(face, _barycentric(self.mesh.corners_mm[face], closest))

    def along_lines(self, points_mm: Array, directions: Array, steps: int = 3) -> tuple[Array, Array]:
        """Intersections (n, 3) [mm] of lines through points (n, 3) of the mesh along directions (n, 3) with the smooth
        patch of each point's triangle, and its unit normals there (n, 3), by Newton's method."""
        on = np.ascontiguousarray(points_mm, dtype=float)
        _, face, _, _ = self._closest(on, self.mesh.vertices_mm, self.mesh.faces)
        for _ in range(steps):
            patch, normal = self._patch(face, _barycentric(self.mesh.corners_mm[face], on))
            rise = np.einsum("nk,nk->n", patch - on, normal) / np.einsum("nk,nk->n", directions, normal)
            on = on + rise[:, None] * directions
        return on, normal

    def _distance(self, points: Array, far_factor: float = 2.0, fan_tan: float = 0.4) -> Array:
        flat, face, closest, _ = self._closest(points, self.mesh.vertices_mm, self.mesh.faces)
        share = _barycentric(self.mesh.corners_mm[face], closest)
        on, normal = self._patch(face, share)
        offset = points - on
        height = np.einsum("ij,ij->i", offset, normal)
        aside2 = np.maximum(np.einsum("ij,ij->i", offset, offset) - height**2, 0.0)
        # Near the normal (within an angle of tangent fan_tan) the height over the tangent plane is the distance, to
        # second order in the error of the flat triangle's closest point. Beside a sharp edge, points far from the
        # normal have the distance of the edge. Beyond far_factor times the distance between triangle and patch, the
        # side is that of the mesh: at an edge the height over one of its triangles may have either sign.
        far = np.abs(flat) > far_factor * np.linalg.norm(on - closest, axis=1)
        size = np.sqrt(height**2 + np.maximum(aside2 - (fan_tan * height) ** 2, 0.0))
        distance = np.copysign(size, np.where(far, self._side(points, flat, far), height))
        edge = self._at_open_edge(face, share)
        rounded = np.sqrt(aside2 + (height + EDGE_RADIUS_MM) ** 2) - EDGE_RADIUS_MM
        beside = (height > -EDGE_RADIUS_MM) | (aside2 > height**2)  # else behind the surface, where no edge matters
        return np.where(edge & beside, rounded, distance)

    def _side(self, points: Array, flat: Array, far: np.ndarray) -> Array:
        """Numbers (n,) whose sign is that of the distance, at points far from the mesh. An open mesh has the sign of
        its pseudonormals, a closed one that of winding numbers, since folded triangles and self-intersections have
        wrong pseudonormals. Consecutive points share a winding number if their distances from the mesh add up to more
        than the way between them: then no surface lies there."""
        if len(self.mesh.boundary_edges) or not far.any():
            return flat
        side, there, away = flat.copy(), np.ascontiguousarray(points[far]), np.abs(flat[far])
        parted = away[1:] + away[:-1] <= np.linalg.norm(np.diff(there, axis=0), axis=1)
        row = np.concatenate([[0], np.cumsum(parted)])
        side[far] = (0.5 - self._winding(there[np.flatnonzero(np.diff(row, prepend=-1))]))[row]
        return side

    def _at_open_edge(self, face: np.ndarray, share: Array) -> np.ndarray:
        """Mask (n,) of points by shares (n, 3) of their face's corners: on an open side, or at a corner of one."""
        zero = share < 1e-9
        at_corner = (zero.sum(axis=1) == 2) & ((share > 0.5) & self.mesh.open_corners[face]).any(axis=1)
        return np.asarray((zero & self._open_opposite[face]).any(axis=1) | at_corner)

    def _patch(self, face: np.ndarray, share: Array) -> tuple[Array, Array]:
        """Point and unit normal of each face's PN patch at barycentric shares (n, 3)."""
        corners = np.moveaxis(self.mesh.vertices_mm[self.mesh.faces[face]], 1, 0)
        normals = np.moveaxis(self._corner_normals[face], 1, 0)
        u = share.T[:, :, None]
        point = sum(corners[i] * u[i] ** 3 for i in range(3))
        edges = np.zeros_like(corners[0])
        for i in range(3):
            for j in ((i + 1) % 3, (i + 2) % 3):
                # Control point a third of the way from i to j, in the tangent plane at i.
                rise = np.einsum("nk,nk->n", corners[j] - corners[i], normals[i])[:, None]
                control = (2.0 * corners[i] + corners[j] - rise * normals[i]) / 3.0
                point = point + 3.0 * control * u[i] ** 2 * u[j]
                edges += control / 6.0
        centre = edges + 0.5 * (edges - corners.mean(axis=0))
        point = point + 6.0 * centre * u[0] * u[1] * u[2]
        normal = np.einsum("inu,ink->nk", u, normals)
        return point, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def fitted_normals(mesh: TriangleMesh, least_cos: float = 0.8) -> Array:
    """Outward unit normal at every vertex (v, 3), by a quadric through the vertex fitted to those within two edges.

    In the frame of the area-averaged normal the neighbours at (x, y, z) give z = a·x + b·y + c·x² + d·x·y + e·y² by
    least squares weighted with 1/r; the normal is (-a, -b, 1). A vertex whose fitted and averaged normals have a cosine
    below least_cos lies on a sharp edge and keeps the averaged one. A vertex between a fillet of small triangles and a
    plane of large ones takes the normal of the large ones.
    """
    size = len(mesh.vertices_mm)
    averaged = np.zeros((size, 3))
    for corner in range(3):
        np.add.at(averaged, mesh.faces[:, corner], mesh.area_vectors_mm2)
    averaged /= np.maximum(np.linalg.norm(averaged, axis=1, keepdims=True), 1e-300)
    first, second = tangents(averaged)
    i, j = _neighbours(mesh.faces, size)
    offset = mesh.vertices_mm[j] - mesh.vertices_mm[i]
    reach = np.sqrt(np.bincount(i, (offset**2).sum(axis=1), size) / np.maximum(np.bincount(i, minlength=size), 1))
    x, y, z = (np.einsum("nk,nk->n", offset, axis[i]) / reach[i] for axis in (first, second, averaged))
    weight = 1.0 / np.maximum(np.hypot(x, y), 1e-6)
    terms = weight[:, None] * np.stack([x, y, x * x, x * y, y * y], axis=1)
    starts = np.searchsorted(i, np.arange(size))
    squares = np.add.reduceat(terms[:, :, None] * terms[:, None, :], starts)
    moments = np.add.reduceat(terms * (weight * z)[:, None], starts)
    coefficients = np.einsum("nij,nj->ni", np.linalg.pinv(squares, rcond=1e-10, hermitian=True), moments)
    fitted = averaged - coefficients[:, :1] * first - coefficients[:, 1:2] * second
    fitted /= np.linalg.norm(fitted, axis=1, keepdims=True)
    agree = np.einsum("nk,nk->n", fitted, averaged) > least_cos
    normals = np.where(agree[:, None], fitted, averaged)
    vertices, of_large = _normals_of_large_triangles(mesh)
    normals[vertices] = of_large
    return normals


def _normals_of_large_triangles(mesh: TriangleMesh, least_ratio: float = 8.0) -> tuple[np.ndarray, Array]:
    """The vertices (m,) at which one triangle has over 8 times the median area, and the normals (m, 3) of the largest.

    Normals fitted to the small triangles would bend the large one (a flat face beside its fillet) by tenths of a mm.
    """
    vertex, area = mesh.faces.T.ravel(), np.tile(mesh.areas_mm2, 3)
    order = np.lexsort((area, vertex))
    first, count = np.unique(vertex[order], return_index=True, return_counts=True)[1:]
    median, largest = area[order[first + (count - 1) // 2]], area[order[first + count - 1]]
    chosen = vertex[order[first]][largest > least_ratio * median]
    sums = np.zeros((len(mesh.vertices_mm), 3))
    np.add.at(sums, vertex, np.tile(mesh.area_vectors_mm2, (3, 1)) * area[:, None] ** 2)
    return chosen, sums[chosen] / np.linalg.norm(sums[chosen], axis=1, keepdims=True)


def _neighbours(faces: np.ndarray, size: int, most: int = 256) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (i, j), sorted by i, of different vertices at most two edges apart.

    Paths through a vertex with more neighbours than `most` are left out: the hub of a fan of 2,000 would need 2.5 GB.
    """
    i, j = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    near = sparse.coo_matrix((np.ones(len(i)), (i, j)), shape=(size, size)).tocsr()
    near = near + near.T
    ordinary = np.diff(near.indptr) <= most
    by = near if ordinary.all() else near[:, ordinary]
    pairs = (near + by @ by.T).tocoo()
    order = np.lexsort((pairs.col, pairs.row))
    i, j = pairs.row[order].astype(np.int64), pairs.col[order].astype(np.int64)
    return i[i != j], j[i != j]


def _barycentric(corners: Array, points: Array) -> Array:
    """Shares (n, 3) of the corners (n, 3, 3) in points of their planes, kept between 0 and 1."""
    from trimesh.triangles import points_to_barycentric

    shares = np.clip(points_to_barycentric(corners, points), 0.0, 1.0)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))
