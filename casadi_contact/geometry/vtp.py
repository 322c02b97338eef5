"""Triangles of a VTK PolyData file (.vtp), of which OpenSim's geometry folders are made.

Read are the `Points`, `Polys` and `Strips` arrays in ASCII or inline base64 (plain or zlib); appended data is refused.
Polygons are cut into fans of triangles, strips into theirs. Source: VTK file formats, XML formats.
"""

from __future__ import annotations

import base64
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import MOST_MESH, MOST_UNPACKED, checked_size, one_line

_TYPES = {
    **{f"{sign}Int{bits}": f"{letter}{bits // 8}" for sign, letter in (("", "i"), ("U", "u")) for bits in (32, 64)},
    **{"Float32": "f4", "Float64": "f8", "Int8": "i1", "UInt8": "u1"},
}


def read_vtp(path: Path) -> tuple[Array, np.ndarray]:
    """Vertices (v, 3) and triangles (f, 3) of a .vtp file; raises ValueError for one that cannot be read."""
    checked_size(path, MOST_MESH)
    try:
        root = ElementTree.fromstring(_without_entities(path.read_bytes()))
        vertices, faces = [], []
        offset = 0
        for piece in root.iter("Piece"):
            if piece.get("NumberOfPoints") == "0":
                continue  # its arrays may be left out
            points = _array(root, piece.find("Points/DataArray")).astype(float).reshape(-1, 3)
            _check_count(piece, "Points", len(points))
            strips = piece.find("Strips/DataArray") is not None and piece.get("NumberOfStrips") != "0"
            if not strips or piece.find("Polys/DataArray") is not None:
                faces.append(_fans(points, *_cells(root, piece, "Polys")) + offset)
            if strips:
                faces.append(_strips(*_cells(root, piece, "Strips")) + offset)
            vertices.append(points)
            offset += len(points)
        if not vertices:
            raise ValueError("it has no Piece with points")
        return np.concatenate(vertices), np.concatenate(faces)
    except Exception as error:  # damaged bytes lead to errors of many kinds in expat, base64, zlib and NumPy
        raise ValueError(
            f"mesh {path} cannot be read ({one_line(error)}), expected a VTK PolyData file in ascii or inline base64"
        ) from None


def _cells(root: ElementTree.Element, piece: ElementTree.Element, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Connectivity and offsets of a piece's Polys or Strips."""
    arrays = {a.get("Name"): _array(root, a) for a in piece.findall(f"{kind}/DataArray")}
    missing = [name for name in ("connectivity", "offsets") if name not in arrays]
    if missing:
        raise ValueError(f"its {kind} lack {' and '.join(missing)}")
    _check_count(piece, kind, len(arrays["offsets"]))
    return arrays["connectivity"], arrays["offsets"]


def _check_count(piece: ElementTree.Element, kind: str, found: int) -> None:
    """Raise ValueError for a piece that claims another number of points, polygons or strips than it has."""
    claimed = piece.get(f"NumberOf{kind}")
    if claimed is not None and int(claimed) != found:
        raise ValueError(f"it claims {claimed} {kind.lower()} and has {found}")


def _without_entities(content: bytes) -> bytes:
    """The same; ValueError for a document type: its entities can grow without end or name other files."""
    if b"<!DOCTYPE" in content or b"\0" in content:  # UTF-16, in which a document type has other bytes, holds zeros
        raise ValueError("it has a document type or is not UTF-8")
    return content


def _array(root: ElementTree.Element, array: ElementTree.Element | None) -> np.ndarray:
    if array is None:
        raise ValueError("it has no points")
    order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
    dtype = np.dtype(order + _TYPES[array.get("type", "")])
    text = array.text or ""
    if array.get("format") == "ascii":
        return np.array(text.split(), dtype=dtype.newbyteorder("="))
    if array.get("format") != "binary":
        raise ValueError(f"its data is {array.get('format')!r}")
    header = np.dtype(order + _TYPES[root.get("header_type", "UInt32")])
    return np.frombuffer(_decode("".join(text.split()), header, "compressor" in root.attrib), dtype=dtype)


def _decode(text: str, header: np.dtype, compressed: bool) -> bytes:
    """Bytes of an inline array: (size, data), or zlib blocks behind a header of its own base64."""
    if not compressed:
        return base64.b64decode(text)[header.itemsize :]
    blocks = int(np.frombuffer(_decode_start(text, header.itemsize), dtype=header)[0])
    size = (3 + blocks) * header.itemsize
    sizes = np.frombuffer(_decode_start(text, size), dtype=header)[3:]
    if blocks < 0 or len(sizes) != blocks:
        raise ValueError(f"it claims {blocks} compressed blocks and has {len(sizes)}")
    data, at, left, out = base64.b64decode(text[4 * -(-size // 3) :]), 0, MOST_UNPACKED, []
    for length in sizes:
        unpacker = zlib.decompressobj()
        out.append(unpacker.decompress(data[at : at + int(length)], left))
        left -= len(out[-1])
        if left <= 0 or not unpacker.eof:
            raise ValueError(f"a compressed block is cut, or all unpack to more than {MOST_UNPACKED} bytes")
        at += int(length)
    return b"".join(out)


def _decode_start(text: str, size: int) -> bytes:
    return base64.b64decode(text[: 4 * -(-size // 3)])[:size]


def _fans(points: Array, connectivity: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Polygon (a, b, c, d, ...) as triangles (a, b, c), (a, c, d), ...; ValueError where one folds back: the polygon is
    not convex."""
    first, k = _triangles(connectivity, offsets)
    triangles = connectivity[np.stack([first, first + k + 1, first + k + 2], axis=1)].astype(np.int64)
    if len(triangles) and triangles.min() >= 0 and triangles.max() < len(points):  # else it is refused for that
        a, b, c = points[triangles.T]
        areas = np.cross(b - a, c - a)
        starts = np.flatnonzero(k == 0)
        wholes = np.repeat(np.add.reduceat(areas, starts), np.diff([*starts, len(k)]), axis=0)
        if (folded := (areas * wholes).sum(axis=1) < -1e-6 * (wholes**2).sum(axis=1)).any():
            at = triangles[folded.argmax(), 0]
            raise ValueError(f"a polygon at vertex {at} is not convex: save the mesh as triangles")
    return triangles


def _strips(connectivity: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Strip (a, b, c, d, e, ...) as triangles (a, b, c), (c, b, d), (c, d, e), ...: every other one is turned."""
    first, k = _triangles(connectivity, offsets)
    odd = k % 2
    return connectivity[np.stack([first + k + odd, first + k + 1 - odd, first + k + 2], axis=1)].astype(np.int64)


def _triangles(connectivity: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each triangle (t,) of all cells: where its cell starts, and which of the cell's triangles it is."""
    ends = offsets.astype(np.int64)
    starts = np.concatenate([[0], ends])[:-1].astype(np.int64)
    if np.any(ends < starts) or ends[-1:].sum() != len(connectivity):
        raise ValueError(f"its polygons end at {ends[-1:]}, expected rising offsets up to {len(connectivity)}")
    count = np.maximum(ends - starts - 2, 0)  # triangles of each cell
    first = np.repeat(starts, count)
    return first, np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
