"""What the page draws: each patch's fixed surface with where C finds the pressure, the moving body, and the view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from casadi_contact.contact.cells.basis import Cells, hermite_products
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cells.patches import CellPatch, lay_cells, patch_charts
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.cup import Cup, CupFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.ray_hits import fixed_point
from casadi_contact.contact.polar.surfaces import SmoothPatch, u_range
from casadi_contact.core.conventions import ANATOMY, POSE_NAMES, Array
from casadi_contact.core.quantities import ANGLE, quantity
from casadi_contact.geometry.elements import tangents
from casadi_contact.geometry.moving_surface import CYLINDER, HALF_SPACE, NUMBERS_PER_ARC, SWEPT_ARCS, MovingSurface
from casadi_contact.pictures.page import anatomical_name, direction_formula, view_of
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh
from casadi_contact.scenes.shapes.shape import shape_named

_LEAST_AREA = 1e-12  # of a triangle [mm²]
_FLAT = 0.7  # size of the mean normal above which a layer goes down in one direction: not so for a cup


@dataclass(frozen=True, eq=False)
class Triangles:
    """points_mm (m, 3), their unit normals outwards (m, 3), and corners (k, 3) anticlockwise seen from outside."""

    points_mm: Array
    normals: Array
    corners: np.ndarray

    @classmethod
    def of_grid(cls, points_mm: Array, normals: Array) -> Triangles:
        """Of points (n, m, 3) in a grid with normals that say which side is outside."""
        quads = _quads(np.arange(points_mm[..., 0].size).reshape(1, *points_mm.shape[:2]))
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


_SIDE_MM = 0.7  # about, between points
_MOST_ALONG = 91  # of these, each way of a smooth surface
_SAME_DIGITS = 6  # of coordinates [mm]


@dataclass(frozen=True, eq=False)
class FixedSurface:
    """Triangles of a patch, and places (m, q) of their points, which ``foundation_pressures`` reads
    (``contact/c/*_depths.h``)."""

    triangles: Triangles
    places: Array


def fixed_surfaces(model: CompiledFoundation) -> list[FixedSurface]:
    """The fixed surface of each patch of a contact model; raises TypeError for a model without."""
    if isinstance(model, PolarFoundation):
        return [_chart_surface(patch) for patch in model.patches]
    if isinstance(model, CupFoundation):
        return [_cup_surface(model.cup)]
    if isinstance(model, CellFoundation):
        return [_cell_surface(lay_cells(chart, model.cells, cut=1), model.cells) for chart in patch_charts(model.scene)]
    raise TypeError(f"{model!r} has no surface to draw, expected a model made by cc.foundation")


def _chart_surface(patch: SmoothPatch) -> FixedSurface:
    """Over the chart; places are (u, v)."""
    v = np.linspace(*patch.rim.v, _count(patch.rim.v[1] - patch.rim.v[0]))
    start, end = u_range(patch, v)
    u = start + np.linspace(0.0, 1.0, _count(float((end - start).max())))[:, None] * (end - start)
    places = np.stack([u, np.broadcast_to(v, u.shape)], -1)
    c, N, _ = fixed_point(patch, places[..., 0], places[..., 1])
    normals = N / np.linalg.norm(N, axis=-1, keepdims=True)
    return FixedSurface(Triangles.of_grid(c @ patch.turn, normals @ patch.turn), places.reshape(-1, 2))


def _cup_surface(cup: Cup) -> FixedSurface:
    """Circles about the pole; places are directions from the cup's centre."""
    angle = np.linspace(0.0, cup.half_angle, _count(cup.radius * cup.half_angle))
    turn = np.linspace(0.0, 2.0 * np.pi, 4 * len(angle) + 1)
    first, second = tangents(cup.pole)
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    e = np.cos(angle)[:, None, None] * cup.pole + np.sin(angle)[:, None, None] * around
    return FixedSurface(Triangles.of_grid(cup.centre + cup.radius * e, -e), e.reshape(-1, 3))


def _cell_surface(patch: CellPatch, cells: Cells) -> FixedSurface:
    """The cells that are whole at least by half, each cut into smaller ones; places are points with their normals."""
    corners = patch.corners[patch.present.mean(axis=1) > 0.5]
    cut = [max(1, round(size / _SIDE_MM)) for size in (cells.u_mm, cells.v_mm)]
    xi, eta = (np.linspace(0.0, 1.0, count + 1) for count in cut)
    values = np.concatenate([patch.c[:, None], patch.tangents], 1)[corners].reshape(len(corners), 12, 3)
    points = np.einsum("jr,kji->kri", hermite_products(xi, eta), values)
    shares = np.stack([np.outer(x, y).ravel() for x in (1.0 - xi, xi) for y in (1.0 - eta, eta)])
    normals = np.einsum("cr,kci->kri", shares, patch.n[corners])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rounded = np.round(points.reshape(-1, 3), _SAME_DIGITS)  # neighbouring cells share the points of their sides
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(len(corners), len(xi), len(eta))
    # Few digits of places compress well, and drawn points are no more exact.
    c, n = (array.reshape(-1, 3)[first].astype(np.float32).astype(float) for array in (points, normals))
    return FixedSurface(Triangles.of_quads(c, n, _quads(number)), np.concatenate([c, n], 1))


def _quads(number: np.ndarray) -> np.ndarray:
    """Corners (k, 4) of the faces between points numbered (cells, n, m)."""
    return np.stack([number[:, :-1, :-1], number[:, 1:, :-1], number[:, 1:, 1:], number[:, :-1, 1:]], -1).reshape(-1, 4)


def _count(length_mm: float) -> int:
    return int(np.clip(round(length_mm / _SIDE_MM), 8, _MOST_ALONG - 1)) + 1


_STEP_RAD = np.deg2rad(4.0)
_FIRST_RAD, _LAST_RAD = np.deg2rad(-45.0), np.deg2rad(130.0)  # of a condyle: beyond, there is none in reality
_TUBE_RAD = np.deg2rad(52.0)
MOST_TRIANGLES = 6000  # of a mesh: on a femoral component within 0.05 mm of 25,000, and drawn four times as fast
_HALF_LENGTH_MM = 40.0  # of what has no end: a cylinder, a flat punch


def moving_body(scene: Scene) -> Triangles:
    """The mesh of a mesh scene, the surfaces of any other."""
    if scene.shape != "mesh":
        parts = {surface.parameters.tobytes(): surface for surface in scene.surfaces()}
        return Triangles.together([_surface(surface) for surface in parts.values()])
    mesh = body_mesh(scene.geometry, "moving")
    points, faces = fewer_triangles(mesh.vertices_mm, mesh.faces)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    normals = np.zeros_like(points)
    np.add.at(normals, faces.ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return Triangles(points, normals, faces)


def fewer_triangles(points_mm: Array, faces: np.ndarray) -> tuple[Array, np.ndarray]:
    """Points (m, 3) and faces (k, 3) of a mesh with at most `MOST_TRIANGLES`, by quadric error metrics (Garland and
    Heckbert 1997, libigl's)."""
    if len(faces) <= MOST_TRIANGLES:
        return points_mm, faces
    import igl

    return igl.qslim(np.asfortranarray(points_mm), np.asfortranarray(faces, dtype=np.int32), MOST_TRIANGLES)[:2]


def _surface(surface: MovingSurface) -> Triangles:
    if surface.family == SWEPT_ARCS:
        return _swept_arcs(surface)
    if surface.family == CYLINDER:
        turn, z = _angles(-np.pi, np.pi), np.array([-_HALF_LENGTH_MM, _HALF_LENGTH_MM])
        flat = np.stack([np.cos(turn), np.sin(turn)], 1)[:, None].repeat(2, 1)
        points = np.concatenate([surface.parameters[0] * flat, np.broadcast_to(z[:, None], (len(turn), 2, 1))], -1)
        return Triangles.of_grid(points, np.concatenate([flat, np.zeros((len(turn), 2, 1))], -1))
    if surface.family == HALF_SPACE:
        x, z = np.meshgrid([-_HALF_LENGTH_MM, _HALF_LENGTH_MM], [-_HALF_LENGTH_MM, _HALF_LENGTH_MM], indexing="ij")
        points = np.stack([x, np.zeros((2, 2)), z], -1)
        return Triangles.of_grid(points, np.broadcast_to([0.0, -surface.parameters[0], 0.0], (2, 2, 3)))
    raise ValueError(f"the moving surface has the family {surface.family}, which has no picture")


def _swept_arcs(surface: MovingSurface) -> Triangles:
    """Rows along the arcs' polar angle φ, from -y towards +x, and about the tube; a whole ball where it is one."""
    count, radius, centre_z = int(surface.parameters[0]), *surface.parameters[1:3]
    arcs = surface.parameters[3:].reshape(-1, NUMBERS_PER_ARC)
    ball = count == 1 and arcs[0, 2] == 0.0
    ends = [np.arctan2(ty, tx) for *_, tx, ty in arcs[:-1]]
    bounds = [-np.pi, np.pi] if ball else [_FIRST_RAD, *ends, _LAST_RAD]
    tube = _angles(-0.5 * np.pi, 0.5 * np.pi) if ball else _angles(-_TUBE_RAD, _TUBE_RAD)
    points, normals = [], []
    for (axis_x, axis_y, offset, *_), low, high in zip(arcs, bounds[:-1], bounds[1:], strict=True):
        angle = _angles(low, high)
        out = np.stack([np.sin(angle), -np.cos(angle), 0.0 * angle], 1)[:, None]
        normal = np.cos(tube)[:, None] * out + np.sin(tube)[:, None] * np.array([0.0, 0.0, 1.0])
        points.append(np.array([axis_x, axis_y, centre_z]) + offset * out + radius * normal)
        normals.append(normal)
    return Triangles.of_grid(np.concatenate(points), np.concatenate(normals))


def _angles(low: float, high: float) -> np.ndarray:
    return np.linspace(low, high, max(2, round((high - low) / _STEP_RAD) + 1))


_TURNS = {"rx": ("Ab-/adduction", ("−", "+")), "ry": ("Axial rotation", ("−", "+"))}
_TURNS |= {"rz": ("Flexion", ("flexed", "hyperextended"))}
_EYE_SHARES = (0.62, 0.75, 0.25)  # towards the viewer of the map, its top, its right: where the eye is at first
_DISTANCE = 4.4  # of the eye, in half extents of the fixed surface
_LIFT = 0.06  # of what the eye looks at above the surface's middle, in distances


def map_view(model: ElasticFoundation, points_mm: Array) -> dict[str, Any]:
    """Directions right, up and towards the viewer of the pressure map of fixed points (m, 3), with names, the points'
    bounds along them [mm], the axes that sections lie across with signs, and the first eye. A surface that is pressed
    from above or below is shown with anterior up, any other with superior up."""
    toward = view_of(model).toward.pointing
    rough = np.array([-1.0, 0.0, 0.0]) if abs(toward[1]) > np.sqrt(0.5) else np.array([0.0, 1.0, 0.0])
    up = rough - (rough @ toward) * toward
    up /= np.linalg.norm(up)
    right = np.cross(up, toward)
    name = anatomical_name if shape_named(model.scene.shape).anatomical else direction_formula
    ways = {"right": right, "left": -right, "top": up, "bottom": -up}
    eye = sum(share * way for share, way in zip(_EYE_SHARES, (toward, up, right), strict=True))
    axes = np.stack([right, up, toward])
    bounds = np.stack([(points_mm @ axes.T).min(axis=0), (points_mm @ axes.T).max(axis=0)], 1)
    distance = _DISTANCE * 0.5 * float(np.linalg.norm(np.ptp(points_mm, axis=0)))
    planes = {}
    for across, way in (("up", up), ("right", right)):
        sign = 1 if way[np.abs(way).argmax()] > 0.0 else -1
        planes[across] = [direction_formula(sign * way), sign]
    return {
        "right": right.tolist(),
        "up": up.tolist(),
        "toward": toward.tolist(),
        "names": {way: name(direction) for way, direction in ways.items()},
        "planes": planes,
        "eye": (eye / np.linalg.norm(eye)).tolist(),
        "bounds": bounds.tolist(),
        "target": (bounds.mean(axis=1) @ axes + _LIFT * distance * toward).tolist(),
        "distance": distance,
    }


def pose_words(scene_shape: str, ranges: Array) -> list[dict[str, Any]]:
    """Name, label, unit of its slider and its factor, range [mm, rad] and the words at both ends of each parameter."""
    anatomical, found = shape_named(scene_shape).anatomical, []
    for name, bounds in zip(POSE_NAMES, ranges.tolist(), strict=True):
        turns, (grows, falls) = quantity(name).kind == ANGLE, ANATOMY[name[1]]
        label, ends = _TURNS[name] if turns else (f"{falls.capitalize()}–{grows}", (falls, grows))
        if not anatomical:
            label, ends = name, ("−", "+") if turns else ("", "")
        unit, factor = ("°", float(np.degrees(1.0))) if turns else ("mm", 1.0)
        words = {"name": name, "label": label, "unit": unit, "factor": factor}
        found.append({**words, "range": bounds, "ends": list(ends)})
    return found
