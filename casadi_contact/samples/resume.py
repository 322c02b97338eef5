"""What an interrupted draw goes on from: its reference motion and the chunks drawn so far.

Chunks lie in a folder beside the samples file, one file each, written atomically; a rerun draws those that are missing.
A resumed draw uses the very motion that it began with, even one of a noisy contact model.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.files.containers import read_npz, write_npz
from casadi_contact.core.files.reading import MOST_TEXT, checked_size
from casadi_contact.core.files.writing import write_text
from casadi_contact.samples.chunk import DrawnChunk
from casadi_contact.samples.reference import Cycle, ReferenceMotion
from casadi_contact.samples.samples import COLUMNS, partial_folder
from casadi_contact.samples.settings import SamplePoint, SamplingSettings
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.scene import Scene


def begun(path: Path) -> Path | None:
    """Where an earlier run left samples for the samples file `path`: the file, or its folder of chunks."""
    if path.exists():
        return path
    folder = partial_folder(path)
    return folder if any(folder.glob("chunk-*.npz")) else None


class ChunkFolder:
    """Chunks drawn so far for the samples file `path`; identity says which plan they belong to.

    Raises ValueError if chunks of another plan lie there, OSError if the folder cannot be written.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        self.folder = partial_folder(path)
        record = self.folder / "plan.json"
        text = json.dumps(identity, indent=1)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OSError(f"cannot write samples to {path}: {error.strerror or error}") from None
        if not record.exists() or begun(path) is None:
            write_text(record, text)
        checked_size(record, MOST_TEXT)
        try:
            before = dict(json.loads(record.read_text("utf-8")))
        except (ValueError, TypeError):
            raise ValueError(f"{record} is damaged: delete {self.folder} and draw again") from None
        check_same_plan(before, json.loads(text), self.folder)

    def _file(self, number: int) -> Path:
        return self.folder / f"chunk-{number:06d}.npz"

    def read(self, number: int) -> DrawnChunk | None:
        """Chunk `number`; None if it is not drawn yet, or damaged."""
        try:
            arrays = read_npz(self._file(number))
            dropped = json.loads(str(arrays.pop("dropped")))
            return DrawnChunk(**arrays, dropped=dropped)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def write(self, number: int, chunk: DrawnChunk) -> None:
        """Write chunk `number`; raises OSError in one line."""
        arrays = {name: getattr(chunk, name) for name in (*COLUMNS, "dropped_poses")}
        write_npz(self._file(number), **arrays, dropped=np.array(json.dumps(dict(chunk.dropped), sort_keys=True)))

    def remove(self) -> None:
        """Delete the folder, once the samples file is complete."""
        shutil.rmtree(self.folder)


def check_same_plan(before: Mapping[str, Any], now: Mapping[str, Any], where: Path) -> None:
    """Raise ValueError, naming the first difference, where samples come from another plan."""
    cure = f"use the same, another file, or delete {where}"
    for key in now:
        old, new = before.get(key), now[key]
        if old == new:
            continue
        if key == "settings" and isinstance(old, dict):
            name = next(n for n in sorted({*old, *new}) if old.get(n) != new.get(n))
            raise ValueError(f"{where} was drawn with {name} = {old.get(name)}, now {new.get(name)}: {cure}")
        named = {"scene": "scene", "plan_digest": "reference motion", "cycles": "cycles"}
        if key in named:
            raise ValueError(f"{where} was drawn with another {named[key]}: {cure}")
        raise ValueError(f"{where} was drawn with {key} {old}, now {new}: {cure}")


def motion_origin(
    scene: Scene, cycles: Sequence[Cycle], settings: SamplingSettings, models: Mapping[str, str]
) -> dict[str, Any]:
    """What a reference motion depends on; models: name and version of what made the contact models."""
    digest = hashlib.sha256()
    for cycle in cycles:
        digest.update(cycle.name.encode())
        for name, curve in {"time_s": cycle.time_s, **cycle.measured_pose(), **cycle.targets()}.items():
            digest.update(name.encode())
            digest.update(np.asarray(curve, dtype=float).tobytes())
    of_settings = {"frames": settings.frames, "inputs": list(settings.sample_point(scene).inputs)}
    return {"scene": scene.digest, "settings": of_settings, "cycles": digest.hexdigest(), **models}


def write_motion(
    path: Path,
    motion: ReferenceMotion,
    cycles: Sequence[str],
    report: str,
    files: Sequence[Path],
    origin: Mapping[str, Any],
) -> None:
    """Write a reference motion, the names of its cycles, and the report of its estimation; files: where the cycles were
    read, none for built-in ones."""
    write_npz(
        path,
        inputs=np.array(motion.point.inputs),
        cycles=np.array(cycles),
        files=np.array([str(file) for file in files], dtype=str),
        curves=motion.curves,
        poses=motion.poses,
        report=np.array(report),
        origin=np.array(json.dumps(origin)),
    )


def motion_in(content: Mapping[str, np.ndarray], space: PoseSpace) -> ReferenceMotion:
    """The motion in a file's arrays; raises ValueError or KeyError where they are damaged."""
    if not all(np.isfinite(content[name]).all() for name in ("curves", "poses")):
        raise ValueError("curves or poses are not finite")
    point = SamplePoint.of_inputs([str(name) for name in content["inputs"]], space)
    return ReferenceMotion(point, content["curves"], content["poses"])


def kept_motion(
    path: Path, space: PoseSpace, origin: Mapping[str, Any], drawn: Path
) -> tuple[ReferenceMotion, str] | None:
    """The reference motion that the samples in `drawn` were begun with, and its report; None without a file.

    Raises ValueError for a motion estimated from something else than `origin`, and for a damaged file.
    """
    if not path.is_file():
        return None
    content = read_npz(path)
    try:
        before, report = dict(json.loads(str(content["origin"]))), str(content["report"])
        motion = motion_in(content, space)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise ValueError(f"{path} is damaged ({error}): remove it and sample again") from None
    check_same_plan(before, origin, drawn)
    return motion, report
