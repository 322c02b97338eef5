"""What the page draws: the moving body as triangles in its own frame, and the view."""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import ANATOMY, POSE_NAMES, Array
from casadi_contact.core.quantities import ANGLE, quantity
from casadi_contact.geometry.moving_surface import CYLINDER, HALF_SPACE, NUMBERS_PER_ARC, SWEPT_ARCS, MovingSurface
from casadi_contact.pictures.live.fixed_surface import Triangles
from casadi_contact.pictures.view import anatomical_name, direction_formula, view_of
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.shape import shape_named

_STEP_RAD = np.deg2rad(4.0)
_FIRST_RAD, _LAST_RAD = np.deg2rad(-45.0), np.deg2rad(130.0)  # of a condyle: beyond, there is none in reality
_TUBE_RAD = np.deg2rad(52.0)
MOST_TRIANGLES = 6000  # of a mesh: on a femoral component within 0.05 mm of 25,000, and drawn four times as fast
_HALF_LENGTH_MM = 40.0  # of what has no end: a cylinder, a flat punch


def moving_body(scene: Scene) -> Triangles:
    """The meshes of a mesh scene, the surfaces of any other."""
    if scene.shape == "mesh":
        return _mesh(scene)
    parts = {surface.parameters.tobytes(): surface for surface in scene.surfaces()}
    return Triangles.together([_surface(surface) for surface in parts.values()])


def _mesh(scene: Scene) -> Triangles:
    from casadi_contact.scenes.shapes.mesh_bodies import body_mesh

    mesh = body_mesh(scene.geometry, "moving")
    points, faces = fewer_triangles(mesh.vertices_mm, mesh.faces)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    normals = np.zeros_like(points)
    np.add.at(normals, faces.ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return Triangles(points, normals, faces)


def fewer_triangles(points_mm: Array, faces: np.ndarray) -> tuple[Array, np.ndarray]:
    """Points (m, 3) and faces (k, 3) of a mesh with at most `MOST_TRIANGLES`, by quadric error metrics (Garland and
    Heckbert 1997, libigl's); the mesh itself where it has no more."""
    if len(faces) <= MOST_TRIANGLES:
        return points_mm, faces
    import igl

    ordered = (np.asfortranarray(points_mm), np.asfortranarray(faces, dtype=np.int32))
    points, fewer, *_ = igl.qslim(*ordered, MOST_TRIANGLES)
    return points, fewer


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
        return Triangles.of_grid(points, np.broadcast_to([0.0, -1.0, 0.0], (2, 2, 3)))
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


_TURNS = {"rx": "Ab-/adduction", "ry": "Axial rotation", "rz": "Flexion"}
_RIGHT_HANDED = {"rx": ("−", "+"), "ry": ("−", "+"), "rz": ("flexed", "extended")}
_EYE_SHARES = (0.62, 0.75, 0.25)  # towards the viewer of the map, its top, its right: where the eye is at first
_DISTANCE = 4.4  # of the eye, in half extents of the fixed surface


def map_view(model: ElasticFoundation, extent_mm: float) -> dict[str, Any]:
    """Directions to the right, up and towards the viewer of the pressure map, with their names, and the first eye.

    A surface that is pressed from above or below is shown with anterior up, any other with superior up.
    """
    toward = view_of(model).toward.pointing
    rough = np.array([-1.0, 0.0, 0.0]) if abs(toward[1]) > np.sqrt(0.5) else np.array([0.0, 1.0, 0.0])
    up = rough - (rough @ toward) * toward
    up /= np.linalg.norm(up)
    right = np.cross(up, toward)
    name = anatomical_name if shape_named(model.scene.shape).anatomical else direction_formula
    ways = {"right": right, "left": -right, "top": up, "bottom": -up}
    eye = sum(share * way for share, way in zip(_EYE_SHARES, (toward, up, right), strict=True))
    positive = up if up[np.abs(up).argmax()] > 0.0 else -up
    return {
        "right": right.tolist(),
        "up": up.tolist(),
        "toward": toward.tolist(),
        "names": {way: name(direction) for way, direction in ways.items()},
        "alongName": direction_formula(positive),
        "alongSign": 1 if positive is up else -1,
        "eye": (eye / np.linalg.norm(eye)).tolist(),
        "distance": _DISTANCE * extent_mm,
    }


def pose_words(scene_shape: str, ranges: Array) -> list[dict[str, Any]]:
    """Name, label, unit, range and the words at both ends of each pose parameter."""
    anatomical = shape_named(scene_shape).anatomical
    found = []
    for name, bounds in zip(POSE_NAMES, ranges.tolist(), strict=True):
        axis = name[1]
        if quantity(name).kind == ANGLE:
            label, ends = (_TURNS[name], _RIGHT_HANDED[name]) if anatomical else (name, ("−", "+"))
        else:
            grows, falls = ANATOMY[axis] if anatomical else ("+", "−")
            label, ends = (f"{falls.capitalize()}–{grows}", (falls, grows)) if anatomical else (name, ("", ""))
        found.append({"name": name, "label": label, "unit": quantity(name).unit, "range": bounds, "ends": list(ends)})
    return found
