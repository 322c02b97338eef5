"""Names of things as names of files."""

from __future__ import annotations

import re

_STEM = re.compile(r"\w[\w .+-]{0,99}")


def file_stem(name: str) -> str:
    """The name of a scene as the start of a file's name; ValueError where it could leave its folder or mislead.

    >>> file_stem("knee-2")
    'knee-2'
    """
    if not _STEM.fullmatch(name) or name != name.strip() or not name.isprintable():
        raise ValueError(
            f"the name {name!r} cannot name a file, expected up to 100 letters, digits, _ - + . and spaces: "
            "change the scene's name, or choose another place with --out"
        )
    return name
