"""The form of what a surrogate's file records about its training (the keys are told of in `info`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_LARGEST = 1e300  # JSON holds whole numbers that no float does
# Key: how many tables lie in each other ("test_errors": domain, load, kind of error), what lies in the innermost, and
# what it must hold.
_FORMS: dict[str, tuple[Any, ...]] = {
    "samples": (1, "a number"),
    "dropped": (1, "a number"),
    "pose_range": (1, "two numbers"),
    "load_range": (1, "two numbers"),
    "valid_share": (0, "a number"),
    "training_errors": (1, "a number"),
    "test_errors": (3, "a number", "rms", "max"),
    "test_samples": (1, "a number"),
    "coverage": (2, "a number"),
    "model_errors": (1, "a number"),
    "model_errors_against": (0, "text"),
    "stop_reasons": (1, "text"),
    "convergence": (2, "numbers", "gflop", "rms"),
}


def checked_record(record: object) -> dict[str, Any]:
    """The record; raises ValueError, naming the key, for one that no table can be made of."""
    if not isinstance(record, dict):
        raise ValueError("the record is no table of what trained the surrogate")
    for key, form in _FORMS.items():
        if key in record:
            _check(f"record.{key}", record[key], *form)
    return record


def _check(key: str, there: object, depth: int, leaf: str, *needed: str) -> None:
    if depth:
        if not isinstance(there, Mapping):
            raise ValueError(f"{key} is {type(there).__name__}, expected a table")
        if depth == 1 and not there.keys() >= set(needed):
            raise ValueError(f"{key} lacks {' or '.join(needed)}")
        for name, each in there.items():
            _check(f"{key}.{name}", each, depth - 1, leaf, *needed)
    elif not _is(there, leaf):
        raise ValueError(f"{key} is {type(there).__name__}, expected {leaf}")


def _is(there: object, leaf: str) -> bool:
    if leaf == "text":
        return isinstance(there, str)
    if leaf == "a number":
        return isinstance(there, int | float) and not isinstance(there, bool) and abs(there) < _LARGEST
    numbers = isinstance(there, list) and all(_is(each, "a number") for each in there)
    return numbers and (leaf == "numbers" or len(there) == 2)  # type: ignore[arg-type]
