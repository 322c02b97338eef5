"""The file of a reference motion: what was estimated, what became of its frames, and what it was estimated from.

A resumed draw goes on around the very motion that it began with, even one of a contact model that is noisy.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.files.containers import read_npz, write_npz
from casadi_contact.samples.folder import refuse_other
from casadi_contact.samples.reference import Cycle, ReferenceMotion, ReferenceReport
from casadi_contact.samples.sample_point import SamplePoint
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.scene import Scene


def motion_origin(
    scene: Scene, cycles: Sequence[Cycle], settings: SamplingSettings, models: Mapping[str, str]
) -> dict[str, Any]:
    """What a reference motion depends on; models: the names and versions of what made the contact models."""
    digest = hashlib.sha256()
    for cycle in cycles:
        digest.update(cycle.name.encode())
        for name, curve in {"time_s": cycle.time_s, **cycle.measured_pose(), **cycle.targets()}.items():
            digest.update(name.encode())
            digest.update(np.asarray(curve, dtype=float).tobytes())
    of_settings = {"frames": settings.frames, "inputs": list(settings.sample_point(scene).inputs)}
    return {"scene": scene.digest, "settings": of_settings, "cycles": digest.hexdigest(), **models}


def write_motion(
    path: Path, motion: ReferenceMotion, report: ReferenceReport, files: Sequence[Path], origin: Mapping[str, Any]
) -> None:
    """Put the file in its place; files: where the cycles were read, none for built-in ones. OSError in one line."""
    write_npz(
        path,
        inputs=np.array(motion.point.inputs),
        cycles=np.array(report.names),
        files=np.array([str(file) for file in files], dtype=str),
        curves=motion.curves,
        poses=motion.poses,
        converged=report.converged,
        residual=report.residual,
        reason=report.reason.astype(str),
        assumed=np.array(json.dumps(report.assumed)),
        origin=np.array(json.dumps(origin)),
    )


def motion_in(content: Mapping[str, np.ndarray], space: PoseSpace) -> ReferenceMotion:
    """The motion of a file's arrays; ValueError, KeyError, IndexError or TypeError where they are damaged."""
    if not all(np.isfinite(content[name]).all() for name in ("curves", "poses")):
        raise ValueError("curves or poses are not finite")
    point = SamplePoint.of_inputs([str(name) for name in content["inputs"]], space)
    return ReferenceMotion(point, content["curves"], content["poses"])


def kept_motion(
    path: Path, space: PoseSpace, origin: Mapping[str, Any], drawn: Path
) -> tuple[ReferenceMotion, ReferenceReport] | None:
    """The reference motion that the samples in `drawn` were begun around; None where no file says what it came from.

    Raises ValueError for one that was estimated from something else than `origin`, and for a damaged file.
    """
    if not path.is_file():
        return None
    content = read_npz(path)
    if "origin" not in content:  # of a version before
        return None
    try:
        there = json.loads(str(content["origin"]))
        motion = motion_in(content, space)
        report = ReferenceReport(
            tuple(str(name) for name in content["cycles"]),
            content["converged"],
            content["residual"],
            content["reason"].astype(object),
            json.loads(str(content["assumed"])),
        )
        if {part.shape for part in (report.converged, report.residual, report.reason)} != {motion.poses.shape[:2]}:
            raise ValueError("its report has other frames")
        if not isinstance(there, dict) or not isinstance(report.assumed, dict):
            raise ValueError("its record is none")
    except (ValueError, KeyError, IndexError, TypeError, RecursionError) as error:
        raise ValueError(f"{path} is damaged ({error}): remove it and sample again") from None
    refuse_other(there, origin, drawn)
    return motion, report
