"""Checks of a scene's values: each refuses a bad one with its key, what was got and what was expected."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def fail(key: str, got: object, expected: str) -> ValueError:
    return ValueError(f"scene: {key} = {got!r}, expected {expected}")


def number(key: str, value: object, *, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number with low < value < high."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise fail(key, value, "a finite number")
    if not low < value < high:
        raise fail(key, value, f"a number between {low:g} and {high:g}")
    return float(value)


def grid_size(key: str, value: object) -> tuple[int, int]:
    """Elements per side (along x, along z)."""
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2
        or not all(isinstance(n, int | np.integer) and not isinstance(n, bool) and 0 < n <= 4096 for n in value)
    ):
        raise fail(key, value, "two whole numbers of elements from 1 to 4096, for example [80, 40]")
    return int(value[0]), int(value[1])


def distinct_names(key: str, value: object) -> tuple[str, ...]:
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
