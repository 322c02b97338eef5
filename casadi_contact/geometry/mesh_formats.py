"""Vertices and triangles of mesh files: STL and PLY by trimesh, OBJ and VTK PolyData (.vtp) here."""

from __future__ import annotations

import base64
import io
import re
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import MOST_MESH, MOST_UNPACKED, checked_size, one_line

_VTK_TYPES = {
    **{f"{sign}Int{bits}": f"{letter}{bits // 8}" for sign, letter in (("", "i"), ("U", "u")) for bits in (32, 64)},
    **{"Float32": "f4", "Float64": "f8", "Int8": "i1", "UInt8": "u1"},
}


def read_triangles(path: Path) -> tuple[Array, np.ndarray]:
    """Vertices (v, 3) and triangles (f, 3) of a mesh file; ValueError for one that cannot be read."""
    checked_size(path, MOST_MESH)
    kind = path.suffix.lower()
    try:
        return READERS[kind](path.read_bytes())
    except Exception as error:  # damaged bytes lead to many kinds of errors in trimesh, expat, base64, zlib and NumPy
        if isinstance(error, ImportError) and error.name == "trimesh":  # it may itself miss one for damaged bytes
            raise ImportError(f"reading {path.name} needs trimesh: pip install casadi_contact[mesh]") from None
        inside = ", in ascii or inline base64" if kind == ".vtp" else ""
        raise ValueError(
            f"mesh {path} cannot be read ({one_line(error)}), expected a whole {kind[1:].upper()} file{inside}"
        ) from None


def _by_trimesh(content: bytes, kind: str) -> tuple[Array, np.ndarray]:
    import trimesh

    # Not by its path: trimesh would read files that the mesh names.
    mesh: Any = trimesh.load(io.BytesIO(content), file_type=kind, force="mesh", process=False)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _of_obj(content: bytes) -> tuple[Array, np.ndarray]:
    """Indices begin at 1; those below 0 count back from the face, so that -1 is the last vertex before it, and not the
    file's last as trimesh has it (Wavefront OBJ)."""
    vertices: list[list[float]] = []
    corners: list[int] = []
    ends = []
    content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    for line in re.sub(rb"#[^\n]*", b"", content).replace(b"\\\n", b"").split(b"\n"):
        kind, *words = line.split() or [b""]
        if kind == b"v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == b"f":
            indices = [int(word.split(b"/")[0]) for word in words]
            if wrong := [k for k in indices if k == 0 or k < -len(vertices)]:
                raise ValueError(f"a triangle names vertex {wrong[0]} after {len(vertices)} vertices")
            corners += [k - 1 if k > 0 else len(vertices) + k for k in indices]
            ends.append(len(corners))
    return np.array(vertices, dtype=float), _fans(np.array(corners, dtype=np.int64), np.array(ends, dtype=np.int64))


def _of_vtp(content: bytes) -> tuple[Array, np.ndarray]:
    """As in OpenSim's geometry folders: `Points`, `Polys` in ASCII or inline base64 (plain or zlib). Source: VTK file
    formats, XML formats."""
    if b"<!DOCTYPE" in content or b"\0" in content:  # entities can expand without end; UTF-16 would hide them
        raise ValueError("it has a document type or is not UTF-8")
    root = ElementTree.fromstring(content)
    vertices, faces, offset = [], [], 0
    for piece in root.iter("Piece"):
        if piece.get("NumberOfPoints") == "0":
            continue  # its arrays may be left out
        if piece.get("NumberOfStrips", "0") != "0":
            raise ValueError("it has triangle strips, expected polygons")
        points = _vtk_array(root, piece.find("Points/DataArray")).astype(float).reshape(-1, 3)
        cells = {array.get("Name"): array for array in piece.findall("Polys/DataArray")}
        connectivity, ends = (_vtk_array(root, cells.get(name)) for name in ("connectivity", "offsets"))
        faces.append(_fans(connectivity.astype(np.int64), ends.astype(np.int64)) + offset)
        vertices.append(points)
        offset += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def _vtk_array(root: ElementTree.Element, array: ElementTree.Element | None) -> np.ndarray:
    if array is None:
        raise ValueError("it lacks points, connectivity or offsets")
    order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
    dtype = np.dtype(order + _VTK_TYPES[array.get("type", "")])
    text = array.text or ""
    if array.get("format") == "ascii":
        return np.array(text.split(), dtype=dtype.newbyteorder("="))
    if array.get("format") != "binary":
        raise ValueError(f"its data is {array.get('format')!r}")
    header = np.dtype(order + _VTK_TYPES[root.get("header_type", "UInt32")])
    return np.frombuffer(_decode("".join(text.split()), header, "compressor" in root.attrib), dtype=dtype)


def _decode(text: str, header: np.dtype, compressed: bool) -> bytes:
    """Bytes of an inline array: (size, data); or zlib blocks behind (count, size, last size, compressed sizes ...),
    a header with base64 of its own."""
    if not compressed:
        return base64.b64decode(text)[header.itemsize :]

    def numbers(count: int) -> np.ndarray:
        size = count * header.itemsize
        return np.frombuffer(base64.b64decode(text[: 4 * -(-size // 3)])[:size], dtype=header)

    blocks = int(numbers(1)[0])
    data, out = base64.b64decode(text[4 * -(-(3 + blocks) * header.itemsize // 3) :]), b""
    for length in map(int, numbers(3 + blocks)[3:]):
        out += zlib.decompressobj().decompress(data[:length], MOST_UNPACKED)
        data = data[length:]
        if len(out) >= MOST_UNPACKED:
            raise ValueError(f"it unpacks to more than {MOST_UNPACKED} bytes")
    return out


def _fans(connectivity: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Polygons (a, b, c, d, ...) as triangles (a, b, c), (a, c, d), ... (t, 3); ends: where each polygon ends."""
    starts = np.concatenate([[0], ends])[:-1].astype(np.int64)
    if np.any(ends < starts) or ends[-1:].sum() != len(connectivity):
        raise ValueError(f"its polygons end at {ends[-1:]}, expected rising offsets up to {len(connectivity)}")
    count = np.maximum(ends - starts - 2, 0)  # triangles of each polygon
    first = np.repeat(starts, count)
    k = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
    return connectivity[np.stack([first, first + k + 1, first + k + 2], axis=1)]


READERS: dict[str, Callable[[bytes], tuple[Array, np.ndarray]]] = {
    ".stl": partial(_by_trimesh, kind="stl"),
    ".obj": _of_obj,
    ".ply": partial(_by_trimesh, kind="ply"),
    ".vtp": _of_vtp,
}
FORMATS = tuple(READERS)
