"""The folder beside a samples file in which its chunks gather while it is being drawn.

Every chunk is one file, written beside and renamed: a kill at any moment leaves only whole chunks, and a rerun goes
on with those that are missing.
"""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.dataset import COLUMNS, partial_folder
from casadi_contact.sampling.chunk import DrawnChunk

_RECORD = "plan.json"


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
            if not record.exists():
                _write_beside(record, text.encode())
        except OSError as error:
            raise OSError(f"cannot write samples to {path}: {error}") from error
        try:
            there = json.loads(record.read_text("utf-8"))
        except ValueError:
            raise ValueError(f"{record} is damaged: delete {self.folder} and draw again") from None
        refuse_other(there, json.loads(text), self.folder)

    def _file(self, number: int) -> Path:
        return self.folder / f"chunk-{number:06d}.npz"

    def read(self, number: int) -> DrawnChunk | None:
        """Chunk `number`, or None if it is not drawn yet (or its file does not read, and must be drawn again)."""
        try:
            with np.load(self._file(number), allow_pickle=False) as file:
                dropped = json.loads(str(file["dropped"]))
                columns = {name: file[name] for name in (*COLUMNS, "dropped_poses")}
                return DrawnChunk(**columns, dropped=dropped)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def write(self, number: int, chunk: DrawnChunk) -> None:
        """Write chunk `number` beside and rename it."""
        file = self._file(number)
        beside = file.with_name(f"{file.name}.{os.getpid()}.tmp")
        with beside.open("wb") as stream:
            np.savez(
                stream,
                **{name: getattr(chunk, name) for name in (*COLUMNS, "dropped_poses")},
                dropped=np.array(json.dumps(dict(chunk.dropped), sort_keys=True)),
            )
        os.replace(beside, file)

    def remove(self) -> None:
        """Delete the folder, once the samples file is complete."""
        shutil.rmtree(self.folder)


def _write_beside(file: Path, content: bytes) -> None:
    beside = file.with_name(f"{file.name}.{os.getpid()}.tmp")
    beside.write_bytes(content)
    os.replace(beside, file)


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
        if key in ("scene", "plan_digest"):
            what = "scene" if key == "scene" else "reference motion"
            raise ValueError(f"{where} was drawn with another {what}: {cure}")
        raise ValueError(f"{where} was drawn with {key} {there.get(key)}, now {wanted[key]}: {cure}")
