"""The folder beside a samples file in which its chunks gather while it is being drawn.

Every chunk is one file, written beside and renamed: a kill at any moment leaves only whole chunks, and a rerun goes
on with those that are missing.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.files.containers import read_npz, write_npz
from casadi_contact.core.files.reading import MOST_TEXT, checked_size
from casadi_contact.core.files.writing import write_text
from casadi_contact.samples.chunk import DrawnChunk
from casadi_contact.samples.samples import COLUMNS, partial_folder

_RECORD = "plan.json"
_NAMED = {"scene": "another scene", "plan_digest": "another reference motion", "cycles": "other cycles"}


def begun(path: Path) -> Path | None:
    """Where samples for the samples file `path` lie that an earlier run drew: there, or in its folder of chunks."""
    if path.exists():
        return path
    folder = partial_folder(path)
    return folder if any(folder.glob("chunk-*.npz")) else None


class ChunkFolder:
    """Chunks drawn so far for the samples file `path`; identity says what they are chunks of.

    Raises ValueError if chunks of something else lie there, OSError if the folder cannot be written.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        self.folder = partial_folder(path)
        record = self.folder / _RECORD
        text = json.dumps(identity, indent=1)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OSError(f"cannot write samples to {path}: {error.strerror or error}") from None
        if not record.exists() or begun(path) is None:
            write_text(record, text)
        checked_size(record, MOST_TEXT)
        try:
            there = json.loads(record.read_text("utf-8"))
            if not isinstance(there, dict):
                raise ValueError
        except (ValueError, RecursionError):
            raise ValueError(f"{record} is damaged: delete {self.folder} and draw again") from None
        refuse_other(there, json.loads(text), self.folder)

    def _file(self, number: int) -> Path:
        return self.folder / f"chunk-{number:06d}.npz"

    def read(self, number: int) -> DrawnChunk | None:
        """Chunk `number`, or None if it is not drawn yet (or its file does not read, and must be drawn again)."""
        try:
            arrays = read_npz(self._file(number))
            dropped = json.loads(str(arrays.pop("dropped")))
            return DrawnChunk(**arrays, dropped=dropped)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def write(self, number: int, chunk: DrawnChunk) -> None:
        """Put chunk `number` in its place; raises OSError in one line."""
        arrays = {name: getattr(chunk, name) for name in (*COLUMNS, "dropped_poses")}
        write_npz(self._file(number), **arrays, dropped=np.array(json.dumps(dict(chunk.dropped), sort_keys=True)))

    def remove(self) -> None:
        """Delete the folder, once the samples file is complete; of a link to one the chunks and the link."""
        if not self.folder.is_symlink():
            shutil.rmtree(self.folder)
            return
        for path in (*self.folder.glob("chunk-*.npz"), self.folder / _RECORD):  # others may have files there
            path.unlink()
        self.folder.unlink()


def refuse_other(there: Mapping[str, Any], wanted: Mapping[str, Any], where: Path) -> None:
    """Raise ValueError, naming the first difference, if what lies there comes from another plan than wanted."""
    cure = f"use the same there, another file, or delete {where}"
    for key in wanted:
        if there.get(key) == wanted[key]:
            continue
        if key == "settings" and isinstance(there.get(key), dict):
            got, new = there[key], wanted[key]
            name = next(n for n in sorted({*got, *new}) if got.get(n) != new.get(n))
            raise ValueError(f"{where} was drawn with {name} = {got.get(name)}, now {new.get(name)}: {cure}")
        if key in _NAMED:
            raise ValueError(f"{where} was drawn with {_NAMED[key]}: {cure}")
        raise ValueError(f"{where} was drawn with {key} {there.get(key)}, now {wanted[key]}: {cure}")
