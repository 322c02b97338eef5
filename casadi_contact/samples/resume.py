"""What an interrupted draw goes on from: its reference motion and the chunks drawn so far.

Chunks lie in a folder beside the samples file, one file each, written atomically; a rerun draws those that are missing.
A resumed draw uses the very motion that it began with, even one of a noisy contact model.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.files.containers import read_npz, write_npz
from casadi_contact.core.files.reading import MOST_TEXT, checked_size
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.samples.chunk import DrawnChunk
from casadi_contact.samples.reference import Cycle, ReferenceMotion
from casadi_contact.samples.samples import COLUMNS, partial_folder
from casadi_contact.samples.settings import SamplePoint, SamplingSettings
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.scene import Scene


def earlier_samples(path: Path) -> Path | None:
    """Where an earlier run left samples for the samples file `path`: the file, or its folder of chunks, or None."""
    if path.exists():
        return path
    folder = partial_folder(path)
    return folder if any(folder.glob("chunk-*.npz")) else None


class ChunkFolder:
    """Chunks drawn so far for the samples file `path`; identity says which plan they belong to."""

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        self.folder = partial_folder(path)
        record = self.folder / "plan.json"
        writable_folder(self.folder)
        if not record.exists() or earlier_samples(path) is None:
            write_text(record, json.dumps(identity, indent=1))
        checked_size(record, MOST_TEXT)
        try:
            before = dict(json.loads(record.read_text("utf-8")))
        except (ValueError, TypeError):
            raise ValueError(f"{record} is damaged: delete {self.folder} and draw again") from None
        check_same_plan(before, identity, self.folder)

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


def check_same_plan(before: Mapping[str, Any], now: Mapping[str, Any], where: Path) -> None:
    """Raise ValueError, naming the first difference, where samples come from another plan; both as JSON stores them."""
    old, new = ({**dict(plan.get("settings", {})), **plan} for plan in (before, json.loads(json.dumps(now))))
    for name in (name for name in new if name != "settings" and old.get(name) != new[name]):
        if name in (named := {"scene": "scene", "plan_digest": "reference motion", "cycles": "cycles"}):
            what = f"another {named[name]}"
        else:
            what = f"{name} = {old.get(name)}, now {new[name]}"
        raise ValueError(f"{where} was drawn with {what}: use the same, another file, or delete {where}")


def motion_origin(
    scene: Scene, cycles: Sequence[Cycle], settings: SamplingSettings, models: Mapping[str, str]
) -> dict[str, Any]:
    """What a reference motion depends on; models: name and version of what made the contact models."""
    digest = hashlib.sha256()
    for cycle in cycles:
        digest.update(cycle.name.encode())
        for name, curve in {"time_s": cycle.time_s, **cycle.pose, **cycle.targets()}.items():
            digest.update(name.encode())
            digest.update(np.asarray(curve, dtype=float).tobytes())
    of_settings = {"frames": settings.frames, "inputs": list(settings.sample_point(scene).inputs)}
    return {"scene": scene.digest, "settings": of_settings, "cycles": digest.hexdigest(), **models}


@dataclass(frozen=True)
class KeptMotion:
    """A reference motion, its report, the files of its cycles (none for built-in ones), and its `motion_origin`."""

    motion: ReferenceMotion
    report: str
    files: tuple[str, ...]
    origin: Mapping[str, Any]

    def write(self, path: Path) -> None:
        """Write ``motion.npz``."""
        texts = {name: np.array(getattr(self, name), dtype=str) for name in ("report", "files")}
        inputs, origin = np.array(self.motion.point.inputs), np.array(json.dumps(self.origin))
        write_npz(path, inputs=inputs, curves=self.motion.curves, poses=self.motion.poses, origin=origin, **texts)

    @classmethod
    def read(cls, path: Path, space: PoseSpace) -> KeptMotion:
        """Read ``motion.npz``; raises FileNotFoundError, and ValueError for a damaged file or another pose space."""
        try:
            content = read_npz(path)
            point = SamplePoint(tuple(map(str, content["inputs"])), space.free_names)
            motion = ReferenceMotion(point, content["curves"], content["poses"])
            if not (np.isfinite(motion.curves).all() and np.isfinite(motion.poses).all()):
                raise ValueError("curves or poses are not finite")
            files, origin = tuple(map(str, content["files"])), dict(json.loads(str(content["origin"])))
            return cls(motion, str(content["report"]), files, origin)
        except FileNotFoundError:
            raise
        except (ValueError, KeyError, IndexError, TypeError, OSError) as error:
            raise ValueError(f"{path} is damaged, or of another scene ({error}): delete it and sample again") from None
