"""Kinds of joints as a proposal knows them: how they are recognised, and what their scenes name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from casadi_contact.core.conventions import WRENCH_NAMES, Array
from casadi_contact.geometry.projection import axis_name
from casadi_contact.workflow.proposal.meeting import Meeting
from casadi_contact.workflow.proposal.pair import Pair, centre_of_normals
from casadi_contact.workflow.proposal.regions import Regions

JOINTS = ("knee", "hip", "patella", "other")
_CUP = 0.9  # concentration of normals below which a single patch encloses the moving body
_LEAST_ANSWER = 0.1  # of what shifts load between patches, to what presses all of them
_GROOVE_DEG = 40.0  # between the normals of neighbouring patches


@dataclass(frozen=True)
class Joint:
    """kind: one of `JOINTS`. patches: names by falling coordinate (library's axes) along which they lie side by side.
    pressing: signed axis of the library along which each patch is pressed ("-y"); "" where the force turns (a cup)."""

    kind: str
    patches: tuple[str, ...]
    pressing: str

    @property
    def sensitive(self) -> list[str]:
        """The scene's loads.sensitive: the normal load of each patch."""
        if not self.pressing:
            return ["F"] if len(self.patches) == 1 else [f"F_{patch}" for patch in self.patches]
        sign = "-" if self.pressing[0] == "-" else "+"
        return [f"{sign}{name}" for name in self._forces]

    @property
    def loads(self) -> list[str]:
        """The scene's loads.names: the normal loads by patch, all others of all patches together."""
        if not self.pressing:
            split = [f"{force}_{patch}" for patch in self.patches for force in WRENCH_NAMES[:3]]
            return [*(split if len(self.patches) > 1 else WRENCH_NAMES[:3]), *WRENCH_NAMES[3:]]
        pressed = f"F{self.pressing[1]}"
        return [*self._forces, *(name for name in WRENCH_NAMES if name != pressed)]

    @property
    def sensitive_pose(self) -> list[str]:
        """The pose parameters that the normal loads answer to most: of the knee [EF15 §2.1]."""
        if not self.pressing:
            return ["tx", "ty", "tz"]
        press = f"t{self.pressing[1]}"
        if len(self.patches) == 1:
            return [press]
        return [press, "tz" if self.kind == "patella" else "rx" if self.pressing[1] == "y" else "ry"]

    def pressed_along(self, direction: Array) -> Joint:
        """The joint in axes that are given, in which the moving body presses along `direction` (3,): along the nearest
        axis, unless the kind of joint tells which it is or the force turns."""
        return replace(self, pressing=axis_name(direction)) if self.kind == "other" and self.pressing else self

    @property
    def _forces(self) -> list[str]:
        force = f"F{self.pressing[1]}"
        return [force] if len(self.patches) == 1 else [f"{force}_{patch}" for patch in self.patches]


def joint_of(pair: Pair, meeting: Meeting, regions: Regions, kind: str | None = None) -> Joint:
    """The joint that the bodies look like, or the kind that is given; raises ValueError where the two cannot agree."""
    count = len(regions.cuts_mm) + 1
    if kind is None:
        if count == 1:
            kind = "hip" if meeting.concentration < _CUP and regions.hollow else "other"
        else:
            kind = "patella" if _angle_deg(pair, regions) > _GROOVE_DEG else "knee"
            kind = kind if count == 2 and pair.scale == 1.0 else "other"  # as large as a knee
    expected = {"knee": 2, "hip": 1, "patella": 2}.get(kind, count)
    if count != expected:
        raise ValueError(
            f"the bodies come near each other in {'one place' if count == 1 else f'{count} places side by side'}, a "
            f"{kind} in {expected}: choose another --joint, or cut the meshes to the surfaces that touch"
        )
    if kind == "other":
        names: Sequence[str] = ("contact",) if count == 1 else [f"p{k + 1}" for k in range(count)]
    else:
        names = ("contact",) if count == 1 else ("med", "lat")
    turning = count == 1 and (kind == "hip" or meeting.concentration < _CUP)  # a hip that is asked for may be shallow
    return Joint(kind, tuple(names), "" if turning else "+x" if kind == "patella" else "-y")


def patches_part(pair: Pair, meeting: Meeting, regions: Regions, joint: Joint) -> bool:
    """Whether the sensitive pose shifts load between the patches: the gaps of what comes near answer differently to its
    two parameters. They do not to a turn about where all normals meet, as of a spool in a notch about its axis."""
    pressed, beside = (np.eye(3)[int(axis)] for axis in (np.abs(meeting.pressing).argmax(), regions.axis or 0))
    patch, axis = regions.patch_of(pair.points_mm), np.cross(pressed, beside)
    shares = regions.weight * (patch == np.arange(len(joint.patches))[:, None])
    shares /= shares.sum(axis=1, keepdims=True)
    second = pair.normals @ beside
    if joint.kind != "patella":
        across = np.eye(3) - np.outer(axis, axis)
        normals, sizes = pair.normals @ across, np.linalg.norm(pair.normals @ across, axis=1)
        seen = sizes > 0.5  # a normal along the axis has no line across it
        points = pair.points_mm @ across
        pivot = centre_of_normals(points[seen], (normals[seen].T / sizes[seen]).T, regions.weight[seen])
        second = np.cross(points - pivot, normals) @ axis / (0.5 * np.ptp(shares @ points @ beside))
    answers = np.linalg.svd(shares @ np.stack([pair.normals @ pressed, second], axis=1), compute_uv=False)
    return bool(answers[1] > _LEAST_ANSWER * answers[0])


def _angle_deg(pair: Pair, regions: Regions) -> float:
    """The angle between the mean normals of the first and the last patch."""
    patch, means = regions.patch_of(pair.points_mm), []
    for number in (0, len(regions.cuts_mm)):
        mean = (regions.weight * (patch == number)) @ pair.normals
        means.append(mean / max(float(np.linalg.norm(mean)), 1e-300))
    return float(np.degrees(np.arccos(np.clip(means[0] @ means[1], -1.0, 1.0))))
