"""The tables of a proposed scene, from what was found out about its meshes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.geometry.distance_field import SPACING_MM
from casadi_contact.geometry.projection import DOWN
from casadi_contact.workflow.proposal.frame import Frame
from casadi_contact.workflow.proposal.joint import Joint
from casadi_contact.workflow.proposal.meeting import Meeting
from casadi_contact.workflow.proposal.pair import Pair
from casadi_contact.workflow.proposal.regions import Regions
from casadi_contact.workflow.proposal.sight import Sight

MATERIALS: Mapping[str, Mapping[str, Any]] = {
    "polyethylene": {"youngs_modulus": 463.0, "poissons_ratio": 0.46, "thickness": 8.0, "law": "linear"},
    # Both layers together, as of Smith et al. 2018 (OpenSim JAM).
    "cartilage": {"youngs_modulus": 10.0, "poissons_ratio": 0.45, "thickness": 6.0, "law": "linear"},
}
REFERENCE_LOAD_N, _BOUNDARY_N = 1000.0, 5.0  # of a large joint; smaller ones carry less, as their areas are
_BOX_MARGIN_MM = 8.0
_BOX_SHARE = 0.7  # of the fixed mesh's extent: a patch that reaches farther is not bounded
_ROUGH_GRID = (60, 60)


def first_tables(
    sight: Sight,
    frame: Frame,
    files: Mapping[str, Path],
    units: str,
    material: Mapping[str, Any],
    name: str,
) -> dict[str, Any]:
    """A scene's tables with everything that the meshes tell; grids, tolerances and gap slope are placeholders."""
    pair, meeting, regions, joint = sight.pair, sight.meeting, sight.regions, sight.joint
    placement: dict[str, Any] = {}
    for body, offset in frame.offsets_mm.items():
        placed: dict[str, Any] = {"mirror": frame.mirror} if frame.mirror else {}
        placed |= {key: list(v) for key, v in (("rotation_deg", frame.rotation_deg), ("offset", offset)) if any(v)}
        placement |= {body: placed} if placed else {}
    geometry: dict[str, Any] = {body: str(path.resolve()) for body, path in files.items()}
    geometry |= {"units": units, "axes": list(frame.axes), "elements": "grid"}
    if pair.scale < 1.0:
        geometry["spacing"] = round(pair.scale * SPACING_MM, 2)
    pressing = direction_of(joint, frame, meeting)
    if pressing != list(DOWN):
        geometry["pressing"] = pressing
    if not joint.pressing and regions.cup_mm is not None:
        geometry["cup_centre"] = (frame.points(regions.cup_mm[None], "fixed")[0].round(2) + 0.0).tolist()
    geometry["start_pose"] = _start_pose(meeting, frame)
    if placement:
        geometry["placement"] = placement
    geometry["patches"] = _patches(pair, regions, joint, frame)
    return {
        "format": 1,
        "name": name,
        "shape": "mesh",
        "geometry": geometry,
        "material": {**material, "thickness": round(pair.scale * material["thickness"], 1)},
        "grids": {grid: list(_ROUGH_GRID) for grid in ("fine", "coarse", "settle", "teacher")},
        "loads": {
            "names": joint.loads,
            "sensitive": joint.sensitive,
            "sensitive_pose": joint.sensitive_pose,
            "reference_load": round(REFERENCE_LOAD_N * pair.carrying**2, 1),
            "gap_slope": 5.0,
            "boundary_load": round(_BOUNDARY_N * pair.carrying**2, 2),
        },
        "tolerances": dict.fromkeys(joint.loads, 1.0),
    }


def direction_of(joint: Joint, frame: Frame, meeting: Meeting) -> list[float]:
    """The scene's pressing: an axis where the joint is pressed along one, else as the surfaces face."""
    if joint.pressing:
        sign = -1.0 if joint.pressing[0] == "-" else 1.0
        return [sign * (axis == joint.pressing[1]) + 0.0 for axis in "xyz"]
    return [float(v) for v in frame.directions(meeting.pressing).round(3)]


def _start_pose(meeting: Meeting, frame: Frame) -> list[float]:
    moving, fixed = (np.array(frame.offsets_mm[body]) for body in ("moving", "fixed"))
    return [*(frame.directions(meeting.translation_mm) + fixed - moving).round(3).tolist(), 0.0, 0.0, 0.0]


def _patches(pair: Pair, regions: Regions, joint: Joint, frame: Frame) -> dict[str, Any]:
    """Box and anchor of each patch, by falling coordinate: cuts between neighbours, and bounds [mm] about what comes
    near where that is little of the mesh."""
    points, anchors = frame.points(pair.points_mm, "fixed"), frame.points(regions.anchors_mm, "moving")
    numbers = regions.patch_of(pair.points_mm)
    low, high = points.min(axis=0), points.max(axis=0)
    order, axis = list(range(len(anchors))), None
    cuts: list[float] = []
    if regions.axis is not None:
        unit = frame.directions(np.eye(3)[regions.axis])
        axis = int(np.abs(unit).argmax())
        at = np.zeros((len(regions.cuts_mm), 3))
        at[:, regions.axis] = regions.cuts_mm
        cuts = sorted(frame.points(at, "fixed")[:, axis].round(1).tolist(), reverse=True)
        order = order[::-1] if unit[axis] > 0.0 else order
    found = {}
    for k, (name, number) in enumerate(zip(joint.patches, order, strict=True)):
        near = points[(regions.weight > 0.0) & (numbers == number)]
        box: dict[str, Any] = {}
        for a, letter in enumerate("xyz"):
            margin = pair.scale * _BOX_MARGIN_MM
            ends = [float(near[:, a].min()) - margin, float(near[:, a].max()) + margin]
            ends = [max(ends[0], float(low[a]) - 1.0), min(ends[1], float(high[a]) + 1.0)]
            bounded = ends[1] - ends[0] < _BOX_SHARE * (high[a] - low[a])
            if a == axis:
                ends = [cuts[k] if k < len(cuts) else ends[0], cuts[k - 1] if k else ends[1]]
            if (bounded and joint.pressing[1:] != letter) or a == axis:
                box[letter] = [round(end, 1) for end in ends]
        found[name] = {**box, "anchor": (anchors[number].round(1) + 0.0).tolist()}
    return found
