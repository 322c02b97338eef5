"""What is doubtful about a proposed scene: edges that contact reaches."""

from __future__ import annotations

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.shapes.mesh_bodies import body_mesh


def edges_reached(model: ElasticFoundation, poses: Array) -> list[str]:
    """Whether the fixed mesh's open edges may be a cut, and in how many of the poses (n, 6) contact reaches a cut."""
    doubts = []
    if len(body_mesh(model.scene.geometry, "fixed").boundary_edges):
        doubts.append("whether the part ends at the fixed mesh's open edges: taken as cut there (open_edges)")
    if reached := int(model.at_edge(poses).any(axis=1).sum()):
        doubts.append(
            f"what carries load beyond the elements: in {reached} of {len(poses)} frames contact reaches an edge where "
            "the surface goes on or is cut; such poses are no samples to learn from"
        )
    return doubts
