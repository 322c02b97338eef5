"""Triangles of STL, OBJ and PLY files: read by trimesh, which takes some damaged files for whole ones."""

from __future__ import annotations

import io
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import MOST_MESH, checked_size, one_line

_RELATIVE = re.compile(rb"^[ \t]*f[ \t](?:[^\n]*[ \t])?(?:-|0+(?:[/\s]|$))", re.MULTILINE)  # or 0


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
        elif kind == "obj":
            whole = re.sub(rb"#[^\r\n]*", b"", whole).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
            _check_corners(whole)
            whole = _with_absolute_indices(whole)
        else:
            _check_ply_lines(whole)
        # Not by its path: trimesh would read files that the mesh names.
        content: Any = trimesh.load(io.BytesIO(whole), file_type=kind, force="mesh", process=False)
        if kind == "stl" and _is_ascii_stl(whole):
            _check_facets(whole, len(content.faces))
        return np.asarray(content.vertices), np.asarray(content.faces)
    except Exception as error:  # trimesh's readers raise whatever the damage led to
        equal = ", of faces with equally many corners if it is binary" if kind == "ply" else ""  # trimesh asks for it
        raise ValueError(
            f"mesh {path} cannot be read ({one_line(error)}), expected a whole {kind.upper()} file{equal}"
        ) from None


def _check_stl_size(content: bytes) -> None:
    """Raise ValueError for binary STL of another size than its triangles need (STL: 84 bytes, 50 a triangle)."""
    claimed = _claimed(content)
    if not _is_ascii_stl(content) and len(content) != _size_of(claimed):
        raise ValueError(f"it claims {claimed} triangles in {len(content)} bytes, expected {_size_of(claimed)}")


def _claimed(content: bytes) -> int:
    return int.from_bytes(content[80:84], "little")


def _size_of(triangles: int) -> int:
    return 84 + 50 * triangles


def _is_ascii_stl(content: bytes) -> bool:
    """By its words, which the header of a binary file may hold as well."""
    return b"facet" in content[:1000].lower() and len(content) != _size_of(_claimed(content))


def _check_facets(content: bytes, read: int) -> None:
    """Raise ValueError for ASCII STL of which facets were not read: those of a solid that is cut short."""
    begun = len(re.findall(rb"^\s*facet\s+normal\b", content, re.IGNORECASE | re.MULTILINE))
    if begun != read:
        raise ValueError(f"{begun} facets begin and {read} end in a whole solid")


def _check_ply_lines(content: bytes) -> None:
    """Raise ValueError for ASCII PLY that ends before the last element that its header counts, or within it."""
    head, _, body = content.partition(b"end_header")
    words = [line.split() for line in head.splitlines()]
    if [b"format", b"ascii"] not in (line[:2] for line in words):
        return  # of binary PLY trimesh knows the size
    rows = [line for line in body.splitlines()[1:] if line.strip()]
    for line, first_property in pairwise([each for each in words if each[:1] in ([b"element"], [b"property"])]):
        if line[0] != b"element":
            continue
        name, count = line[1].decode(), int(line[2])
        if len(rows) < count:
            raise ValueError(f"it ends after {len(rows)} of the {count} {name} lines that its header counts")
        if count and first_property[1] == b"list" and len(last := rows[count - 1].split()) <= int(last[0]):
            raise ValueError(f"it ends in a {name} with {len(last) - 1} of {int(last[0])} corners")
        rows = rows[count:]


def _check_corners(content: bytes) -> None:
    """Raise ValueError for a face of an OBJ file with fewer than three corners, which trimesh would leave out."""
    for number, line in enumerate(content.splitlines(), start=1):
        words = line.split()
        if words[:1] == [b"f"] and len(words) < 4 and not line.rstrip().endswith(b"\\"):
            raise ValueError(f"line {number} is a face of {len(words) - 1} corners, expected three or more")


def _with_absolute_indices(content: bytes) -> bytes:
    """An OBJ file whose triangles name vertices from the first on: -1 is the last vertex before the triangle.

    The same content where no vertex is named so; else texture and normals are left out. ValueError for a vertex that is
    not there, and for 0, which names none (Wavefront OBJ: indices begin with 1).
    """
    joined = content.replace(b"\\\r\n", b"").replace(b"\\\n", b"")
    if not _RELATIVE.search(joined):
        return content
    lines, vertices = [], 0
    for line in joined.splitlines():
        words = line.split()
        if words[:1] == [b"v"]:
            vertices += 1
            lines.append(line)
        elif words[:1] == [b"f"]:
            lines.append(b"f " + b" ".join(_absolute(word, vertices) for word in words[1:]))
    return b"\n".join(lines) + b"\n"


def _absolute(word: bytes, vertices: int) -> bytes:
    index = int(word.split(b"/")[0])
    if index == 0 or index < -vertices:
        raise ValueError(f"a triangle names vertex {index} after {vertices} vertices")
    return b"%d" % (index if index > 0 else vertices + index + 1)
