"""What is open about a proposed scene: coarse coordinates, frames without a pose, edges that contact reaches,
shells passed through."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.mesh import MM_PER_UNIT
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.optimisation.verification.unmodelled_load import unmodelled_load_shares, unmodelled_load_words
from casadi_contact.samples.reference import ReferenceReport
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh

_ASKED = {
    "beyond_open_edges": "whether the moving part ends at its open edges",
    "on_walls": "what walls carry",
    "outside_patches": "what lies outside of the patches",
    "at_sharp_edges": "what sharp edges carry",
}
_COARSE_STEP_MM = 2e-3  # of coordinates: overlaps are some tenths of a millimetre
_ROUNDING_MM = 1e-6  # what reading leaves of single precision


def coarse_coordinates(meshes: Mapping[str, TriangleMesh], unit: str) -> list[str]:
    """Whether the files' coordinates, as in binary STL, are so large that single precision rounds them coarsely."""
    steps = [0.0]
    for mesh in meshes.values():
        in_file = mesh.vertices_mm / MM_PER_UNIT[unit]
        single = in_file.astype(np.float32)
        if MM_PER_UNIT[unit] * np.abs(in_file - single).max() < _ROUNDING_MM:
            steps.append(MM_PER_UNIT[unit] * float(np.spacing(np.abs(single).max())))
    if max(steps) < _COARSE_STEP_MM:
        return []
    return [
        f"where the surfaces are to less than {max(steps):.2g} mm: to such steps the files' coordinates are rounded, "
        "far from their origin as they are; export them about an origin near the joint"
    ]


def beyond_elements(model: ElasticFoundation, poses: Array) -> list[str]:
    """What may carry load where there are no elements, in the poses (n, 6): beyond open edges and cuts, on walls,
    outside of the patches; and where it is carried at sharp edges."""
    questions = []
    if len(body_mesh(model.scene.geometry, "fixed").boundary_edges):
        questions.append("whether the part ends at the fixed mesh's open edges: taken as cut there (open_edges)")
    if reached := int(model.at_edge(poses).any(axis=1).sum()):
        questions.append(
            f"what carries load beyond the elements: in {reached} of {len(poses)} frames contact reaches an edge where "
            "the surface goes on or is cut; such poses are no samples to learn from"
        )
    told = unmodelled_load_words(unmodelled_load_shares(model, poses))
    return questions + [f"{_ASKED[where]}: {words}" for where, words in told.items()]


def unsettled(scene: Scene, report: ReferenceReport) -> list[str]:
    """How many frames tried of the reference motion have no pose, the reason for the first, and whose motion it is."""
    without = ~report.converged
    if not without.any():
        return []
    whose = "made up" if "motion" in scene.tables else "measured in another knee"
    return [
        f"whether it can move so: {int(without.sum())} of {without.size} frames tried of the reference motion "
        f"({whose}) find no pose ({report.reason[without][0]}); give measured cycles of this joint"
    ]


def shells_passed(model: ElasticFoundation, poses: Array, shells_mm: Mapping[str, float]) -> list[str]:
    """Whether overlaps in the poses (n, 6) reach more than half of a moving shell all of whose sides count."""
    overlap = float(-model.gaps(poses).min())
    if model.scene.geometry.get("shell") != "whole" or overlap < 0.5 * shells_mm["moving"]:
        return []
    return [
        f"which side of the moving shell counts: overlaps reach {overlap:.2g} mm of its {shells_mm['moving']:.2g} mm, "
        "and beyond half of it loads fall"
    ]
