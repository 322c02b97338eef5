"""A scene that was proposed, or cut, as a commented .toml and as lines for a terminal."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from casadi_contact.core.quantities import three_digits
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.proposal.cuts import PatchCuts
from casadi_contact.workflow.proposal.propose import Proposal

_CUT = {"split_z": "cuts along z [mm] between parts, which networks learn apart"}
_PROPOSED = {
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
    "fine": "found by a convergence test: for checks of your own",
    "settle": "finds poses for wanted loads",
    "teacher": "what networks learn, and what a solution is checked on",
    "sensitive": "the normal load of each patch",
    "gap_slope": "root load per mm of overlap, as contact itself gives it",
    "[tolerances]": "1 % of the largest force and torque of the reference motion: N, N·mm",
    "[sampling.fixed_offsets]": "mm, of D1 and D2, where the motion stands still: leave out for measured cycles",
    "most_dropped": "of a domain's plan, since contact reaches an edge: such poses are no samples",
    "[motion]": "Made up: put measured harmonics here, or give cycle files",
}


def scene_text(proposal: Proposal, folder: Path) -> str:
    """The scene file for a folder; meshes are named relative to it."""
    geometry = proposal.scene.tables["geometry"]
    head = [
        f"Proposed from {Path(geometry['moving']).name} (moving) and {Path(geometry['fixed']).name} (fixed):",
        *(f"- {line}" for line in proposal.told),
        f"- {len(proposal.poses)} of {proposal.frames} frames of the reference motion settle",
        "Not given by the meshes:",
        *(f"- {line}" for line in proposal.untold),
    ]
    return _commented(head, proposal.scene, folder, _PROPOSED)


def cut_text(scene: Scene, found: Sequence[PatchCuts], command: str, folder: Path) -> str:
    """The scene file, for a folder, of a scene whose patches were cut by a command."""
    head = [f"Cut into parts by {command}:", *(f"- {line}" for line in cut_lines(found))]
    return _commented(head, scene, folder, _CUT)


def cut_lines(found: Sequence[PatchCuts]) -> list[str]:
    """How many parts each patch is cut into, and what for."""
    return [_cut_line(cuts) for cuts in found]


def _cut_line(cuts: PatchCuts) -> str:
    whole_n, parts_n = three_digits(cuts.whole_n), three_digits(cuts.parts_n)
    if not cuts.cuts_mm:
        return f"patch {cuts.patch} stays whole: small networks err by {whole_n} N, little less on parts"
    return (
        f"patch {cuts.patch}: {len(cuts.cuts_mm) + 1} parts, on which small networks err by {parts_n} N "
        f"(by {whole_n} N on the whole patch)"
    )


def _commented(head: Sequence[str], scene: Scene, folder: Path, comments: Mapping[str, str]) -> str:
    """The file of a mesh scene, its meshes named relative to a folder: remarks first, comments beside keys."""
    geometry = dict(scene.tables["geometry"])
    for body in ("moving", "fixed"):
        geometry[body] = _relative(Path(geometry[body]), folder)
    tables = {**scene.tables, "geometry": geometry}
    return "\n".join([*(f"# {line}" for line in head), "", *_lines("", tables, comments)]) + "\n"


def _relative(path: Path, folder: Path) -> str:
    """The path as a scene file in the folder names it."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def proposal_lines(proposal: Proposal) -> list[str]:
    """What was understood, what was not, and how well the scene settles."""
    share = len(proposal.poses) / max(proposal.frames, 1)
    return [
        f"a joint like a {proposal.joint.kind}, patches: {', '.join(proposal.joint.patches)}"
        if proposal.joint.kind != "other"
        else f"patches: {', '.join(proposal.joint.patches)}",
        *proposal.told,
        *(f"not given by the meshes: {line}" for line in proposal.untold),
        f"{len(proposal.poses)} of {proposal.frames} reference frames settle ({share:.1%})",
    ]


def _one_line(value: Any) -> str:
    """A value as TOML; lists, which `tomli_w` spreads over lines, on one."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_one_line, value))}]"
    return tomli_w.dumps({"_": value}).strip().partition(" = ")[2]


def _lines(path: str, table: Mapping[str, Any], comments: Mapping[str, str]) -> list[str]:
    """The table's own values, one a line with its comment, then its tables."""
    lines = []
    for key, value in table.items():
        if not isinstance(value, Mapping):
            one_line = f"{tomli_w.dumps({key: 0}).partition(' = ')[0]} = {_one_line(value)}"
            comment = comments.get(f"{path}{key}", comments.get(key))
            lines.append(f"{one_line:<46} # {comment}" if comment else one_line)
    for key, value in table.items():
        if isinstance(value, Mapping):
            name = f"{path}{key}"
            comment = comments.get(f"[{name}]")
            inner = _lines(f"{name}.", value, comments)
            has_values = any(not isinstance(each, Mapping) for each in value.values())
            head = [f"[{name}]" + (f"  # {comment}" if comment else "")] if has_values else []
            lines += [*([""] if head else []), *head, *inner]
    return lines
