"""Load on walls of the fixed mesh, which are too steep for elements and cells to be laid out on."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.contact.pressure import law_of, pressures
from casadi_contact.conventions import Array, as_poses, rotation
from casadi_contact.shapes.mesh_bodies import body_field, body_mesh
from casadi_contact.shapes.mesh_patches import patch_walls
from casadi_contact.verification.share import share_in_words

_LONGEST_MM = 1.0  # of a wall's triangles' edges: each is pressed or not, and flat walls from CAD are a few large ones
_FACING = 0.5  # cos of the angle between a wall's normal and the way to the body: the side of a rim is not pressed


def share_on_walls(model: ElasticFoundation, poses: Array) -> Array:
    """Share (n,) of the pressing force Σ p·A that lies on walls: triangles within the patches' boxes that are steeper
    than 78 degrees seen along the rays that lay out elements, or undercut, for each patch that holds them.

    Neither elements nor cells know of it, so that it is no difference between them. Depths are minus the moving mesh's
    distance from the triangles' centres. 0 out of contact, and for scenes that are no meshes or whose elements are the
    triangles themselves.
    """
    poses, geometry = as_poses(poses), model.scene.geometry
    share = np.zeros(len(poses))
    if model.scene.shape != "mesh" or geometry["elements"] != "grid":
        return share
    walls = patch_walls(geometry, _LONGEST_MM)
    if not len(walls.faces):
        return share
    centres, normals, areas = walls.corners_mm.mean(axis=1), walls.normals, walls.areas_mm2
    law, field = law_of(model.scene.material), body_field(geometry, "moving")
    ends = body_mesh(geometry, "moving").vertices_mm
    low, high = ends.min(axis=0), ends.max(axis=0)
    for k, (R, t) in enumerate(zip(rotation(poses[:, 3:]), poses[:, :3], strict=True)):
        seen = (centres - t) @ R
        near = np.flatnonzero(((seen > low) & (seen < high)).all(axis=1))
        distance, slope = field(seen[near])
        facing = np.einsum("nk,nk->n", slope, normals[near] @ R) < -_FACING
        on_walls = float(pressures(*law, np.where(facing, np.maximum(-distance, 0.0), 0.0)) @ areas[near])
        if on_walls > 0.0:
            counted = sum(float(each.forces_n.sum()) for each in model.pressure_maps(poses[k]))
            share[k] = on_walls / (on_walls + counted)
    return share


def words_on_walls(share: Array) -> str | None:
    """`share_in_words` of `share_on_walls`."""
    return share_in_words(
        share,
        "on walls of the fixed mesh steeper than 78 degrees, such as a post's, where there are no elements: it is not "
        "counted; geometry.cup_centre on the axis of a notch or in the middle of a cup counts it, elsewhere a patch of "
        "its own there, with its own geometry.patches.NAME.pressing",
    )
