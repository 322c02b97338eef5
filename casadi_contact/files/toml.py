"""TOML that anyone may have written: its size and depth are bounded, and every refusal is one line."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from casadi_contact.files.existing import existing_file
from casadi_contact.files.limits import checked_size

MOST_CHARACTERS = 1_000_000  # of a scene's or an assembly's text
_MOST_PARTS = 100  # of a dotted key, for the square of which tomllib takes time: 100,000 take minutes
_PART = r"""(?:(?<![\w-])[\w-]++|(?<!\\)"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}")


def toml_text(path: Path, what: str) -> str:
    """The text of a file; raises FileNotFoundError, ValueError for a folder, one too large and for what is no text."""
    if path.is_dir():
        raise ValueError(f"{path} is a folder, expected the TOML file of the {what}")
    checked_size(existing_file(path, f"{what} file"), 4 * MOST_CHARACTERS)
    try:
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text ({error.reason}), expected TOML of the {what}") from None


def toml_tables(text: str, what: str) -> dict[str, Any]:
    """What the text says; raises ValueError, which begins with `what`, for text that is too long or not TOML."""
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"{what}: the text has {len(text)} characters, expected at most {MOST_CHARACTERS}")
    too_deep = f"{what}: tables or lists are nested too deep, expected a few levels"
    if _LONG_KEY.search(text):
        raise ValueError(too_deep)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(too_deep) from None
    except ValueError as error:  # not TOML, or an integer of thousands of digits
        raise ValueError(f"{what}: not valid TOML ({error})") from None
