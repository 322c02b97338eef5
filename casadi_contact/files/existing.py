"""Whether there is a file to read."""

from __future__ import annotations

from pathlib import Path


def existing_file(path: str | Path, what: str = "file", expected: str = "a file") -> Path:
    """The path; raises FileNotFoundError where no regular file is, naming what else stands there."""
    path = Path(path)
    if path.is_file():
        return path
    if path.is_dir():
        raise FileNotFoundError(f"{what} {path} is a folder, expected {expected}")
    if path.exists():
        raise FileNotFoundError(f"{what} {path} is a pipe or a device, expected {expected}: save it as one first")
    raise FileNotFoundError(f"{what} {path} does not exist")
