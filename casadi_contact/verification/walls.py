"""Load on walls of the fixed mesh, which are too steep for elements and cells to be laid out on."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.contact.pressure import law_number, layer_modulus, pressures
from casadi_contact.conventions import Array, as_poses, rotation
from casadi_contact.geometry.projection import DOWN, LEAST_UPWARD
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.shapes.mesh_bodies import body_field, body_mesh, patch_box
from casadi_contact.shapes.shape import Geometry

MOST_ON_WALLS = 0.01  # of the load, from which on it is worth a word
_LONGEST_MM = 1.0  # of a wall's triangles' edges: each is pressed or not, and flat walls from CAD are a few large ones
_FACING = 0.5  # cos of the angle between a wall's normal and the way to the body: the side of a rim is not pressed


def share_on_walls(model: ElasticFoundation, poses: Array) -> Array:
    """Share (n,) of the pressing force Σ p·A that lies on walls: triangles within the patches' boxes that are steeper
    than 78 degrees seen along the rays that lay out elements, or undercut.

    Neither elements nor cells know of it, so that it is no difference between them. Depths are minus the moving mesh's
    distance from the triangles' centres. 0 out of contact, and for scenes that are no meshes or whose elements are the
    triangles themselves.
    """
    poses, geometry = as_poses(poses), model.scene.geometry
    share = np.zeros(len(poses))
    if model.scene.shape != "mesh" or geometry["elements"] != "grid":
        return share
    walls = _walls(geometry, model.scene.patch_names)
    if not len(walls.faces):
        return share
    centres, normals, areas = walls.corners_mm.mean(axis=1), walls.normals, walls.areas_mm2
    material, field = model.scene.material, body_field(geometry, "moving")
    law = (law_number(material.law), layer_modulus(material), material.thickness)
    ends = body_mesh(geometry, "moving").vertices_mm
    low, high = ends.min(axis=0), ends.max(axis=0)
    for k, (R, t) in enumerate(zip(rotation(poses[:, 3:]), poses[:, :3], strict=True)):
        seen = (centres - t) @ R
        near = np.flatnonzero(((seen > low) & (seen < high)).all(axis=1))
        distance, slope = field(seen[near])
        facing = np.einsum("nk,nk->n", slope, normals[near] @ R) < -_FACING
        on_walls = float(pressures(*law, np.where(facing, np.maximum(-distance, 0.0), 0.0)) @ areas[near])
        if on_walls > 0.0:
            counted = sum(float(each.pressures_mpa @ each.areas_mm2) for each in model.pressure_maps(poses[k]))
            share[k] = on_walls / (on_walls + counted)
    return share


def words_on_walls(share: Array) -> str | None:
    """In how many poses more than `MOST_ON_WALLS` of the load lies on walls, and how much at most; None for none."""
    if not (count := int((share > MOST_ON_WALLS).sum())):
        return None
    return (
        f"in {count} of {len(share)} frames up to {share.max():.0%} of the load lies on walls of the fixed mesh "
        "steeper than 78 degrees, such as a post's, where there are no elements: it is not counted"
    )


def _walls(geometry: Geometry, patches: tuple[str, ...]) -> TriangleMesh:
    """The triangles, divided, that lie in a patch's box and get no elements for their steepness."""
    import trimesh

    whole = body_mesh(geometry, "fixed")
    centres = whole.corners_mm.mean(axis=1)
    boxes = [patch_box(geometry, patch) for patch in patches]
    inside = np.any([((centres >= low) & (centres < high)).all(axis=1) for low, high in boxes], axis=0)
    ups = np.broadcast_to(-np.asarray(geometry.get("pressing", DOWN), dtype=float), centres.shape)
    if "cup_centre" in geometry:
        ups = geometry["cup_centre"] - centres
    upward = np.einsum("nk,nk->n", whole.normals, ups) / np.linalg.norm(ups, axis=1)
    steep = whole.part(inside & (upward <= LEAST_UPWARD))
    if not len(steep.faces):
        return steep
    vertices, faces = trimesh.remesh.subdivide_to_size(steep.vertices_mm, steep.faces, _LONGEST_MM, max_iter=20)
    return TriangleMesh(steep.name, np.asarray(vertices), np.asarray(faces))
