"""Load where the fixed mesh bears neither elements nor cells: on walls too steep for them, outside of its patches."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.pressure_law import law_of, pressures
from casadi_contact.core.conventions import Array, as_poses, rotation
from casadi_contact.scenes.shapes.mesh_bodies import body_field, body_mesh, body_surface
from casadi_contact.scenes.shapes.mesh_patches import bare_mesh

_LONGEST_MM = 1.0  # of the triangles' edges: each is pressed or not, and flat faces from CAD are a few large ones
_FACING = 0.5  # cos of the angle between a normal and the way to the body: the side of a rim is not pressed


def share_on_walls(model: ElasticFoundation, poses: Array) -> Array:
    """Share (n,) of the pressing force Σ p·A that lies on walls: triangles within the patches' boxes that are steeper
    than 78 degrees seen along the rays that lay out elements, or undercut, for each patch that holds them.

    Neither elements nor cells know of it, so that it is no difference between them. Depths are minus the moving mesh's
    distance from the triangles' centres; beyond its open edges it is not known. 0 out of contact, and for scenes that
    are no meshes.
    """
    return _share_on_bare(model, poses, within=True)


def share_outside_patches(model: ElasticFoundation, poses: Array) -> Array:
    """Share (n,) of the pressing force Σ p·A that lies outside of all patches' boxes, as of a femur's neck that strikes
    the rim of a cup: `share_on_walls` of the rest of the fixed mesh."""
    return _share_on_bare(model, poses, within=False)


def _share_on_bare(model: ElasticFoundation, poses: Array, *, within: bool) -> Array:
    poses, geometry = as_poses(poses), model.scene.geometry
    share = np.zeros(len(poses))
    if model.scene.shape != "mesh":
        return share
    bare = bare_mesh(geometry, _LONGEST_MM, within=within)
    if not len(bare.faces) or not len(poses):
        return share
    centres, normals, areas = bare.corners_mm.mean(axis=1), bare.normals, bare.areas_mm2
    law, field = law_of(model.scene.material), body_field(geometry, "moving")
    moving = body_mesh(geometry, "moving")
    low, high = moving.vertices_mm.min(axis=0), moving.vertices_mm.max(axis=0)
    pressed: list[tuple[np.ndarray, Array, Array]] = []  # pose, point of the moving body [mm] and force [N] of each
    for k, (R, t) in enumerate(zip(rotation(poses[:, 3:]), poses[:, :3], strict=True)):
        seen = (centres - t) @ R
        near = np.flatnonzero(((seen > low) & (seen < high)).all(axis=1))
        distance, slope = field(seen[near])
        facing = np.einsum("nk,nk->n", slope, normals[near] @ R) < -_FACING
        deep, near = -distance[facing & (distance < 0.0)], near[facing & (distance < 0.0)]
        pressed.append((np.full(len(near), k), seen[near], pressures(*law, deep) * areas[near]))
    pose, points, forces = (np.concatenate(each) for each in zip(*pressed, strict=True))
    if len(forces) and len(moving.boundary_edges):
        forces = forces * ~body_surface(geometry, "moving").beyond_open_edges(points)
    on_bare = np.bincount(pose, forces, len(poses))
    for k in np.flatnonzero(on_bare).tolist():
        counted = sum(float(each.forces_n.sum()) for each in model.pressure_maps(poses[k]))
        share[k] = on_bare[k] / (on_bare[k] + counted)
    return share
