"""Reading files that anyone may have written: bounded sizes, errors of one line, nothing that runs code."""

import hashlib
import math
import re
import tomllib
from pathlib import Path
from typing import Any

MIB = 1 << 20
MOST_TEXT = 256 * MIB  # bytes of a table or a result file
MOST_MESH = 512 * MIB
MOST_DATA = 4096 * MIB  # of samples, checkpoints and surrogates
MOST_UNPACKED = 1024 * MIB  # of compressed data
MOST_TOML = MIB


def existing_file(path: str | Path, what: str = "file", expected: str = "a file") -> Path:
    """The path; FileNotFoundError where there is no regular file (a pipe would block), ValueError for its name."""
    path = Path(path)
    if any("\ud800" <= letter <= "\udfff" for letter in str(path)):
        raise ValueError(f"{what} {str(path)!a} has a name that is not UTF-8: rename it")
    if path.is_file():
        return path
    if path.exists():
        kind = "folder" if path.is_dir() else "pipe or device"
        raise FileNotFoundError(f"{what} {path} is a {kind}, expected {expected}")
    raise FileNotFoundError(f"{what} {path} does not exist")


def checked_size(path: Path, most_bytes: int) -> int:
    """Size of a file in bytes; raises ValueError where it exceeds the limit."""
    size = path.stat().st_size
    if size > most_bytes:
        raise ValueError(f"{path} has {size} bytes, expected at most {most_bytes}: is it the right file?")
    return size


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def short(text: str, most: int = 300) -> str:
    """Text for a message: one line of at most `most` characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[:most]}..."


def one_line(error: BaseException) -> str:
    """An error's message in one line, or its type where it has none."""
    return short(str(error)) or type(error).__name__


def finite_number(text: str, where: str) -> float:
    """The number in a file's text. Raises ValueError, beginning with `where`, for anything else, also for what only
    Python accepts (1_000, digits of other scripts)."""
    try:
        number = float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        number = None
    if number is None:
        point = " with a decimal point" if "," in text else ""
        raise ValueError(f"{where}: got {short(text)!r}, expected a number{point}")
    if not math.isfinite(number):
        raise ValueError(f"{where}: got {text}, expected a finite number")
    return number


def toml_text(path: Path, what: str) -> str:
    """The text of a TOML file; raises FileNotFoundError, and ValueError for a file too large or not UTF-8."""
    checked_size(existing_file(path, f"{what} file", f"the TOML file of the {what}"), MOST_TOML)
    try:
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text ({error.reason}), expected TOML of the {what}") from None


def toml_tables(text: str, what: str) -> dict[str, Any]:
    """The tables of a TOML text; raises ValueError, beginning with `what`, for text too long or not TOML."""
    if len(text) > MOST_TOML:
        raise ValueError(f"{what}: the text has {len(text)} characters, expected at most {MOST_TOML}")
    if re.search(r"(\.[^.,\n]{1,80}){30}", text):  # of which tomllib takes time with a power of their number
        raise ValueError(f"{what}: a key is nested in 30 tables or more, expected a few")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"{what}: tables or lists are nested too deep, expected a few levels") from None
    except ValueError as error:
        raise ValueError(f"{what}: not valid TOML ({error})") from None
