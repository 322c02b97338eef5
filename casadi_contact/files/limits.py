"""Stated limits: a file that asks for more than it can be worth is refused at once, before it is read."""

from __future__ import annotations

from pathlib import Path

MIB = 1 << 20
MOST_TEXT = 256 * MIB  # of a table or a result file
MOST_MESH = 512 * MIB
MOST_DATA = 4096 * MIB  # of samples, checkpoints and surrogates
MOST_UNPACKED = 1024 * MIB  # of compressed data


def checked_size(path: Path, most_bytes: int) -> int:
    """Size of a file in bytes; raises ValueError where it is larger than any sound one."""
    size = path.stat().st_size
    if size > most_bytes:
        raise ValueError(f"{path} has {size} bytes, expected at most {most_bytes}: is it the right file?")
    return size


def one_line(error: BaseException) -> str:
    """What an error says in one line, or its kind where it says nothing."""
    return short(str(error)) or type(error).__name__


def short(text: str, most: int = 300) -> str:
    """A file's text as a message may quote it: in one line of at most so many characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[:most]}..."
