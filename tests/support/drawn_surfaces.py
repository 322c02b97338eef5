"""Areas of drawn triangles."""

import numpy as np


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
