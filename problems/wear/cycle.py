"""The motion whose wear is asked for: simulated, or a file's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from casadi_contact.contact import ElasticFoundation, SymbolicContact
from casadi_contact.conventions import POSE_IN_MM, Array
from casadi_contact.motion.pose_file import read_poses
from casadi_contact.quantities import two_digits
from problems import knee_simulator

FEWEST_POSES = 4  # so that every other one, which the report compares with, still goes there and back
_APART = 2.0  # times the next largest step: these poses are no neighbours


def simulated_poses(model: SymbolicContact, frames: int = 200) -> Array:
    """Poses (frames, 6) of the knee simulator's second cycle, by then periodic; the first frame again would follow."""
    motion = knee_simulator.solve(knee_simulator.build(model), cycles=2.0, frames=2 * frames + 1, tolerance=1e-7)
    return motion.poses[frames:-1]


def read_path(path: Path, model: ElasticFoundation) -> Array:
    """Poses (n, 6) of a file (`read_poses`) in the scene's frames.

    Raises ValueError, beyond what it refuses, for fewer than `FEWEST_POSES`, for a path that never touches, and for one
    that presses the bodies into each other by the whole layer: both tell of other units or frames.
    """
    poses = read_poses(path)
    if len(poses) < FEWEST_POSES:
        raise ValueError(f"{path} has {len(poses)} poses, expected a cycle of at least {FEWEST_POSES}")
    deepest, thickness = float(model.summary(poses).penetration_mm.max()), model.scene.material.thickness
    if not 0.0 < deepest < thickness:
        said = f"overlap by {deepest:.3g} mm of a layer of {thickness:g} mm" if deepest else "touch in no pose"
        raise ValueError(
            f"{path}: the bodies of scene {model.scene.name} {said}: are tx, ty, tz in mm, and poses those of the "
            "moving body in the scene's frame?"
        )
    return poses


def leap(poses: Array) -> str:
    """What there is to say of a path (n, 6) with one step far larger than any other: ends that do not close, or poses
    that are missing; "" where there is none."""
    steps = np.linalg.norm(POSE_IN_MM * (poses - np.roll(poses, 1, axis=0)), axis=1)
    at = int(steps.argmax())
    others = float(np.delete(steps, at).max())
    if steps[at] <= _APART * others:
        return ""
    gap = np.abs(poses[at] - poses[at - 1])
    where, cure = "the path's ends", "a whole cycle, or the way back as well"
    if at:
        where, cure = f"poses {at - 1} and {at}", "the poses between them"
    apart_mm, apart_deg = two_digits(float(np.linalg.norm(gap[:3]))), two_digits(np.degrees(gap[3:].max()))
    times = two_digits(steps[at] / max(others, np.finfo(float).tiny))
    return (
        f"{where} are {apart_mm} mm and {apart_deg} degrees apart, {times} times its next largest step: one straight "
        f"step joins them, and wears too; give {cure}"
    )
