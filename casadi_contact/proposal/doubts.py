"""What is doubtful about a proposed scene: edges that contact reaches, shells that it reaches through."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.geometry.mesh import TriangleMesh
from casadi_contact.geometry.rays import RayCaster
from casadi_contact.shapes.mesh_bodies import body_mesh

_THIN_MM = 20.0
_SHALLOW = 1e-3  # of a millimetre below the surface: where rays into the body begin


def edges_reached(model: ElasticFoundation, poses: Array) -> list[str]:
    """Whether the fixed mesh's open edges may be a cut, and in how many of the poses (n, 6) contact reaches a cut."""
    reached = int(model.at_edge(poses).any(axis=1).sum())
    if not len(body_mesh(model.scene.geometry, "fixed").boundary_edges) and not reached:
        return []
    return [
        "whether the fixed surface ends at its open edges: taken as cut there (open_edges); contact reaches a cut in "
        f"{reached} of {len(poses)} frames, which are no samples to learn from"
    ]


def refuse_thin_shell(model: ElasticFoundation, poses: Array) -> None:
    """Raise ValueError where the overlap at poses (n, 6) exceeds half the thickness of a moving body that is a closed
    shell: from there on its other side is nearer, and the load falls as it is pressed deeper."""
    mesh = body_mesh(model.scene.geometry, "moving")
    if len(mesh.boundary_edges):
        return
    overlap = float(-model.gaps(poses).min())
    thickness = _thickness(mesh)
    if overlap > 0.5 * thickness:
        raise ValueError(
            f"mesh {mesh.name} is a closed shell about {thickness:.2g} mm thick, and the reference motion overlaps it "
            f"by {overlap:.2g} mm, more than half of that: give the whole bone with its cartilage, or the outer "
            "surface alone, as an open mesh; or a stiffer material"
        )


def _thickness(mesh: TriangleMesh) -> float:
    """The way [mm] from triangles straight through the body, the median of those thinner than a bone; else infinite."""
    normals = mesh.area_vectors_mm2 / np.linalg.norm(mesh.area_vectors_mm2, axis=1, keepdims=True)
    distance, _ = RayCaster(mesh).first_hits(mesh.corners_mm.mean(axis=1) - _SHALLOW * normals, -normals)
    thin = distance[distance < _THIN_MM]
    return float(np.median(thin)) if len(thin) > 0.5 * len(distance) else np.inf
