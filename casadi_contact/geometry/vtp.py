"""Triangles of a VTK PolyData file (.vtp), of which OpenSim's geometry folders are made.

Read are the `Points` and `Polys` arrays in ASCII or inline base64 (plain or zlib); appended data is refused. Polygons
are cut into fans of triangles. Source: VTK file formats, XML formats.
"""

from __future__ import annotations

import base64
import binascii
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from casadi_contact.conventions import Array

_TYPES = {
    **{f"{sign}Int{bits}": f"{letter}{bits // 8}" for sign, letter in (("", "i"), ("U", "u")) for bits in (32, 64)},
    **{"Float32": "f4", "Float64": "f8", "Int8": "i1", "UInt8": "u1"},
}


def read_vtp(path: Path) -> tuple[Array, np.ndarray]:
    """Vertices (v, 3) and triangles (f, 3) of a .vtp file; raises ValueError for one that cannot be read."""
    try:
        root = ElementTree.parse(path).getroot()
        vertices, faces = [], []
        offset = 0
        for piece in root.iter("Piece"):
            points = _array(root, piece.find("Points/DataArray")).astype(float).reshape(-1, 3)
            polys = {a.get("Name"): _array(root, a) for a in piece.findall("Polys/DataArray")}
            faces.append(_fans(polys["connectivity"], polys["offsets"]) + offset)
            vertices.append(points)
            offset += len(points)
        return np.concatenate(vertices), np.concatenate(faces)
    except (ElementTree.ParseError, ValueError, KeyError, AttributeError, binascii.Error, zlib.error) as error:
        raise ValueError(
            f"mesh {path} cannot be read ({error}), expected a VTK PolyData file in ascii or inline base64"
        ) from None


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
    data, at, out = base64.b64decode(text[4 * -(-size // 3) :]), 0, []
    for length in sizes:
        out.append(zlib.decompress(data[at : at + int(length)]))
        at += int(length)
    return b"".join(out)


def _decode_start(text: str, size: int) -> bytes:
    return base64.b64decode(text[: 4 * -(-size // 3)])[:size]


def _fans(connectivity: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Polygon (a, b, c, d, ...) as triangles (a, b, c), (a, c, d), ..."""
    starts = np.concatenate([[0], offsets[:-1]]).astype(np.int64)
    corners = offsets.astype(np.int64) - starts
    faces = [
        np.stack([connectivity[starts[big]], connectivity[starts[big] + k], connectivity[starts[big] + k + 1]], axis=1)
        for k in range(1, int(corners.max(initial=2)) - 1)
        for big in [corners > k + 1]
    ]
    return np.concatenate(faces).astype(np.int64) if faces else np.zeros((0, 3), dtype=np.int64)
