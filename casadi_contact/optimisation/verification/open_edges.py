"""Load that is carried where the moving body is not known: beyond the open edges of its mesh."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation, pressed_elements
from casadi_contact.core.conventions import Array, as_poses, rotation
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, body_surface

_CHUNK = 200  # poses whose pressed points are looked up at once: the mesh's tree is built anew by each look


def share_beyond_open_edges(model: ElasticFoundation, poses: Array) -> Array:
    """Share (n,) of the pressing force Σ p·A, over all patches, on elements nearest to an open edge of the moving mesh.

    There the body is taken to round off (`geometry.smooth_surface`), and the part may have ended. 0 out of contact, and
    for moving bodies that are closed meshes or no meshes.
    """
    poses = as_poses(poses)
    share = np.zeros(len(poses))
    if model.scene.shape != "mesh" or not len(body_mesh(model.scene.geometry, "moving").boundary_edges):
        return share
    surface = body_surface(model.scene.geometry, "moving")
    turned = rotation(poses[:, 3:])
    for first in range(0, len(poses), _CHUNK):
        chunk = np.arange(first, min(first + _CHUNK, len(poses)))
        pressed = [pressed_elements(model, poses[k]) for k in chunk]
        at = np.repeat(chunk, [len(force) for _, force in pressed])
        if not len(at):
            continue
        points, force = (np.concatenate(each) for each in zip(*pressed, strict=True))
        beyond = surface.beyond_open_edges(np.einsum("ni,nij->nj", points - poses[at, :3], turned[at]))
        total = np.bincount(at - first, force, len(chunk))
        share[chunk] = np.divide(
            np.bincount(at - first, force * beyond, len(chunk)), total, where=total > 0.0, out=total
        )
    return share
