"""The tables of a proposed scene, and their text as a commented .toml file."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from casadi_contact.geometry.distance_field import SPACING_MM
from casadi_contact.geometry.projection import DOWN
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.proposal.frame import Frame
from casadi_contact.workflow.proposal.joint_geometry import JointGeometry

MATERIALS: Mapping[str, Mapping[str, Any]] = {
    "polyethylene": {"youngs_modulus": 463.0, "poissons_ratio": 0.46, "thickness": 8.0, "law": "linear"},
    "cartilage": {"youngs_modulus": 10.0, "poissons_ratio": 0.45, "thickness": 6.0, "law": "linear"},  # JAM's, both
    "sole": {"youngs_modulus": 0.35, "poissons_ratio": 0.3, "thickness": 20.0, "law": "linear"},  # as in foot_on_ground
}


def first_tables(
    geometry: JointGeometry, frame: Frame, files: Mapping[str, Path], units: str, material: Mapping[str, Any], name: str
) -> dict[str, Any]:
    """A scene's tables as far as the surfaces tell; grids, tolerances and gap slope are placeholders."""
    scale, joint = geometry.pair.scale, geometry.joint
    placement: dict[str, Any] = {}
    for body, offset in frame.offsets_mm.items():
        placed: dict[str, Any] = {"mirror": frame.mirror} if frame.mirror else {}
        placed |= {key: list(v) for key, v in (("rotation_deg", frame.rotation_deg), ("offset", offset)) if any(v)}
        placement |= {body: placed} if placed else {}
    table: dict[str, Any] = {body: str(path.resolve()) for body, path in files.items()}
    table |= {"units": units, "axes": list(frame.axes), "elements": "grid"}
    if scale < 1.0:
        table["spacing"] = round(scale * SPACING_MM, 2)
    pressing = direction_of(geometry, frame)
    if pressing != list(DOWN):
        table["pressing"] = pressing
    if not joint.pressing and geometry.patches.hollow:
        table["cup_centre"] = (frame.points(geometry.patches.centre_mm[None], "fixed")[0].round(2) + 0.0).tolist()
    moving, fixed = (np.array(frame.offsets_mm[body]) for body in ("moving", "fixed"))
    start = frame.directions(geometry.placement.translation_mm) + fixed - moving
    table["start_pose"] = [*start.round(3).tolist(), 0.0, 0.0, 0.0]
    if placement:
        table["placement"] = placement
    table["patches"] = _patches(geometry, frame)
    return {
        "format": 1,
        "name": name,
        "shape": "mesh",
        "geometry": table,
        "material": {**material, "thickness": round(scale * material["thickness"], 1)},
        "grids": {grid: [60, 60] for grid in ("fine", "coarse", "settle", "teacher")},
        "loads": {
            "names": joint.loads,
            "sensitive": joint.sensitive,
            "sensitive_pose": joint.sensitive_pose,
            "reference_load": round(1000.0 * scale**2, 1),  # of a large joint, in proportion to its area
            "gap_slope": 5.0,
            "boundary_load": round(5.0 * scale**2, 2),
        },
        "tolerances": dict.fromkeys(joint.loads, 1.0),
    }


def direction_of(geometry: JointGeometry, frame: Frame) -> list[float]:
    """The scene's pressing: an axis if the joint is pressed along one, else minus the mean normal."""
    pressing = geometry.joint.pressing
    if pressing:
        sign = -1.0 if pressing[0] == "-" else 1.0
        return [sign * (axis == pressing[1]) + 0.0 for axis in "xyz"]
    return [float(v) for v in frame.directions(geometry.placement.pressing).round(3)]


def _patches(geometry: JointGeometry, frame: Frame, margin_mm: float = 8.0, most_extent: float = 0.7) -> dict[str, Any]:
    """Box and anchor of each patch, by falling coordinate. A box ends at the cuts between neighbours. Along the other
    axes it bounds the contact area with a margin, unless it is longer than `most_extent` of the mesh."""
    pair, patches, joint = geometry.pair, geometry.patches, geometry.joint
    points, anchors = frame.points(pair.points_mm, "fixed"), frame.points(patches.anchors_mm, "moving")
    numbers = patches.patch_of(pair.points_mm)
    low, high = points.min(axis=0), points.max(axis=0)
    order, axis, cuts = list(range(len(anchors))), None, list[float]()
    if patches.axis is not None:
        unit = frame.directions(np.eye(3)[patches.axis])
        axis = int(np.abs(unit).argmax())
        at = np.zeros((len(patches.cuts_mm), 3))
        at[:, patches.axis] = patches.cuts_mm
        cuts = sorted(frame.points(at, "fixed")[:, axis].round(1).tolist(), reverse=True)
        order = order[::-1] if unit[axis] > 0.0 else order
    tables = {}
    for k, (name, number) in enumerate(zip(joint.patches, order, strict=True)):
        near = points[(patches.weight > 0.0) & (numbers == number)]
        if patches.plane == "fixed":  # of which all may touch what lies over it
            near = frame.points(pair.moving.vertices_mm + geometry.placement.translation_mm, "fixed")
        box: dict[str, Any] = {}
        for a, letter in enumerate("xyz"):
            margin = pair.scale * margin_mm
            first = max(float(near[:, a].min()) - margin, float(low[a]) - 1.0)
            last = min(float(near[:, a].max()) + margin, float(high[a]) + 1.0)
            bounded = last - first < most_extent * (high[a] - low[a])
            if a == axis:
                first, last = cuts[k] if k < len(cuts) else first, cuts[k - 1] if k else last
            if (bounded and joint.pressing[1:] != letter) or a == axis:
                box[letter] = [round(first, 1), round(last, 1)]
        tables[name] = {**box, "anchor": (anchors[number].round(1) + 0.0).tolist()}
    return tables


_COMMENTS = {
    "[geometry]": "Where the meshes are, relative to this file, and how they lie",
    "geometry.moving": "its frame is what a pose moves",
    "geometry.fixed": "loads act on it, about the origin of its frame: centres of pressure refer to that",
    "units": "of both files",
    "axes": "which file axis x (posterior), y (superior) and z (medial) are",
    "pressing": "where to the moving body presses; elements lie on the side that faces it",
    "cup_centre": "middle of the cup, or on the axis of the notch [mm]: elements and cells lie on rays from it",
    "start_pose": "tx, ty, tz [mm], rx, ry, rz [rad]: in contact, where static analyses begin",
    "open_edges": 'the fixed mesh\'s open edges: "cut" of a larger part, or "rim" of the part, which contact may reach',
    "shell": 'of the moving mesh: "outer" counts its side away from the anchors alone, "whole" all of it',
    "spacing": "of the distance fields' nodes [mm]",
    "[geometry.spacing]": "Of the distance fields' nodes [mm], as fine as thin bodies need",
    "anchor": "on the moving body [mm]: the middle of its curvature where it touches this patch",
    "mirror": "a left joint becomes a right one",
    "rotation_deg": "of the mesh about x, y, z, before the offset",
    "offset": "of the mesh in its frame [mm]",
    "youngs_modulus": "MPa",
    "thickness": "mm",
    "fine": "from a convergence test",
    "settle": "finds poses for given loads",
    "teacher": "training data, and the reference for verification",
    "sensitive": "the normal load of each patch",
    "gap_slope": "root load per mm of overlap, as contact itself gives it",
    "[tolerances]": "1 % of the largest force and torque of the reference motion: N, N·mm",
    "[sampling.fixed_offsets]": "mm, of D1 and D2, where the motion stands still: leave out for measured cycles",
    "most_edge_share": "of a patch's load, at edges of the elements: poses with more are no samples",
    "most_dropped": "of a domain's plan, since contact runs off the surface",
    "[motion]": "Made up: put measured harmonics here, or give cycle files",
}


def scene_text(scene: Scene, remarks: Sequence[str], folder: Path) -> str:
    """The .toml file of a mesh scene for a folder: remarks first, comments beside keys, meshes relative to it."""
    geometry = dict(scene.tables["geometry"])
    for body in ("moving", "fixed"):
        geometry[body] = Path(os.path.relpath(Path(geometry[body]).resolve(), folder.resolve())).as_posix()
    lines = _lines("", {**scene.tables, "geometry": geometry})
    return "\n".join([*(f"# {line}" for line in remarks), "", *lines]) + "\n"


def _one_line(value: Any) -> str:
    """A value as TOML; lists, which `tomli_w` spreads over lines, on one."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_one_line, value))}]"
    return tomli_w.dumps({"_": value}).strip().partition(" = ")[2]


def _lines(path: str, table: Mapping[str, Any]) -> list[str]:
    """The table's own values, one a line with its comment, then its tables."""
    lines = []
    for key, value in table.items():
        if not isinstance(value, Mapping):
            one_line = f"{tomli_w.dumps({key: 0}).partition(' = ')[0]} = {_one_line(value)}"
            comment = _COMMENTS.get(f"{path}{key}", _COMMENTS.get(key))
            lines.append(f"{one_line:<46} # {comment}" if comment else one_line)
    for key, value in table.items():
        if isinstance(value, Mapping):
            name = f"{path}{key}"
            comment = _COMMENTS.get(f"[{name}]")
            if any(not isinstance(each, Mapping) for each in value.values()):
                lines += ["", f"[{name}]" + (f"  # {comment}" if comment else "")]
            lines += _lines(f"{name}.", value)
    return lines
