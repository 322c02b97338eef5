"""Arrays in one compressed text: ``live/web/assets.js`` reads it."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from typing import Any

import numpy as np

_KINDS = {"f4": np.float32, "f8": np.float64, "u4": np.uint32, "u1": np.uint8}
_ALIGNED = 8


def packed(arrays: Mapping[str, np.ndarray]) -> tuple[list[dict[str, Any]], str]:
    """An index of name, kind, offset and count of each array, and base64 of their bytes, compressed; always the same
    for the same arrays. Raises KeyError for a type that the page has none for."""
    kinds = {np.dtype(kind): name for name, kind in _KINDS.items()}
    index, data = [], b""
    for name, array in arrays.items():
        data += bytes(-len(data) % _ALIGNED)
        index.append({"name": name, "kind": kinds[array.dtype], "offset": len(data), "count": array.size})
        data += array.tobytes()
    return index, base64.b64encode(gzip.compress(data, compresslevel=9, mtime=0)).decode("ascii")
