"""Areas of drawn triangles, and depths of contact at points of a drawn surface by NumPy."""

import numpy as np

from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.polar.ray_hits import ray_hits
from casadi_contact.core.conventions import rotation
from casadi_contact.geometry.surface_distances import distance_gradients


def area_vectors_mm2(triangles):
    """Normals (n, 3) of the triangles, each as long as its triangle's area."""
    a, b, c = np.moveaxis(triangles.points_mm[triangles.corners], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def point_areas_mm2(triangles):
    """Areas (m,) that the points stand for: a third of every triangle around."""
    thirds = np.linalg.norm(area_vectors_mm2(triangles), axis=1) / 3.0
    areas = np.zeros(len(triangles.points_mm))
    np.add.at(areas, triangles.corners.ravel(), np.repeat(thirds, 3))
    return areas


def law_of(model):
    """The pressure law of all patches, as `contact.pressure_law.pressures` takes it."""
    return model.patches[0].law if isinstance(model, CellFoundation) else model.law


def depths(model, p, surface, pose):
    """Depths (m,) [mm] at the points of patch p in a pose (6,)."""
    R, t = rotation(pose[3:]), pose[:3]
    if isinstance(model, CupFoundation):
        b, radius = t - model.cup.centre, model.cup.ball_radius
        s = surface.places @ b
        return np.maximum(s + np.sqrt(np.maximum(radius**2 - b @ b + s * s, 0.0)) - model.cup.radius, 0.0)
    if isinstance(model, CellFoundation):
        c, n = surface.places[:, :3], surface.places[:, 3:]
        depth = np.zeros(len(c))
        outside = distance_gradients(model.patches[p].body, (c - t) @ R)[0] >= 0.0
        for _ in range(3):
            g, slope = distance_gradients(model.patches[p].body, (c - depth[:, None] * n - t) @ R)
            along = np.einsum("ij,ij->i", slope, n @ R)
            depth -= g / np.maximum(-along, 0.05)  # a distance that is level, or falls the other way, tells no depth
        return np.where(outside, 0.0, np.maximum(depth, 0.0))
    count = len(surface.places)
    ends = ray_hits(
        model.patches[p], np.broadcast_to(R, (count, 3, 3)), np.broadcast_to(t, (count, 3)), *surface.places.T
    )
    return np.maximum(ends.depth, 0.0)
