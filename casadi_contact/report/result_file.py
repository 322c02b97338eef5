"""JSON result files that say what they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from casadi_contact.files import MOST_TEXT, checked_size


def read_result(path: str | Path, kind: str, command: str) -> dict[str, Any]:
    """The content of a file whose ``format`` is "casadi_contact KIND"; ValueError if it is something else."""
    checked_size(Path(path), MOST_TEXT)
    try:
        content = json.loads(Path(path).read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a file of {kind} ({error})") from None
    if not isinstance(content, dict) or content.get("format") != f"casadi_contact {kind}":
        raise ValueError(f"{path} is not a file of {kind}, expected one written by casadi-contact {command}")
    return content
