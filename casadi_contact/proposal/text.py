"""A proposed scene as a commented .toml, and as lines for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from casadi_contact.proposal.propose import Proposal
from casadi_contact.proposal.tables import relative

_COMMENTS = {
    "[geometry]": "Where the meshes are, relative to this file, and how they lie",
    "moving": "its frame is what a pose moves",
    "fixed": "loads act on it, about the origin of its frame: centres of pressure refer to that",
    "units": "of both files",
    "axes": "which file axis x (posterior), y (superior) and z (medial) are",
    "pressing": "where to the moving body presses; elements lie on the side that faces it",
    "cup_centre": "middle of the cup [mm]: elements and cells lie on rays from it",
    "start_pose": "tx, ty, tz [mm], rx, ry, rz [rad]: in contact, where static analyses begin",
    "open_edges": 'the fixed mesh\'s open edges: "cut" of a larger part, or "rim" of the part, which contact may reach',
    "shell": 'of the moving mesh: "outer" counts its side away from the anchors alone, "whole" all of it',
    "spacing": "of the distance fields' nodes [mm], as fine as thin shells need",
    "anchor": "on the moving body [mm]: the middle of its curvature where it touches this patch",
    "mirror": "a left joint becomes a right one",
    "rotation_deg": "of the mesh about x, y, z, before the offset",
    "offset": "of the mesh in its frame [mm]",
    "youngs_modulus": "MPa",
    "thickness": "mm",
    "fine": "found by a convergence test: what a solution is checked on",
    "settle": "finds poses for wanted loads",
    "teacher": "what networks learn",
    "sensitive": "the normal load of each patch",
    "gap_slope": "root load per mm of overlap, as contact itself gives it",
    "[tolerances]": "1 % of the largest force and torque of the reference motion: N, N·mm",
    "[sampling.fixed_offsets]": "mm, of D1 and D2, where the motion stands still: leave out for measured cycles",
    "[motion]": "Made up: put measured harmonics here, or give cycle files",
}


def scene_text(proposal: Proposal, folder: Path) -> str:
    """The scene file for a folder; meshes are named relative to it."""
    scene = proposal.scene
    geometry = dict(scene.tables["geometry"])
    for body in ("moving", "fixed"):
        geometry[body] = relative(Path(geometry[body]), folder)
    head = [
        f"# Proposed from {Path(geometry['moving']).name} (moving) and {Path(geometry['fixed']).name} (fixed):",
        *(f"# - {line}" for line in proposal.told),
        f"# - {len(proposal.poses)} of {proposal.frames} frames of the reference motion settle",
        "# Not told by the meshes:",
        *(f"# - {line}" for line in proposal.untold),
    ]
    tables = {**scene.tables, "geometry": geometry}
    return "\n".join([*head, "", *_lines("", tables)]) + "\n"


def proposal_lines(proposal: Proposal) -> list[str]:
    """What was understood, what was not, and how well the scene settles."""
    share = len(proposal.poses) / max(proposal.frames, 1)
    return [
        f"a joint like a {proposal.joint.kind}, patches: {', '.join(proposal.joint.patches)}"
        if proposal.joint.kind != "other"
        else f"patches: {', '.join(proposal.joint.patches)}",
        *proposal.told,
        *(f"not told by the meshes: {line}" for line in proposal.untold),
        f"{len(proposal.poses)} of {proposal.frames} reference frames settle ({share:.1%})",
    ]


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
            lines.append(f"{one_line:<46} # {_COMMENTS[key]}" if key in _COMMENTS else one_line)
    for key, value in table.items():
        if isinstance(value, Mapping):
            name = f"{path}{key}"
            comment = _COMMENTS.get(f"[{name}]")
            inner = _lines(f"{name}.", value)
            has_values = any(not isinstance(each, Mapping) for each in value.values())
            head = [f"[{name}]" + (f"  # {comment}" if comment else "")] if has_values else []
            lines += [*([""] if head else []), *head, *inner]
    return lines
