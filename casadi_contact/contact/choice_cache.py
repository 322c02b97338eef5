"""Choices of contact models kept on disc, so that a scene's convergence test runs once.

A file holds the record of a choice as JSON, and the SHA-256 of that. Its name is the SHA-256 of the scene's content,
its tolerances and the library's code: a scene or a library that differs finds none. What cannot be read, is not as
written, or could be another user's is as good as absent, and where the folder cannot be written nothing is kept.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from casadi_contact.core.compiler import cache_folder, check_private, is_private
from casadi_contact.core.files.writing import write_bytes
from casadi_contact.scenes.scene import Scene

_MOST_BYTES = 100_000
_PACKAGE = Path(__file__).parents[1]


def kept_record(scene: Scene) -> dict[str, Any] | None:
    """The record of the choice made for a scene; None where there is none."""
    path = _path(scene)
    with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
        check_private(path.parent)
        if path.stat().st_size <= _MOST_BYTES and is_private(path):
            content = json.loads(path.read_bytes())
            if content["sha256"] == _digest(content["record"]):
                return dict(content["record"])
    return None


def keep_record(scene: Scene, record: Mapping[str, Any]) -> None:
    """Keep the record of a choice: plain values."""
    path = _path(scene)
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        check_private(path.parent)
        write_bytes(path, json.dumps({"sha256": _digest(record), "record": record}).encode())


def _path(scene: Scene) -> Path:
    wanted = json.dumps(dict(scene.tolerances), sort_keys=True)
    key = hashlib.sha256(f"{scene.digest} {wanted} {_code_digest()}".encode()).hexdigest()[:32]
    return cache_folder() / f"choice-{key}.json"


def _digest(record: object) -> str:
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


@cache
def _code_digest() -> str:
    paths = sorted(path for ending in ("py", "h") for path in _PACKAGE.rglob(f"*.{ending}"))
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in paths)).hexdigest()
