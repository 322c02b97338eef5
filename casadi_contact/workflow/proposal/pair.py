"""Two meshes, and how they come into contact: whether their files share a frame, which way the moving one presses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, build_field
from casadi_contact.geometry.triangle_mesh import TriangleMesh


@dataclass(frozen=True)
class PairSettings:
    """Lengths [mm] of a large joint; they are multiplied by `Pair.scale`."""

    spacing_mm: float = 1.5  # of the distance field
    longest_edge_mm: float = 4.0  # triangles with longer edges are divided: their centres represent the surface
    full_size_mm: float = 40.0  # extent of the fixed surface of a large joint
    most_points: int = 6000
    facing_cos: float = 0.5  # least cosine between a fixed normal and the direction to the moving body
    ahead_cos: float = 0.7  # least cosine between a normal and the direction of motion
    touch_mm: float = 0.02
    most_steps: int = 100


SETTINGS = PairSettings()


@dataclass(frozen=True, eq=False)
class Pair:
    """Points (n, 3) of the fixed mesh, their outward normals and areas [mm²], and the moving mesh's distance field.
    scale: size relative to a large joint, at most 1, which multiplies all lengths. is_open: the fixed mesh is."""

    points_mm: Array
    normals: Array
    areas_mm2: Array
    field: DistanceField
    moving: TriangleMesh
    scale: float
    is_open: bool

    @classmethod
    def of(cls, moving: TriangleMesh, fixed: TriangleMesh) -> Pair:
        """Represent the fixed mesh by the centres of its triangles; divide large ones, thin out very many evenly."""
        scale = min(1.0, extent_mm(fixed) / SETTINGS.full_size_mm)
        is_open = bool(len(fixed.boundary_edges))
        fixed = _divided(fixed, scale * SETTINGS.longest_edge_mm)
        count = min(len(fixed.faces), SETTINGS.most_points)
        chosen = np.linspace(0, len(fixed.faces) - 1, count).round().astype(int)
        vectors = fixed.area_vectors_mm2[chosen] * (len(fixed.faces) / len(chosen))
        areas = np.linalg.norm(vectors, axis=1)
        field = build_field(moving, scale * SETTINGS.spacing_mm)
        points = fixed.corners_mm[chosen].mean(axis=1)
        return cls(points, vectors / areas[:, None], areas, field, moving, scale, is_open)

    def distances(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Signed distances (n,) [mm] of the fixed points from the moving body at (R, t), and their gradients (n, 3) in
        the fixed frame."""
        distance, gradient = self.field((self.points_mm - t) @ R)
        return distance, gradient @ R.T

    def near(self, R: Array, t: Array, reach_mm: float, *, backs: bool = False) -> np.ndarray:
        """Mask (n,) of fixed points within reach of the moving body that face it (backs: that face away from it)."""
        distance, gradient = self.distances(R, t)
        facing = np.einsum("nk,nk->n", gradient, self.normals) * (1.0 if backs else -1.0)
        return np.asarray((distance < reach_mm) & (facing > SETTINGS.facing_cos))

    def dropped(self, R: Array, t: Array, direction: Array) -> Array | None:
        """The translation (3,) of first touch if the moving body comes along a direction from far away, in steps of the
        smallest gap; None if it passes by, or an open surface comes with its hollow side ahead."""
        size = np.linalg.norm(np.ptp(self.points_mm, axis=0)) + np.linalg.norm(np.ptp(self.moving.vertices_mm, axis=0))
        vertices = self.moving.vertices_mm @ R.T + t
        back = (vertices @ direction).max() - (self.points_mm @ direction).min()
        t, travelled = t - (back + 1.0) * direction, 0.0
        for _ in range(SETTINGS.most_steps):
            gap = float(self.distances(R, t)[0].min())
            if gap < SETTINGS.touch_mm:
                return t if gap > -self.scale * SETTINGS.spacing_mm else None
            t, travelled = t + gap * direction, travelled + gap
            if travelled > 2.0 * size:
                return None
        return t

    def touching(self, R: Array, t: Array, direction: Array) -> Array:
        """The translation (3,) near `t` at which the bodies just touch, moved along a direction or back, at points
        where both surfaces face along it, not walls that the body slides past."""
        for _ in range(SETTINGS.most_steps):
            distance, gradient = self.distances(R, t)
            ahead = SETTINGS.ahead_cos
            facing = (gradient @ direction > ahead) & (self.normals @ direction < -ahead)
            gap = float(distance[facing].min(initial=np.inf))
            if not SETTINGS.touch_mm < abs(gap) < np.inf:
                break
            t = t + gap * direction
        return t


def extent_mm(mesh: TriangleMesh) -> float:
    """Largest extent along an axis."""
    return float(np.ptp(mesh.vertices_mm, axis=0).max())


def _divided(mesh: TriangleMesh, longest_mm: float) -> TriangleMesh:
    """The mesh without longer edges, unless most of its area has short edges already."""
    edges = np.linalg.norm(mesh.corners_mm - np.roll(mesh.corners_mm, 1, axis=1), axis=2).max(axis=1)
    areas = mesh.areas_mm2
    is_fine = areas[edges > longest_mm].sum() < 0.5 * areas.sum()
    return mesh if is_fine else mesh.subdivided(longest_mm)


def unit_rows(vectors: Array) -> Array:
    """Vectors (n, 3) divided by their lengths."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def centre_of_normals(points_mm: Array, normals: Array, weights: Array, regularisation: float = 2e-3) -> Array:
    """The point (3,) nearest to the lines through the points along their normals: a sphere's centre, a condyle's axis.
    Minimises Σ w |(I - n nᵀ)(x - p)|² + regularisation · |x - mean|², which stays near the points if the lines are
    nearly parallel."""
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    weights = weights / weights.sum()
    middle = weights @ points_mm
    matrix = np.einsum("n,nij->ij", weights, across) + regularisation * np.eye(3)
    return np.asarray(middle + np.linalg.solve(matrix, np.einsum("n,nij,nj->i", weights, across, points_mm - middle)))


REACH_MM = 2.0  # surfaces nearer than this count as near contact


@dataclass(frozen=True, eq=False)
class ContactPlacement:
    """Where the moving body touches the fixed one. together: the files place both in one frame. pressing (3,): unit
    vector along which it presses. translation_mm (3,): where it touches, unrotated. concentration: length of the mean
    outward normal of the fixed surface nearby, 1 for a plane, 1/2 for a half-sphere. doubtful: other directions along
    which the bodies come near each other over 0.4 of that area and more."""

    together: bool
    pressing: Array
    translation_mm: Array
    concentration: float
    doubtful: tuple[Array, ...] = ()


AXES = np.vstack([-np.eye(3), np.eye(3)])[[1, 4, 0, 2, 3, 5]]  # y first


def contact_placement(pair: Pair, ways: Array = AXES) -> ContactPlacement:
    """The placement of the files if the bodies just touch there, else that of a drop along one of the ways (n, 3), or
    any axis. Raises ValueError for bodies that do not touch, and for surfaces that are inside out."""
    placement = _as_placed(pair)
    if placement is None and pair.is_open and _near_as_placed(pair, backs=True) is not None:
        raise ValueError("the fixed surface faces away from the moving one nearby: turn its triangles round")
    placement = placement or _after_drop(pair, ways) or _after_drop(pair)
    if placement is None:
        raise ValueError("the bodies meet along no axis: are both surfaces' outsides turned to each other?")
    _check_moving_outside(pair, placement)
    return placement


def _check_moving_outside(pair: Pair, placement: ContactPlacement, most_gain: float = 2.0) -> None:
    """Raise ValueError for an open moving surface whose reverse would be near the fixed one over a far larger area."""
    moving = pair.moving
    if not len(moving.boundary_edges):
        return
    reverse = TriangleMesh(moving.name, moving.vertices_mm, moving.faces[:, ::-1])
    turned = replace(pair, field=build_field(reverse, pair.scale * SETTINGS.spacing_mm), moving=reverse)
    other = _as_placed(turned) or _after_drop(turned)
    if other is None:
        return
    both, reach_mm = ((pair, placement), (turned, other)), pair.scale * REACH_MM
    area, turned_area = (float(pair.areas_mm2 @ of.near(np.eye(3), at.translation_mm, reach_mm)) for of, at in both)
    if turned_area > most_gain * area:
        areas = f"{turned_area:.3g} mm² with its inside out, {area:.3g} mm² as it is"
        raise ValueError(f"the moving surface {moving.name} touches {areas}: turn its triangles round")


def _as_placed(pair: Pair) -> ContactPlacement | None:
    near = _near_as_placed(pair)
    if near is None:
        return None
    pressing, concentration = _pressing(pair, near)
    return ContactPlacement(True, pressing, pair.touching(np.eye(3), np.zeros(3), pressing), concentration)


def _near_as_placed(pair: Pair, *, backs: bool = False) -> np.ndarray | None:
    """Mask (n,) of the fixed surface near the moving body where the files place them (backs: facing away from it). None
    if the bodies overlap by more than 4 mm, or less than 3 % of the fixed surface is near."""
    near = pair.near(np.eye(3), np.zeros(3), pair.scale * REACH_MM, backs=backs)
    depth = -float(pair.distances(np.eye(3), np.zeros(3))[0].min())
    touch = depth < pair.scale * 4.0 and pair.areas_mm2[near].sum() > 0.03 * pair.areas_mm2.sum()
    return near if touch else None


def _after_drop(pair: Pair, ways: Array = AXES) -> ContactPlacement | None:
    """The drop along one of the ways (n, 3) after which most of the fixed surface is near; two planes that meet, such
    as the backs of two parts, count a fifth."""
    middle = 0.5 * (pair.points_mm.min(axis=0) + pair.points_mm.max(axis=0))
    vertices = pair.moving.vertices_mm
    centred = middle - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    largest, placement, areas = 0.0, None, np.zeros(len(ways))
    for start in (np.zeros(3), centred):
        for k, direction in enumerate(ways):
            touched = pair.dropped(np.eye(3), start, direction)
            if touched is None:
                continue
            near = pair.near(np.eye(3), touched, pair.scale * REACH_MM) & (pair.normals @ direction < 0.0)
            area = float(pair.areas_mm2[near].sum()) * (0.2 if _are_planes(pair, near, touched) else 1.0)
            areas[k] = max(areas[k], area)
            if area > 1.2 * largest:  # prefer earlier directions: y first, and the files' own translation
                largest, placement = area, ContactPlacement(False, direction, touched, _pressing(pair, near)[1])
    if placement is None:
        return None
    doubtful = ways[(areas > 0.4 * largest) & (ways @ placement.pressing < 0.5)]
    return replace(placement, doubtful=tuple(doubtful))


def _are_planes(pair: Pair, near: np.ndarray, translation_mm: Array) -> bool:
    """Whether more than 60 % of either surface near contact is parallel to its mean."""
    area = pair.areas_mm2[near]
    if not area.sum():
        return False
    gradients = pair.distances(np.eye(3), translation_mm)[1][near]
    for normals in (pair.normals[near], unit_rows(gradients)):
        mean = area @ normals / np.linalg.norm(area @ normals)
        if area @ (normals @ mean > 0.998) < 0.6 * area.sum():
            return False
    return True


def _pressing(pair: Pair, near: np.ndarray) -> tuple[Array, float]:
    """Minus the mean normal (3,) of the near surface, and the length of the mean before normalisation."""
    area = pair.areas_mm2[near]
    mean = area @ pair.normals[near] / max(area.sum(), 1e-300)
    length = float(np.linalg.norm(mean))
    return -mean / max(length, 1e-300), length
