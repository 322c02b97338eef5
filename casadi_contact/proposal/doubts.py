"""What is doubtful about a proposed scene: edges that contact reaches."""

from __future__ import annotations

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.shapes.mesh_bodies import body_mesh


def edges_reached(model: ElasticFoundation, poses: Array) -> list[str]:
    """Whether the fixed mesh's open edges may be a cut, and in how many of the poses (n, 6) contact reaches a cut."""
    reached = int(model.at_edge(poses).any(axis=1).sum())
    if not len(body_mesh(model.scene.geometry, "fixed").boundary_edges) and not reached:
        return []
    return [
        "whether the fixed surface ends at its open edges: taken as cut there (open_edges); contact reaches a cut in "
        f"{reached} of {len(poses)} frames, which are no samples to learn from"
    ]
