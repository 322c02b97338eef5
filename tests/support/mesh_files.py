"""Vertices and triangles as the text or bytes of mesh files."""

import base64
import re
import struct
import zlib

import numpy as np


def v(point):
    return "v {:.9f} {:.9f} {:.9f}\n".format(*point)


def obj_of_both_kinds(vertices, faces):
    """Vertices come in two lots; faces are broken over two lines and mix both ways of naming a vertex."""
    half = len(vertices) // 2
    first = (faces < half).all(axis=1)
    lots = ["".join(v(p) for p in lot) for lot in (vertices[:half], vertices[half:])]
    lots[0] += "".join(f"f {a - half} {b + 1} \\\n{c - half}\n" for a, b, c in faces[first])
    lots[1] += "".join(f"\tf {a + 1}/7/7 {b - len(vertices)}/-1/7 {c + 1}/7/7\n" for a, b, c in faces[~first])
    return "# f -1 -2 -3\n".join(lots)


def dos(vertices, faces):
    return obj_of_both_kinds(vertices, faces).replace("\n", "\r\n")


def stl(vertices, faces, name="part"):
    corner = "      vertex {:.9e} {:.9e} {:.9e}\n"
    facet = "  facet normal 0 0 0\n    outer loop\n{}    endloop\n  endfacet\n"
    facets = (facet.format("".join(corner.format(*point) for point in vertices[face])) for face in faces)
    return f"solid {name}\n{''.join(facets)}endsolid\n"


def binary_stl(vertices, faces):
    """With the words of the other kind in its header."""
    facets = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    facets["corners"] = vertices[faces]
    head = b"solid Exported by a FacetModeller, facet normal".ljust(80) + len(faces).to_bytes(4, "little")
    return head + facets.tobytes()


def ascii_array(values):
    return "ascii", " ".join(repr(value.item()) for value in values)


def base64_array(values):
    return "binary", base64.b64encode(np.uint32(values.nbytes).tobytes() + values.tobytes()).decode()


def zlib_array(values):
    packed = zlib.compress(values.tobytes())
    header = np.array([1, values.nbytes, values.nbytes, len(packed)], dtype="<u4").tobytes()
    return "binary", (base64.b64encode(header) + base64.b64encode(packed)).decode()


def vtp(points, polygons, encode=ascii_array):
    """Points (n, 3) and lists of their numbers."""
    numbers = np.array([k for polygon in polygons for k in polygon], dtype="<i8")
    ends = np.cumsum([len(polygon) for polygon in polygons], dtype="<i8")
    arrays = []
    for name, values in (("points", np.asarray(points, "<f8").ravel()), ("connectivity", numbers), ("offsets", ends)):
        kind, (form, text) = {"f": "Float64", "i": "Int64"}[values.dtype.kind], encode(values)
        arrays.append(f'<DataArray type="{kind}" Name="{name}" format="{form}">{text}</DataArray>')
    compressor = ' compressor="vtkZLibDataCompressor"' if encode is zlib_array else ""
    return (
        f'<VTKFile type="PolyData" byte_order="LittleEndian" header_type="UInt32"{compressor}><PolyData><Piece>'
        f"<Points>{arrays[0]}</Points><Polys>{arrays[1]}{arrays[2]}</Polys></Piece></PolyData></VTKFile>"
    )


def appended(points, polygons, encode=zlib_array, raw=False):
    """The arrays of a VTP file behind its text."""
    text, data = vtp(points, polygons, encode), b""
    for array in re.findall(r'format="binary">([^<]*)', text):
        text = text.replace(f'format="binary">{array}<', f'format="appended" offset="{len(data)}"><')
        size = 4 * -(-16 // 3) if encode is zlib_array else 0
        data += base64.b64decode(array[:size]) + base64.b64decode(array[size:]) if raw else array.encode()
    kind = b"raw" if raw else b"base64"
    tail = b'<AppendedData encoding="' + kind + b'">_' + data + b"</AppendedData></VTKFile>"
    return text.removesuffix("</VTKFile>").encode() + tail


def obj_of_polygons(points, polygons):
    return "".join(map(v, points)) + "".join(f"f {' '.join(str(k + 1) for k in polygon)}\n" for polygon in polygons)


def ply(points, polygons, order=""):
    """ASCII, or binary in the byte order < or >."""
    form = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        f"ply\nformat {form} 1.0\ncomment TextureFile a.png\nelement vertex {len(points)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(polygons)}\n"
        "property list uchar int vertex_index\nproperty uchar red\nend_header\n"
    )
    if not order:
        rows = ["{:.9f} {:.9f} {:.9f}\n".format(*point) for point in points]
        return head + "".join(rows + [f"{len(each)} {' '.join(map(str, each))} 7\n" for each in polygons])
    faces = [struct.pack(f"{order}B{len(each)}iB", len(each), *each, 7) for each in polygons]
    return head.encode() + np.asarray(points, order + "f4").tobytes() + b"".join(faces)


def off(points, polygons):
    rows = [f"{each[0]} {each[1]} {each[2]} 255 0 0\n" for each in np.asarray(points, dtype=float).tolist()]
    rows += [f"{len(each)}  {' '.join(map(str, each))} 0.5\n" for each in polygons]
    return f"COFF  # colours\n\n{len(points)} {len(polygons)} 0\n{''.join(rows)}"


def vtk(points, polygons, binary=False, modern=False):
    """Legacy VTK: sizes and corners of POLYGONS, or CELLS by offsets and connectivity (since version 5.1)."""

    def array(values, kind):
        return np.asarray(values, f">{kind}").tobytes() if binary else " ".join(map(str, values)).encode()

    flat, count = [k for each in polygons for k in each], len(polygons)
    sizes = [len(each) for each in polygons]
    head = (
        f"# vtk DataFile Version {5.1 if modern else 3.0}\nball\n{'BINARY' if binary else 'ASCII'}\nDATASET POLYDATA\n"
    )
    parts = [f"{head}POINTS {len(points)} double\n", array(np.asarray(points, dtype=float).ravel().tolist(), "f8")]
    if modern:
        cells = f"CELLS {count + 1} {len(flat)}\nOFFSETS vtktypeint64\n"
        parts += [f"\nMETADATA\nINFORMATION 0\n\n{cells}", array([0, *np.cumsum(sizes).tolist()], "i8")]
        parts += ["\nCONNECTIVITY vtktypeint64\n", array(flat, "i8")]
        parts += [f"\nCELL_TYPES {count}\n", array([7] * count, "i4")]
    else:
        packed = [k for each in polygons for k in (len(each), *each)]
        parts += [f"\nPOLYGONS {count} {len(packed)}\n", array(packed, "i4")]
    parts.append(f"\nPOINT_DATA {len(points)}\n")
    return b"".join(part.encode() if isinstance(part, str) else part for part in parts)


def written(path, content):
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path
