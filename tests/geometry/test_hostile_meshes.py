"""Mesh files made to mislead: one line at once, no memory beyond the file's worth, no other file read."""

import base64
import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from casadi_contact.geometry import mesh_formats
from casadi_contact.geometry.mesh import load_mesh

pytest.importorskip("trimesh", reason="reading STL, OBJ and PLY needs casadi_contact[mesh]")

POINTS = "0 0 0 10 0 0 0 10 0 10 10 0"
MOST_MEMORY = 64 << 20


def vtp_text(connectivity="0 1 2 3 2 1", offsets="3 6", *, head="", points=POINTS, polys=""):
    array = '<DataArray type="{}" Name="{}" NumberOfComponents="3" format="ascii">{}</DataArray>'
    polys = polys or array.format("Int32", "connectivity", connectivity) + array.format("Int32", "offsets", offsets)
    points = array.format("Float32", "Points", points)
    return (
        f'<?xml version="1.0"?>{head}<VTKFile type="PolyData"><PolyData><Piece><Points>{points}</Points>'
        f"<Polys>{polys}</Polys></Piece></PolyData></VTKFile>"
    )


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


ENTITIES = '<!DOCTYPE x [<!ENTITY a "1"><!ENTITY b "' + "&a;" * 9 + '">]>'
VTPS = {
    "an index of a missing vertex": (vtp_text("0 1 2 3 2 9"), "vertex 9"),
    "a negative index": (vtp_text("0 1 2 3 2 -1"), "vertex"),
    "offsets beyond the indices": (vtp_text(offsets="3 600000000"), "offsets"),
    "falling offsets": (vtp_text(offsets="6 3"), "offsets"),
    "no offsets": (vtp_text(polys="<DataArray type='Int32' Name='connectivity' format='ascii'/>"), "offsets"),
    "points that are not in threes": (vtp_text(points="0 0 0 1"), "cannot be read"),
    "entities": (vtp_text(head=ENTITIES), "document type"),
    "no piece": ("<VTKFile/>", "cannot be read"),
    "deep nesting": ("<a>" * 200_000, "cannot be read"),
}


@pytest.mark.parametrize("what", VTPS)
def test_a_vtp_file_with(what, tmp_path):
    path = tmp_path / "mesh.vtp"
    path.write_text(VTPS[what][0])
    refused(path, VTPS[what][1])


def test_polygons_are_cut_into_fans(tmp_path):
    path = tmp_path / "mesh.vtp"
    path.write_text(vtp_text("0 1 3 2 0 1 2", "4 7"))
    np.testing.assert_array_equal(mesh_formats.read_vtp(path)[1], [[0, 1, 3], [0, 3, 2], [0, 1, 2]])


def test_a_vtp_bomb_is_refused_without_being_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_formats, "MOST_UNPACKED", 1 << 20)
    packed = zlib.compress(bytes(1 << 26))
    header = struct.pack("<4I", 1, 1 << 26, 0, len(packed))
    text = base64.b64encode(header).decode() + base64.b64encode(packed).decode()
    path = tmp_path / "bomb.vtp"
    path.write_text(
        '<VTKFile type="PolyData" compressor="vtkZLibDataCompressor"><PolyData><Piece><Points><DataArray '
        f'type="Float32" format="binary">{text}</DataArray></Points></Piece></PolyData></VTKFile>'
    )
    refused(path, "unpacks")


def test_an_stl_file_that_claims_four_billion_triangles(tmp_path):
    path = tmp_path / "big.stl"
    path.write_bytes(bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(100))
    refused(path, "cannot be read|empty")


def test_an_obj_file_reads_no_other_file(tmp_path, monkeypatch):
    (tmp_path / "secret.mtl").write_text("newmtl m\nmap_Kd picture.png\n")
    path = tmp_path / "mesh.obj"
    path.write_text("mtllib secret.mtl\nusemtl m\nv 0 0 0\nv 10 0 0\nv 0 10 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    opened = []
    audit = [True]

    def watch(event, arguments):
        if audit and event == "open":
            opened.append(str(arguments[0]))

    import sys

    sys.addaudithook(watch)
    assert len(load_mesh(path, "mm").faces) == 1
    audit.clear()
    assert [name for name in opened if name.endswith((".mtl", ".png"))] == []


def test_a_mesh_file_beyond_the_stated_size(tmp_path):
    path = tmp_path / "huge.stl"
    with path.open("wb") as file:
        file.truncate((512 << 20) + 1)  # takes no room on the disc
    refused(path, "expected at most 536870912")
