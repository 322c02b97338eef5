"""Tables of numbers in C."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.transcription.kernel.source import c_text


def table(name: str, numbers: np.ndarray) -> str:
    """Numbers as a C array of their own shape: of int or double."""
    kind = "int" if numbers.dtype.kind == "i" else "double"
    sizes = "".join(f"[{size}]" for size in numbers.shape)
    return f"static const {kind} {name}{sizes} = {_braces(numbers)};"


def _braces(table: np.ndarray) -> str:
    if table.ndim > 1:
        return "{" + ",\n  ".join(map(_braces, table)) + "}"
    return "{" + ", ".join("NAN" if value != value else repr(value) for value in table.tolist()) + "}"


def roots_source(first_parts: Sequence[int], count: int) -> str:
    """C function patch_roots, and the table first_part of the `count` root loads that a kernel gives."""
    return f"{table('first_part', np.array([*first_parts, count]))}\n" + c_text("roots.h")
