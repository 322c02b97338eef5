"""Load that is carried where the moving body is not known well: at sharp edges of its mesh, which its field rounds."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array, as_poses, rotation
from casadi_contact.geometry.creases import beside_creases
from casadi_contact.shapes.mesh_bodies import body_mesh, field_spacing
from casadi_contact.verification.open_edges import pressed_elements


def share_at_sharp_edges(model: ElasticFoundation, poses: Array) -> Array:
    """Share (n,) of the pressing force Σ p·A, over all patches, on elements nearer to a crease of the moving mesh than
    the nodes of its distance field lie from each other.

    There the field rounds the edge off (`geometry.distance_field`), for elements and cells alike. 0 out of contact, and
    for moving bodies without creases, as for those that are no meshes.
    """
    poses = as_poses(poses)
    share = np.zeros(len(poses))
    if model.scene.shape != "mesh":
        return share
    mesh, spacing = body_mesh(model.scene.geometry, "moving"), field_spacing(model.scene.geometry, "moving")
    pressed = [pressed_elements(model, pose) for pose in poses]
    seen = [(points - pose[:3]) @ rotation(pose[3:]) for (points, _), pose in zip(pressed, poses, strict=True)]
    at = np.repeat(np.arange(len(poses)), [len(points) for points in seen])
    if not len(at):
        return share
    force = np.concatenate([each for _, each in pressed])
    there = beside_creases(mesh, np.concatenate(seen), np.arange(len(mesh.faces)), spacing)
    total, beside = np.bincount(at, force, len(poses)), np.bincount(at[there], force[there], len(poses))
    return np.asarray(np.divide(beside, total, where=total > 0.0, out=share))
