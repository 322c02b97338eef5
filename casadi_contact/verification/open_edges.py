"""Load that is carried where the moving body is not known: beyond the open edges of its mesh."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array, as_poses, rotation
from casadi_contact.shapes.mesh_bodies import body_mesh, body_surface

MOST_BEYOND = 0.01  # of the load, from which on it is worth a word


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
    for k, (pose, turned) in enumerate(zip(poses, rotation(poses[:, 3:]), strict=True)):
        maps = model.pressure_maps(pose)
        force = np.concatenate([each.pressures_mpa * each.areas_mm2 for each in maps])
        if (pressed := force > 0.0).any():
            points = np.concatenate([each.centres_mm for each in maps])[pressed]
            beyond = surface.beyond_open_edges((points - pose[:3]) @ turned)
            share[k] = force[pressed] @ beyond / force.sum()
    return share


def words_beyond_open_edges(share: Array) -> str | None:
    """In how many of the poses more than `MOST_BEYOND` of the load lies there, and how much at most; None for none."""
    if not (count := int((share > MOST_BEYOND).sum())):
        return None
    return (
        f"in {count} of {len(share)} frames up to {share.max():.0%} of the load lies beyond open edges of the moving "
        "mesh, where its surface is taken to round off: a part that ends there carries less"
    )
