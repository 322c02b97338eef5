"""Result files that pages are made from, and which of them is damaged where a page cannot be made."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from casadi_contact.core.files.reading import one_line


def read_stored(path: Path) -> dict[str, Any]:
    """The content of a JSON file; ValueError, naming it, for one that holds none."""
    with damage_told(path):
        content = json.loads(path.read_text("utf-8"))
        if not isinstance(content, dict):
            raise ValueError(f"it holds a {type(content).__name__}, expected an object")
        return content


@contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Within, whatever a page misses in the content of a file is a ValueError that names the file, and the cure."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:  # what is missing or of another kind leads to errors of many kinds
        said = one_line(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {one_line(error)}"
        raise ValueError(f"{path} is damaged ({said}): run the command that wrote it again") from None
