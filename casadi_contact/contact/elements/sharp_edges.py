"""Load that is carried where the moving body is not known well: at sharp edges of its mesh, which its field rounds."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.elements.pressed import pressed_elements
from casadi_contact.core.conventions import Array, as_poses, rotation
from casadi_contact.geometry.creases import beside_creases, creases
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, field_spacing

TELLING_SHARE = 0.1  # of a wheel with bare edges, with less of its load there forces are off by 1 %


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
    if not len(creases(mesh)[0]):
        return share
    pressed = [pressed_elements(model, pose) for pose in poses]
    seen = [(points - pose[:3]) @ rotation(pose[3:]) for (points, _), pose in zip(pressed, poses, strict=True)]
    at = np.repeat(np.arange(len(poses)), [len(points) for points in seen])
    if not len(at):
        return share
    force = np.concatenate([each for _, each in pressed])
    there = beside_creases(mesh, np.concatenate(seen), np.arange(len(mesh.faces)), spacing)
    total, beside = np.bincount(at, force, len(poses)), np.bincount(at[there], force[there], len(poses))
    return np.asarray(np.divide(beside, total, where=total > 0.0, out=share))
