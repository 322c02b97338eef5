"""Whom the files of this checkout are readable for."""

from pathlib import Path


def others_may_read(path: Path) -> bool:
    """True where another user reaches the file: the writers run as one where the tests run as root."""
    return all(part.stat().st_mode & 0o005 == 0o005 for part in path.resolve().parents)
