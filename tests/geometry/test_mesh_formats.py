"""Mesh files are read as their formats define them; what is not whole or made to mislead is one line at once."""

import struct
import tracemalloc

import numpy as np
import pytest
import trimesh

from casadi_contact.geometry.mesh import load_mesh
from tests.support.mesh_files import (
    appended,
    base64_array,
    binary_stl,
    dos,
    obj_of_both_kinds,
    obj_of_polygons,
    off,
    ply,
    stl,
    vtk,
    vtp,
    written,
    zlib_array,
)
from tests.support.meshes import ball_mesh

BALL = ball_mesh(16.0, 4.0)
MOST_MEMORY = 64 << 20

FILES = {
    "both_kinds.obj": obj_of_both_kinds,
    "dos.obj": dos,
    "tabs.OBJ": lambda *ball: obj_of_polygons(*ball).replace(" ", "\t").replace("\nf", "\n  F"),
    "lower.stl": stl,
    "upper.STL": lambda *ball: stl(*ball).upper(),
    "named.stl": lambda *ball: stl(*ball, name="facet normal"),
    "binary.stl": binary_stl,
    "a_byte_more.stl": lambda *ball: binary_stl(*ball) + b"\n",
    "exported.ply": lambda *ball: trimesh.Trimesh(*ball, process=False).export(file_type="ply"),
    "ascii.ply": ply,
    "old_mac.ply": lambda *ball: ply(*ball).replace("\n", "\r"),
    "big_endian.ply": lambda *ball: ply(*ball, order=">"),
    "ascii.vtp": vtp,
    "base64.vtp": lambda *ball: vtp(*ball, base64_array),
    "zlib.vtp": lambda *ball: vtp(*ball, zlib_array),
    "appended.vtp": appended,
    "appended_raw.vtp": lambda *ball: appended(*ball, raw=True),
    "appended_plain.vtp": lambda *ball: appended(*ball, base64_array, raw=True),
    "colours.off": off,
    "exported.off": lambda *ball: trimesh.Trimesh(*ball, process=False).export(file_type="off"),
    "text.vtk": lambda *ball: vtk(*ball).replace(b"POINTS", b"FIELD FieldData 1\nTIME 1 1 double\n0\nPOINTS"),
    "binary.vtk": lambda *ball: vtk(*ball, binary=True),
    "text_5.vtk": lambda *ball: vtk(*ball, modern=True).replace(b"\n", b"\r\n"),
    "binary_5.vtk": lambda *ball: vtk(*ball, binary=True, modern=True),
}


@pytest.mark.parametrize("name", FILES)
def test_a_ball_is_the_same_in_every_format(name, tmp_path):
    mesh = load_mesh(written(tmp_path / name, FILES[name](*BALL)), "mm")
    assert (len(mesh.faces), mesh.dropped, len(mesh.boundary_edges)) == (len(BALL[1]), 0, 0)
    corners = BALL[0][BALL[1]]
    np.testing.assert_allclose(np.sort(mesh.corners_mm.sum(axis=1), 0), np.sort(corners.sum(axis=1), 0), atol=1e-4)


WRITERS = {
    "prism.vtp": vtp,
    "prism.vtk": vtk,
    "prism.off": off,
    "prism.obj": obj_of_polygons,
    "ascii.ply": ply,
    "binary.ply": lambda *prism: ply(*prism, order="<"),
}


@pytest.mark.parametrize(("name", "write"), WRITERS.items())
@pytest.mark.parametrize("first", [0, 2])
@pytest.mark.parametrize("tip", [60, 30])  # convex, and not
def test_polygons_become_triangles_of_the_same_area(name, write, first, tip, tmp_path):
    """A prism of two hexagons and their quadrilaterals."""
    hexagon, n = np.roll([(20, 0), (40, 0), (tip, 20), (40, 40), (20, 40), (0, 20)], first, axis=0), 6
    points = [(x, y, z) for z in (0, 30) for x, y in hexagon]
    polygons = [[*range(n)][::-1], [*range(n, 2 * n)], *([i, (i + 1) % n, (i + 1) % n + n, i + n] for i in range(n))]
    mesh = load_mesh(written(tmp_path / name, write(points, polygons)), "mm")
    around = np.linalg.norm(np.roll(hexagon, 1, axis=0) - hexagon, axis=1).sum()
    assert mesh.areas_mm2.sum() == pytest.approx(2 * (1200.0 + 20.0 * (tip - 40.0)) + 30.0 * around)


PLAIN = vtp([[0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, 0]], [[0, 1, 2], [3, 2, 1]])
OBJ = "v 0 0 0\nv 10 0 0\nv 0 10 0\nf {}\nv 0 0 10\n"
CORNERS = [(0, 0), (60, 0), (60, 40), (40, 40), (40, 20), (20, 20), (20, 40), (0, 40)]
FOLDED = obj_of_polygons([(*corner, 0) for corner in CORNERS], [range(8)])
ENTITIES = '<!DOCTYPE x [<!ENTITY a "1"><!ENTITY b "' + "&a;" * 9 + '">]><VTKFile'
HOSTILE = {
    "an index of a missing vertex.vtp": (PLAIN.replace("3 2 1<", "3 2 9<"), "vertex 9"),
    "offsets beyond the indices.vtp": (PLAIN.replace("3 6<", "3 600000000<"), "offsets"),
    "no offsets.vtp": (PLAIN.replace("offsets", "ends"), "offsets"),
    "points not in threes.vtp": (PLAIN.replace("0.0 0.0 0.0 10", "0.0 0.0 10"), "cannot be read"),
    "entities.vtp": (PLAIN.replace("<VTKFile", ENTITIES), "document type"),
    "deep nesting.vtp": ("<a>" * 200_000, "cannot be read"),
    "a vertex before the first.obj": (OBJ.format("-1 -2 -4"), "vertex -4 after 3"),
    "a vertex after the last.obj": (OBJ.format("1 2 9"), "vertex 8 of"),
    "a face of two.obj": (OBJ.format("1 2"), "2 corners"),
    "a folded polygon.obj": (FOLDED, "convex"),
    "an immense index.obj": (OBJ.format(f"1 2 {'9' * 30}"), "cannot be read"),
    "four billion triangles.stl": (bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(100), "cannot be read|empty"),
    "a damaged triangle.ply": (ply(*BALL).replace("\n3 ", "\n", 1), "cannot be read"),
    "a triangle too many.ply": (ply(*BALL) + "3 0 1 2\n", "follow"),
    "strips.ply": (ply(*BALL).replace("element face", "element tristrips"), "tristrips"),
    "a count too low.stl": (binary_stl(*BALL) + bytes(50), "whole"),
    "an end missing.stl": (stl(*BALL) + stl(*BALL)[:-9], "whole"),
    "a vertex too few.off": (off(*BALL).replace("0.5\n", "\n0.5\n", 1), "lines follow"),
    "cut.vtk": (vtk(*BALL, binary=True)[:4000], "cannot be read"),
    "cut text.vtk": (vtk(*BALL)[:-2000], "expected"),
    "a grid.vtk": (b"# vtk\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n", "POLYDATA"),
    "tetrahedra.vtk": (vtk(*BALL, modern=True).replace(b" 7\n", b" 10\n"), "kind 10"),
}


def refused(path, message):
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=message) as error:
            load_mesh(path, "mm")
        assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    finally:
        tracemalloc.stop()
    assert "\n" not in str(error.value)
    assert str(path.name) in str(error.value)


@pytest.mark.parametrize("name", HOSTILE)
def test_a_file_made_to_mislead_is_one_line_and_takes_no_memory(name, tmp_path):
    content, message = HOSTILE[name]
    refused(written(tmp_path / name, content), message)


def test_a_vtp_bomb_is_refused_without_being_unpacked(tmp_path):
    refused(written(tmp_path / "bomb.vtp", vtp(np.zeros((1 << 21, 3)), [[0, 1, 2]], zlib_array)), "unpacks")


def test_a_mesh_file_beyond_the_stated_size_and_other_files_are_refused(tmp_path):
    path = tmp_path / "huge.stl"
    with path.open("wb") as file:
        file.truncate((512 << 20) + 1)  # takes no room on the disc
    refused(path, "expected at most 536870912")
    refused(tmp_path / "part.step", "step")
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load_mesh(tmp_path / "none.stl", "mm")
