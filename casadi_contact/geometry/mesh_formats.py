"""Readers of STL, OBJ, PLY, OFF, VTP and VTK files. Unlike in trimesh, a file that is not whole is an error."""

import base64
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import MOST_MESH, MOST_UNPACKED, checked_size, one_line

_PLY = {"char": "int8", "uchar": "uint8", "int": "int32", "uint": "uint32", "float": "float32"}  # unlike NumPy's names
_VTK = {"float": "f4", "double": "f8", "int": "i4", "long": "i8", "vtktypeint32": "i4", "vtktypeint64": "i8"}
_FACET = b"facet normal outer loop vertex vertex vertex endloop endfacet".split()
MOST_RATIO = 200  # of unpacked to packed bytes: zeros have 1,000, a plate's grid of points 100
_BOM = b"\xef\xbb\xbf"


def read_triangles(path: Path) -> tuple[Array, np.ndarray]:
    """Vertices (v, 3) and triangles (f, 3) of a mesh file; ValueError for one that cannot be read."""
    checked_size(path, MOST_MESH)
    kind = path.suffix.lower()
    try:
        return READERS[kind](path.read_bytes())
    except Exception as error:  # damaged bytes lead to many kinds of errors in expat, base64, zlib and NumPy
        kind = kind[1:].upper()
        raise ValueError(f"mesh {path} cannot be read ({one_line(error)}), expected a whole {kind} file") from None


def _of_stl(content: bytes) -> tuple[Array, np.ndarray]:
    """Binary where the count of triangles fits the size, less than a triangle more; else text, 21 words a facet."""
    count = int.from_bytes(content[80:84], "little")
    if 0 < 50 * count <= len(content) - 84 < 50 * (count + 1):
        facets = np.frombuffer(content, [("corners", "<f4", 12), ("attribute", "<u2")], count, 84)
        corners = facets["corners"][:, 3:].astype(float)
    else:
        lines = content.removeprefix(_BOM).lower().replace(b"\r", b"\n")
        text, solids = re.subn(rb"(?m)^[ \t]*(end)?solid\b.*$", b"", lines)
        words = text.split()
        if not words or len(words) % 21 or solids % 2:
            raise ValueError(f"neither {count} binary triangles in {len(content)} bytes nor whole facets of text")
        table = np.array(words).reshape(-1, 21)
        if (wrong := (table[:, [0, 1, 5, 6, 7, 11, 15, 19, 20]] != _FACET).any(axis=1)).any():
            raise ValueError(f"facet {int(wrong.argmax()) + 1} is not whole")
        corners = table[:, [8, 9, 10, 12, 13, 14, 16, 17, 18]].astype(float)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _of_obj(content: bytes) -> tuple[Array, np.ndarray]:
    """Indices begin at 1; those below 0 count back from the face: -1 is the last vertex before it (Wavefront OBJ)."""
    vertices: list[list[float]] = []
    corners: list[int] = []
    ends = []
    content = content.removeprefix(_BOM).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    for line in re.sub(rb"#[^\n]*", b"", content).replace(b"\\\n", b" ").lower().split(b"\n"):
        kind, *words = line.split() or [b""]
        if kind == b"v":
            vertices.append([float(word) for word in words[:3]])
        elif kind in (b"f", b"fo"):
            indices = [int(word.split(b"/")[0]) for word in words]
            if wrong := [k for k in indices if k == 0 or k < -len(vertices)]:
                raise ValueError(f"a triangle names vertex {wrong[0]} after {len(vertices)} vertices")
            corners += [k - 1 if k > 0 else len(vertices) + k for k in indices]
            ends.append(len(corners))
    points = np.array(vertices, dtype=float)
    return points, _fans(points, corners, ends)


def _of_ply(content: bytes) -> tuple[Array, np.ndarray]:
    """Elements `vertex` and `face` (Stanford PLY); the numbers of a text become binary ones, to be read alike."""
    head, _, body = re.split(rb"[\r\n]end_header[ \t]*(\r\n|\r|\n)", content, maxsplit=1)
    lines = [line.split() for line in head.decode("latin1").splitlines() if line.strip()]
    form = next(words[1] for words in lines if words[0] == "format")
    if form == "ascii":
        body = np.array(body.split(), dtype="<f8").tobytes()
    elements: list[tuple[str, int, list[list[Any]]]] = []
    for kind, *words in lines:
        if kind == "element":
            elements.append((words[0], int(words[1]), []))
        elif kind == "property":  # type and name, or list, type of the length, type and name
            types = ["<f8" if form == "ascii" else _PLY.get(word, word) for word in words[:-1] if word != "list"]
            order: Literal["<", ">"] = ">" if form == "binary_big_endian" else "<"
            elements[-1][2].append([*(np.dtype(each).newbyteorder(order) for each in types), words[-1]])
    at, tables = 0, {}
    for element, count, properties in elements:
        if all(len(each) == 2 for each in properties):
            table: Any = np.frombuffer(body, [(name, kind) for kind, name in properties], count, at)
            at += table.nbytes
        else:
            table = {each[-1]: [] for each in properties}
            for _ in range(count):
                for *lengths, kind, name in properties:
                    size = 1
                    for each in lengths:
                        size = int(np.frombuffer(body, each, 1, at)[0])
                        at += each.itemsize
                    values = np.frombuffer(body[:0] if size < 0 else body, kind, size, at)
                    at += values.nbytes
                    table[name].append(values)
        tables[element] = table
    if len(body) - at >= 8:  # a number of a text, less than a triangle
        raise ValueError(f"{len(body) - at} bytes follow its elements")
    if "face" not in tables:
        raise ValueError(f"it holds {', '.join(tables)}, expected faces: save strips and points as triangles")
    points = np.column_stack([np.hstack(tables["vertex"][axis]) for axis in "xyz"]).astype(float)
    faces = tables["face"]["vertex_indices" if "vertex_indices" in tables["face"] else "vertex_index"]
    return points, _fans(points, np.concatenate(faces), np.cumsum([len(each) for each in faces]))


def _of_off(content: bytes) -> tuple[Array, np.ndarray]:
    """Counts of vertices, polygons and edges, then a line of each vertex and of each polygon, its number of corners
    first; normals or colours may follow (Geomview's object file format)."""
    lines = [words for line in content.removeprefix(_BOM).splitlines() if (words := line.split(b"#")[0].split())]
    if not re.fullmatch(rb"(ST)?C?N?OFF", lines[0].pop(0)) or b"BINARY" in lines[0]:
        raise ValueError("it does not begin with OFF and text")
    (count, polygons, *_), *rows = lines if lines[0] else lines[1:]
    if len(rows) != int(count) + int(polygons):
        raise ValueError(f"{len(rows)} lines follow its counts, expected {int(count)} + {int(polygons)}")
    points = np.array([row[:3] for row in rows[: int(count)]], dtype=float)
    sizes = [int(row[0]) for row in rows[int(count) :]]
    corners = [int(k) for size, row in zip(sizes, rows[int(count) :], strict=True) for k in row[1 : size + 1]]
    return points, _fans(points, corners, np.cumsum(sizes))


def _of_vtk(content: bytes) -> tuple[Array, np.ndarray]:
    """`POINTS`, and `POLYGONS` or `CELLS` that are polygons: size and corners of each, since version 5.1 offsets and
    corners; text, or numbers with the high byte first. Source: VTK file formats, legacy formats."""
    head, _, form, rest = content.removeprefix(_BOM).split(b"\n", 3)
    text, arrays = form.strip().upper() == b"ASCII", dict[str, np.ndarray]()
    rest = rest.replace(b"\r", b"") if text else rest
    cells, counts = "", list[str]()

    def take(name: str, kind: str, count: int) -> bytes:
        """The next numbers, and what follows them."""
        if text:
            words = rest.split(maxsplit=count)
            arrays[name] = np.array(words[:count], dtype=float)
            if len(words) < count:
                raise ValueError(f"{name} has {len(words)} numbers, expected {count}")
            return words[count] if len(words) > count else b""
        arrays[name] = np.frombuffer(rest, np.dtype(_VTK[kind]).newbyteorder(">"), count)
        return rest[arrays[name].nbytes :]

    while rest := rest.lstrip():
        line, _, rest = rest.partition(b"\n")
        key, *words = line.decode("latin1").split()
        if key == "POINTS":
            rest = take(key, words[1], 3 * int(words[0]))
        elif key in ("OFFSETS", "CONNECTIVITY"):
            rest = take(cells + key, words[0], int(counts[key == "CONNECTIVITY"]))
        elif key in ("POLYGONS", "CELLS", "TRIANGLE_STRIPS", "LINES", "VERTICES"):
            cells, counts = key, words
            rest = rest if b"Version 5" in head else take(key, "int", int(words[1]))
        elif key == "CELL_TYPES":
            rest = take(key, "int", int(words[0]))
        elif key == "METADATA":
            rest = rest.partition(b"\n\n")[2]
        elif key == "FIELD" and "POINTS" not in arrays:  # a time
            for _ in range(int(words[1])):
                line, _, rest = rest.lstrip().partition(b"\n")
                _, width, count, kind = line.decode("latin1").split()
                rest = take(key, kind, int(width) * int(count))
        elif key != "DATASET":
            break  # data of points and cells
    cells = "POLYGONS" if "CELL_TYPES" not in arrays else "CELLS"
    if not {"POINTS", cells, cells + "OFFSETS"} & {*arrays} > {"POINTS"}:
        raise ValueError("it has no points and polygons, expected POLYDATA or an UNSTRUCTURED_GRID")
    if wrong := {*arrays.get("CELL_TYPES", ())} - {5, 7, 9} or {*arrays} & {"TRIANGLE_STRIPS"}:
        raise ValueError(f"it has cells of the kind {min(wrong)}, expected polygons")
    points = arrays["POINTS"].astype(float).reshape(-1, 3)
    if cells + "OFFSETS" in arrays:
        return points, _fans(points, arrays[cells + "CONNECTIVITY"], arrays[cells + "OFFSETS"][1:])
    packed, heads = arrays[cells].astype(np.int64), [0]
    while heads[-1] < len(packed):
        heads.append(heads[-1] + 1 + max(int(packed[heads[-1]]), 0))
    return points, _fans(points, np.delete(packed, heads[:-1]), np.cumsum(packed[heads[:-1]]))


def _of_vtp(content: bytes) -> tuple[Array, np.ndarray]:
    """`Points`, `Polys` in ASCII, inline or appended (plain, zlib). Source: VTK file formats, XML formats."""
    content, mark, tail = content.partition(b"<AppendedData")
    kind, _, data = tail.partition(b"_")
    if b"<!DOCTYPE" in content or b"\0" in content:  # entities can expand without end; UTF-16 would hide them
        raise ValueError("it has a document type or is not UTF-8")
    root, appended = ElementTree.fromstring(content + b"</VTKFile>" * bool(mark)), (data, b"raw" in kind)
    vertices, faces, offset = [], [], 0
    for piece in root.iter("Piece"):
        if piece.get("NumberOfPoints") == "0":
            continue  # its arrays may be left out
        if piece.get("NumberOfStrips", "0") != "0":
            raise ValueError("it has triangle strips, expected polygons")
        points = _vtk_array(root, piece.find("Points/DataArray"), *appended).astype(float).reshape(-1, 3)
        cells = {array.get("Name"): array for array in piece.findall("Polys/DataArray")}
        connectivity, ends = (_vtk_array(root, cells.get(name), *appended) for name in ("connectivity", "offsets"))
        faces.append(_fans(points, connectivity, ends) + offset)
        vertices.append(points)
        offset += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def _vtk_array(root: ElementTree.Element, array: ElementTree.Element | None, appended: bytes, raw: bool) -> np.ndarray:
    if array is None:
        raise ValueError("it lacks points, connectivity or offsets")
    order: Literal["<", ">"] = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
    dtype, form = np.dtype(array.get("type", "").lower()).newbyteorder(order), array.get("format")
    inline = (array.text or "").split()
    if form == "ascii":
        return np.array(inline, dtype=dtype.newbyteorder("="))
    text, raw = (
        (appended[int(array.get("offset", "")) :], raw) if form == "appended" else ("".join(inline).encode(), False)
    )
    header = np.dtype(root.get("header_type", "UInt32").lower()).newbyteorder(order)
    return np.frombuffer(_decode(text, raw, header, "compressor" in root.attrib), dtype=dtype)


def _decode(text: bytes, raw: bool, header: np.dtype, compressed: bool) -> bytes:
    """Bytes of an array: (size, data), or zlib blocks behind (count, size, last size, sizes ...), perhaps padded."""

    def part(at: int, size: int) -> bytes:
        return text[at : at + size] if raw else base64.b64decode(text[at : at + 4 * -(-size // 3)])[:size]

    count = header.itemsize
    first = int(np.frombuffer(part(0, count), header)[0])
    if not compressed:
        start = 4 * -(-count // 3)
        padded = not raw and b"=" in text[:start]
        return part(start, first) if padded else part(0, count + first)[count:]
    count *= 3 + first
    sizes = np.frombuffer(part(0, count), header)[3:].tolist()
    data, out = part(count if raw else 4 * -(-count // 3), sum(sizes)), b""
    most = min(MOST_UNPACKED, MOST_RATIO * len(data))
    for length in sizes:
        out += zlib.decompressobj().decompress(data[:length], most + 1)
        data = data[length:]
        if len(out) > most:
            raise ValueError(f"it unpacks to more than {most} bytes: save it without compression")
    return out


def _fans(points: Array, corners: ArrayLike, ends: ArrayLike) -> np.ndarray:
    """Polygons (a, b, c, d, ...) as triangles (a, b, c), (a, c, d), ... (t, 3); ends: where each polygon ends. One that
    is not convex begins at the first corner whose triangles all face its way."""
    corners, ends = np.array(corners, dtype=np.int64), np.asarray(ends, dtype=np.int64)
    starts = np.concatenate([[0], ends])[:-1].astype(np.int64)
    if np.any(ends < starts) or ends[-1:].sum() != len(corners):
        raise ValueError(f"its polygons end at {ends[-1:]}, expected rising offsets up to {len(corners)}")
    count = ends - starts - 2  # triangles of each polygon
    if (count < 1).any():
        raise ValueError(f"polygon {int((count < 1).argmax()) + 1} has {int(count.min()) + 2} corners, expected 3")
    polygon = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(polygon)) - np.repeat(np.cumsum(count) - count, count)
    for _ in range(int(count.max(initial=0)) + 2):
        triangles = corners[starts[polygon][:, None] + np.stack([0 * k, k + 1, k + 2], axis=1)]
        a, b, c = np.moveaxis(points[np.clip(triangles, 0, len(points) - 1)], 1, 0)
        areas = np.cross(b - a, c - a)
        whole = np.stack([np.bincount(polygon, areas[:, axis], len(count)) for axis in range(3)], axis=1)
        along = (areas * whole[polygon]).sum(axis=1)
        folded = np.unique(polygon[along < -1e-9 * (whole**2).sum(axis=1)[polygon]])
        if not len(folded):
            return triangles
        for each in folded:
            corners[starts[each] : ends[each]] = np.roll(corners[starts[each] : ends[each]], -1)
    raise ValueError(f"polygon {folded[0] + 1} is not convex: save the mesh as triangles")


READERS: dict[str, Callable[[bytes], tuple[Array, np.ndarray]]] = {
    ".stl": _of_stl,
    ".obj": _of_obj,
    ".ply": _of_ply,
    ".vtp": _of_vtp,
    ".vtk": _of_vtk,
    ".off": _of_off,
}
FORMATS = tuple(READERS)
