"""Checks of a scene's values. Errors say the key, what was got and what was expected."""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

LONGEST_NAME = 64
MOST_ELEMENTS = 2**20  # of one patch: a grid of 1024×1024, five times what converges
_LARGEST_NUMBER = 1e15  # mm, N, MPa, ...: far beyond any joint, and exact as a float
_LONGEST_TEXT = 4096
_DEEPEST = 6  # tables within tables


def fail(key: str, got: object, expected: str) -> ValueError:
    """The error of a bad value: key, got, expected, on one short line."""
    try:
        text = repr(got)
    except ValueError:  # Python prints no integer of more than 4300 digits
        text = "a number of thousands of digits"
    return ValueError(f"scene: {key} = {text if len(text) <= 200 else f'{text[:200]}...'}, expected {expected}")


def number(key: str, value: object, *, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number with low < value < high."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _LARGEST_NUMBER:
        raise fail(key, value, f"a finite number below {_LARGEST_NUMBER:g}")
    if not low < value < high:
        within = f"between {low:g} and {high:g}" if math.isfinite(high) else f"above {low:g}"
        raise fail(key, value, f"a number {within}")
    return float(value)


def numbers(key: str, value: object, count: int | None, unit: str, **bounds: float) -> list[float]:
    """A list of so many numbers (None: any) in a unit, each as `number`."""
    if not isinstance(value, list | tuple) or count not in (None, len(value)):
        raise fail(key, value, f"a list of {'' if count is None else f'{count} '}numbers [{unit}]")
    return [number(key, each, **bounds) for each in value]


def grid_size(key: str, value: object) -> tuple[int, int]:
    """Elements per patch (along x, along z), at most MOST_ELEMENTS in all."""
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2
        or not all(isinstance(n, int | np.integer) and not isinstance(n, bool) and n > 0 for n in value)
    ):
        raise fail(key, value, "two positive whole numbers of elements, for example [80, 40]")
    if int(value[0]) * int(value[1]) > MOST_ELEMENTS:
        raise fail(key, value, f"at most {MOST_ELEMENTS} elements in all, for example [320, 160]")
    return int(value[0]), int(value[1])


def identifier(key: str, value: object, also: str = "") -> str:
    """A name that may become part of a file's key, a column or generated C: letters, digits, underscores and `also`."""
    pattern = f"[A-Za-z][A-Za-z0-9_{re.escape(also)}]*"
    if not isinstance(value, str) or len(value) > LONGEST_NAME or not re.fullmatch(pattern, value):
        raise fail(key, value, f"a letter, then letters, digits, {' '.join(['_', *also])}, {LONGEST_NAME} at most")
    return value


def scene_name(value: object) -> str:
    """A scene's name, which files and folders are called after: an `identifier` that may hold '-' and '.' too."""
    return identifier("name", value, "-.")


def distinct_names(key: str, value: object) -> tuple[str, ...]:
    """Names that differ, at least one."""
    if not isinstance(value, list | tuple) or not value or not all(isinstance(v, str) for v in value):
        raise fail(key, value, "a list of names")
    if len(set(value)) != len(value):
        raise fail(key, value, "names that differ")
    return tuple(value)


def table_of(
    key: str, value: object, known: tuple[str, ...], *, complete: bool, optional: tuple[str, ...] = ()
) -> dict[str, Any]:
    """A table all of whose keys are known or optional (and, if complete, all of the known keys)."""
    if not isinstance(value, Mapping):
        raise fail(key, value, f"a table with {', '.join(known)}")
    for name in value:
        if name not in (*known, *optional):
            raise ValueError(f"scene: unknown key {key}.{name}, expected one of {', '.join((*known, *optional))}")
    missing = [name for name in known if name not in value]
    if complete and missing:
        raise ValueError(f"scene: {key} lacks {', '.join(missing)}")
    return dict(value)


def plain_values(key: str, value: object, depth: int = 0) -> None:
    """Refuse what no scene holds at any depth: infinite or immense numbers, control characters, deep tables, dates."""
    if depth > _DEEPEST:
        raise ValueError(f"scene: {key} is nested {depth} deep, expected at most {_DEEPEST}")
    if isinstance(value, Mapping):
        for name, inner in value.items():
            plain_values(key, name, depth)
            plain_values(f"{key}.{name}" if key else name, inner, depth + 1)
    elif isinstance(value, list | tuple):
        for inner in value:
            plain_values(key, inner, depth + 1)
    elif isinstance(value, str):
        if len(value) > _LONGEST_TEXT or not value.isprintable():
            raise fail(key, value, f"printable text of at most {_LONGEST_TEXT} characters")
    elif isinstance(value, int | float):
        if not abs(value) < _LARGEST_NUMBER:
            raise fail(key, value, f"a finite number below {_LARGEST_NUMBER:g}")
    else:
        raise fail(key, value, "a number, text, true or false, a list or a table")
