"""Poses that a page begins with: a cycle to scrub through, presets, and the range of every slider."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import POSE_NAMES, Array, pose_index
from casadi_contact.pictures.contact_picture import contact_pose
from casadi_contact.pictures.page import patch_title
from casadi_contact.samples.reference import reference_poses
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.pose_file import read_poses_over_time
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.project import has_gait, reference_motion_cycles

_LEAST_REACH = np.array([3.0, 3.0, 3.0, 0.1, 0.1, 0.1])  # of a slider to either side of the cycle's poses [mm, rad]
_GAP_MM = 0.25  # of a lifted side: a ball in its cup has no more
_STEPS = 30


@dataclass(frozen=True, eq=False)
class PageCycle:
    """poses (n, 6) over time_s (n,), and where they come from in words."""

    time_s: Array
    poses: Array
    source: str


def page_cycle(model: ContactModel, path: str | None) -> PageCycle:
    """The poses of a file, or those that carry the scene's first reference cycle; one pose for a scene without.

    Poses of a file without times are taken to be evenly spaced over one second.
    """
    scene = model.scene
    if path is not None:
        time_s, poses = read_poses_over_time(path)
        even = np.linspace(0.0, 1.0, len(poses))
        return PageCycle(even if time_s is None else time_s, poses, f"{len(poses)} poses of a file")
    if not scene.motion and not has_gait(scene):
        return PageCycle(np.zeros(1), contact_pose(ElasticFoundation(scene))[None], "a pose in contact")
    cycle = reference_motion_cycles(scene, ())[0]
    poses, report = reference_poses(model, [cycle])
    return PageCycle(
        np.linspace(cycle.time_s[0], cycle.time_s[-1], len(poses[0])), poses[0], "; ".join(str(report).splitlines())
    )


def slider_ranges(poses: Array, surrogate: Surrogate | None) -> tuple[Array, str]:
    """Lowest and highest of each pose parameter (6, 2), and in words why: what was learned, or the cycle and some."""
    learned = {} if surrogate is None else surrogate.record.get("pose_range", {})
    if set(POSE_NAMES) <= set(learned):
        return np.array([learned[name] for name in POSE_NAMES], dtype=float), "learned"
    low, high = poses.min(axis=0), poses.max(axis=0)
    reach = np.maximum(0.25 * (high - low), _LEAST_REACH)
    return np.stack([low - reach, high + reach], 1), "cycle"


def presets(model: CompiledFoundation, poses: Array) -> dict[str, Array]:
    """Poses (6,) by name: where the cycle presses most and least, and a side lifted by a quarter of a millimetre."""
    normal = normal_forces(model.scene.normal_loads, model.wrenches(poses))
    total = normal.sum(axis=1)
    stance = poses[np.argmax(total)]
    found = {"stance": stance, "swing": poses[np.argmin(total)]}
    for p, patch in enumerate(model.patch_names):
        lifted = _lifted(model, stance, p)
        if lifted is not None:
            found[f"{patch_title(patch)} lifted" if len(model.patch_names) > 1 else "lifted"] = lifted
    return found


def _lifted(model: ContactModel, pose: Array, patch: int) -> Array | None:
    """The pose changed in the sensitive parameters until a patch has a gap and the others keep their root loads, by
    Newton's method on root loads; None where that leads nowhere."""
    scene, space, pose = model.scene, model.scene.pose_space, pose.copy()
    free = [pose_index(name) for name in scene.sensitive_pose]
    target = model.root_loads(pose)[0].copy()
    target[patch] = -scene.gap_slope * _GAP_MM
    for _ in range(_STEPS):
        s, slope = model.root_loads(pose)
        if np.abs(s - target).max() < 1e-9:
            return pose
        step = np.linalg.lstsq(space.pull_back(slope)[:, free], target - s, rcond=None)[0]
        pose[free] += step * min(1.0, 1.0 / np.abs(step).max(initial=1e-300))
        pose = space.project(pose)
    return None


def settled_by(scene: Scene) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Free pose parameters and target loads of the page's settling: none where their numbers differ."""
    free, target = scene.sensitive_pose, tuple(name for name in scene.sensitive_loads if name in scene.load_names)
    return (free, target) if free and len(free) == len(target) else ((), ())
