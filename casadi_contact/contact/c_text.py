"""Numbers as C text."""

from __future__ import annotations

from collections.abc import Iterable


def braces(values: Iterable[float]) -> str:
    """Numbers as a C initialiser."""
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"
