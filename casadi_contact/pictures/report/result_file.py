"""JSON result files that say what they are."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from casadi_contact.core.files.reading import MOST_TEXT, checked_size, one_line


def read_result(path: str | Path, kind: str, command: str, tables: Callable[[Any], object]) -> dict[str, Any]:
    """The content of a file whose ``format`` is "casadi_contact KIND", of which its tables can be made.

    Raises ValueError if it is something else, or damaged so that they cannot.
    """
    checked_size(Path(path), MOST_TEXT)
    try:
        content = json.loads(Path(path).read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a file of {kind} ({error})") from None
    if not isinstance(content, dict) or content.get("format") != f"casadi_contact {kind}":
        raise ValueError(f"{path} is not a file of {kind}, expected one written by casadi-contact {command}")
    try:
        tables(content)
    except Exception as error:  # what is missing or of another kind leads to errors of many kinds
        raise ValueError(
            f"{path} is damaged ({type(error).__name__}: {one_line(error)}): run casadi-contact {command} again"
        ) from None
    return content
