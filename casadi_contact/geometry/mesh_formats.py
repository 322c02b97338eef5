"""Triangles of STL, OBJ and PLY files: read by trimesh, which takes some damaged files for whole ones."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.files import MOST_MESH, checked_size, one_line


def read_by_trimesh(path: Path) -> tuple[Array, np.ndarray]:
    """Vertices (v, 3) and triangles (f, 3) of an STL, OBJ or PLY file; ValueError for one that cannot be read."""
    try:
        import trimesh
    except ImportError:
        raise ImportError(f"reading {path.name} needs trimesh: pip install casadi_contact[mesh]") from None
    checked_size(path, MOST_MESH)
    kind = path.suffix[1:].lower()
    try:
        whole = path.read_bytes()
        if kind == "stl":
            _check_stl_size(whole)
        # Not by its path: trimesh would read files that the mesh names.
        content: Any = trimesh.load(io.BytesIO(whole), file_type=kind, force="mesh", process=False)
        return np.asarray(content.vertices), np.asarray(content.faces)
    except Exception as error:  # trimesh's readers raise whatever the damage led to
        raise ValueError(
            f"mesh {path} cannot be read ({one_line(error)}), expected a whole {kind.upper()} file"
        ) from None


def _check_stl_size(content: bytes) -> None:
    """Raise ValueError for binary STL of another size than its triangles need (STL: 84 bytes, 50 a triangle)."""
    claimed = int.from_bytes(content[80:84], "little")
    if b"facet" not in content[:1000] and len(content) != 84 + 50 * claimed:
        raise ValueError(f"it claims {claimed} triangles in {len(content)} bytes, expected {84 + 50 * claimed}")
