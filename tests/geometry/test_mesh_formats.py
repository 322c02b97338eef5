"""Files of triangles are read as their formats define them, and what is not whole is refused."""

import numpy as np
import pytest

from casadi_contact.geometry.mesh import load_mesh
from tests.support.meshes import ball_mesh

BALL = ball_mesh(16.0, 4.0)


def v(point):
    return "v {:.9f} {:.9f} {:.9f}\n".format(*point)


def whole_ball(path):
    mesh = load_mesh(path, "mm")
    assert (len(mesh.faces), mesh.dropped, len(mesh.boundary_edges)) == (len(BALL[1]), 0, 0)
    corners = BALL[0][BALL[1]]
    np.testing.assert_allclose(np.sort(mesh.corners_mm.sum(axis=1), 0), np.sort(corners.sum(axis=1), 0), atol=1e-4)
    return mesh


def obj_each_with_its_own(vertices, faces):
    """As streaming exporters write it: three vertices and their triangle, again and again."""
    return "".join("".join(v(p) for p in vertices[face]) + "vn 0 1 0\nf -3//-1 -2//-1 -1//-1\n" for face in faces)


def obj_vertices_first(vertices, faces):
    return "".join(v(p) for p in vertices) + "".join("f {} {} {}\n".format(*f) for f in faces - len(vertices))


def obj_of_both_kinds(vertices, faces):
    """Vertices come in two lots; faces are broken over two lines and mix both ways of naming a vertex."""
    half = len(vertices) // 2
    first = (faces < half).all(axis=1)
    lots = ["".join(v(p) for p in lot) for lot in (vertices[:half], vertices[half:])]
    lots[0] += "".join(f"f {a - half} {b + 1} \\\n{c - half}\n" for a, b, c in faces[first])
    lots[1] += "".join(f"\tf {a + 1}/7/7 {b - len(vertices)}/-1/7 {c + 1}/7/7\n" for a, b, c in faces[~first])
    return "# f -1 -2 -3\n".join(lots)


@pytest.mark.parametrize("write", [obj_each_with_its_own, obj_vertices_first, obj_of_both_kinds])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_obj_indices_below_zero_count_back_from_the_triangle(tmp_path, write, newline):
    (tmp_path / "ball.obj").write_bytes(write(*BALL).replace("\n", newline).encode())
    whole_ball(tmp_path / "ball.obj")


@pytest.mark.parametrize(("face", "said"), [("-1 -2 -4", "vertex -4 after 3"), ("1 0 2", "vertex 0 after 3")])
def test_obj_indices_of_no_vertex_are_refused(tmp_path, face, said):
    (tmp_path / "t.obj").write_text(f"v 0 0 0\nv 10 0 0\nv 0 10 0\nf {face}\nv 0 0 10\n")
    with pytest.raises(ValueError, match=rf"t\.obj cannot be read \(a triangle names {said} vertices\)"):
        load_mesh(tmp_path / "t.obj", "mm")


def ply(vertices, faces):
    kinds = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat ascii 1.0\ncomment made by hand\nelement vertex {len(vertices)}\n{kinds}"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    points = "".join("{:.9f} {:.9f} {:.9f}\n".format(*p) for p in vertices)
    return head + points + "".join("3 {} {} {}\n".format(*f) for f in faces)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_an_ascii_ply_file_is_whole_or_refused_wherever_it_ends(tmp_path, newline):
    text = ply(*BALL).replace("\n", newline)
    path = tmp_path / "ball.ply"
    for whole in (text, text.rstrip(), text + newline):
        path.write_bytes(whole.encode())
        whole_ball(path)
    lines = text.splitlines(keepends=True)
    count, head = len(BALL[1]), len(lines) - len(BALL[1])
    for end, said in (
        ("".join(lines[: head + 5]), f"ends after 5 of the {count} face lines"),
        ("".join(lines[: head - 4]), f"ends after {len(BALL[0]) - 4} of the {len(BALL[0])} vertex lines"),
        ("".join(lines[:head]), f"ends after 0 of the {count} face lines"),
        (text.rstrip().rpartition(" ")[0], "ends in a face with 2 of 3 corners"),
    ):
        path.write_bytes(end.encode())
        with pytest.raises(ValueError, match=rf"ball\.ply cannot be read \(it {said}"):
            load_mesh(path, "mm")


def stl(vertices, faces):
    corner = "      vertex {:.9e} {:.9e} {:.9e}\n"
    facet = "  facet normal 0 0 0\n    outer loop\n{}    endloop\n  endfacet\n"
    facets = (facet.format("".join(corner.format(*point) for point in vertices[face])) for face in faces)
    return f"solid part\n{''.join(facets)}endsolid\n"


@pytest.mark.parametrize("change", [str.lower, str.upper, str.title])
def test_ascii_stl_is_read_in_any_case(tmp_path, change):
    path = tmp_path / "ball.stl"
    path.write_text(stl(*BALL))
    plain = whole_ball(path)
    path.write_text(change(stl(*BALL)))
    np.testing.assert_array_equal(whole_ball(path).corners_mm, plain.corners_mm)


def vtp_piece(vertices, **cells):
    """A piece of these vertices; cells: lists of vertices for Polys and Strips."""
    array = '<DataArray type="{}" Name="{}" format="ascii">{}</DataArray>'
    counts = "".join(f' NumberOf{kind}="{len(each)}"' for kind, each in {"Points": vertices, **cells}.items())
    points = array.format("Float64", "points", " ".join(map(str, np.ravel(vertices).tolist())))
    arrays = ""
    for kind, lists in cells.items():
        connectivity = " ".join(str(vertex) for each in lists for vertex in each)
        offsets = " ".join(map(str, np.cumsum([len(each) for each in lists], dtype=int).tolist()))
        both = array.format("Int32", "connectivity", connectivity) + array.format("Int32", "offsets", offsets)
        arrays += f"<{kind}>{both}</{kind}>"
    return f"<Piece{counts}><Points>{points}</Points>{arrays}</Piece>"


def written_vtp(path, *pieces):
    path.write_text(f'<VTKFile type="PolyData"><PolyData>{"".join(pieces)}</PolyData></VTKFile>')
    return path


ANGLE = 2.0 * np.pi * np.arange(12) / 12
DRUM = np.concatenate([np.stack([10.0 * np.cos(ANGLE), 10.0 * np.sin(ANGLE), 0.0 * ANGLE + z], axis=1) for z in (0, 8)])
LOW, HIGH = np.arange(12), 12 + np.arange(12)
ENDS = [HIGH, LOW[::-1]]
WALL_STRIP = [vertex for k in range(13) for vertex in (HIGH[k % 12], LOW[k % 12])]
ENDS_TO_AND_FRO = [HIGH[[0, 1, 11, 2, 10, 3, 9, 4, 8, 5, 7, 6]], LOW[[0, 11, 1, 10, 2, 9, 3, 8, 4, 7, 5, 6]]]


@pytest.mark.parametrize(
    "pieces",
    [
        [vtp_piece(DRUM, Polys=ENDS, Strips=[WALL_STRIP])],
        [vtp_piece(DRUM, Polys=[], Strips=[*ENDS_TO_AND_FRO, WALL_STRIP])],
        [vtp_piece(DRUM, Strips=[*ENDS_TO_AND_FRO, WALL_STRIP])],
        [vtp_piece(DRUM, Polys=ENDS), vtp_piece(DRUM, Strips=[WALL_STRIP])],
        [vtp_piece(DRUM, Polys=ENDS, Strips=[WALL_STRIP[:8], WALL_STRIP[6:]])],
    ],
)
def test_vtp_strips_are_triangles_whose_outside_is_out(tmp_path, pieces):
    mesh = load_mesh(written_vtp(tmp_path / "drum.vtp", *pieces), "mm")
    assert (len(mesh.faces), len(mesh.boundary_edges)) == (44, 0)
    normals = mesh.corners_mm.mean(axis=1) - [0.0, 0.0, 4.0]
    assert (np.einsum("nk,nk->n", mesh.normals, normals) > 3.9).all()  # the ends lie 4 mm, the wall 9.7 mm from there


EMPTY = [
    vtp_piece([], Polys=[]),
    vtp_piece([], Polys=[], Strips=[]),
    "<Piece NumberOfPoints='0'><Points/><Polys/></Piece>",
    vtp_piece([], Polys=[]).replace('NumberOfPoints="0"', ""),
]


@pytest.mark.parametrize("empty", EMPTY)
def test_vtp_pieces_without_points_add_nothing(tmp_path, empty):
    ball = vtp_piece(BALL[0], Polys=BALL[1].tolist(), Strips=[])
    for pieces in ((ball, empty), (empty, ball)):
        whole_ball(written_vtp(tmp_path / "ball.vtp", *pieces))
    with pytest.raises(ValueError, match=r"empty\.vtp .*(is empty|has no Piece with points)"):
        load_mesh(written_vtp(tmp_path / "empty.vtp", empty), "mm")


def test_binary_ply_of_triangles_and_quadrilaterals_is_refused_with_the_cure(tmp_path):
    corners, faces = np.eye(4, 3, dtype="<f4"), [[0, 1, 2, 3], [2, 1, 0]]
    head = f"format binary_little_endian 1.0\nelement vertex {len(corners)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = b"".join(bytes([len(face)]) + np.array(face, "<i4").tobytes() for face in faces)
    (path := tmp_path / "mixed.ply").write_bytes(b"ply\n" + head.encode() + corners.tobytes() + body)
    with pytest.raises(ValueError, match="expected a whole PLY file, of faces with equally many corners if it is"):
        load_mesh(path, "mm")


@pytest.mark.parametrize(("kind", "lost"), [("Points", -1), ("Polys", 1), ("Strips", 1)])
def test_a_vtp_file_with_other_counts_than_it_claims_is_refused(tmp_path, kind, lost):
    found = {"Points": len(DRUM), "Polys": len(ENDS), "Strips": 1}[kind]
    whole = vtp_piece(DRUM, Polys=ENDS, Strips=[WALL_STRIP])
    damaged = whole.replace(f'NumberOf{kind}="{found}"', f'NumberOf{kind}="{found + lost}"')
    path = written_vtp(tmp_path / "drum.vtp", damaged)
    with pytest.raises(ValueError, match=f"it claims {found + lost} {kind.lower()} and has {found}"):
        load_mesh(path, "mm")


def stl_solid(name, corners):
    facets = ("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n".format("".join(map(vertex, c))) for c in corners)
    return f"solid {name}\n{''.join(facets)}endsolid {name}\n"


def vertex(point):
    return "vertex {:.6f} {:.6f} {:.6f}\n".format(*point)


def test_an_stl_file_of_several_solids_is_read_whole_or_refused(tmp_path):
    """A solid that is cut short would be left out."""
    corners, path = BALL[0][BALL[1]], tmp_path / "ball.stl"
    half = len(corners) // 2
    text = stl_solid("a", corners[:half]) + stl_solid("b", corners[half:])
    path.write_text(text)
    whole_ball(path)
    path.write_text(text[: int(0.8 * len(text))])
    with pytest.raises(ValueError, match="expected a whole STL file"):
        load_mesh(path, "mm")


def test_a_binary_stl_file_may_have_any_words_in_its_header(tmp_path):
    corners = BALL[0][BALL[1]].astype("<f4")
    facets = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    facets["corners"] = corners
    head = b"solid Exported by a FacetModeller, facet normal".ljust(80) + len(corners).to_bytes(4, "little")
    (tmp_path / "ball.stl").write_bytes(head + facets.tobytes())
    whole_ball(tmp_path / "ball.stl")
    (tmp_path / "named.stl").write_text(stl_solid("facet normal", BALL[0][BALL[1]]))
    whole_ball(tmp_path / "named.stl")


def test_obj_comments_and_line_ends_are_read_and_a_face_of_two_corners_is_refused(tmp_path):
    vertices, faces = BALL
    text = "".join(v(p) for p in vertices) + "".join("f {} {} {} # tri -1\n".format(*f) for f in faces + 1)
    path = tmp_path / "ball.obj"
    for end in ("\n", "\r\n", "\r"):
        path.write_bytes(text.replace("\n", end).encode())
        whole_ball(path)
    lines = text.splitlines()
    lines[len(vertices) + 4] = "f 1 2"
    path.write_text("\n".join(lines))
    with pytest.raises(ValueError, match=rf"line {len(vertices) + 5} is a face of 2 corners"):
        load_mesh(path, "mm")


def prism_vtp(outline):
    """A closed prism of polygons: its two ends, and a quadrilateral for each edge of the outline (n, 2)."""
    n = len(outline)
    points = [(x, y, z) for z in (0, 30) for x, y in outline]
    polygons = [[*range(n)][::-1], [*range(n, 2 * n)], *([i, (i + 1) % n, (i + 1) % n + n, i + n] for i in range(n))]
    joined, ends = [k for polygon in polygons for k in polygon], np.cumsum([len(polygon) for polygon in polygons])
    arrays = (("connectivity", joined), ("offsets", ends))
    cells = "".join(
        f'<DataArray type="Int64" Name="{name}" format="ascii">{" ".join(map(str, numbers))}</DataArray>'
        for name, numbers in arrays
    )
    coordinates = " ".join(str(c) for point in points for c in point)
    return (
        f'<VTKFile type="PolyData" byte_order="LittleEndian"><PolyData><Piece NumberOfPoints="{len(points)}" '
        f'NumberOfPolys="{len(polygons)}"><Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">'
        f"{coordinates}</DataArray></Points><Polys>{cells}</Polys></Piece></PolyData></VTKFile>"
    )


@pytest.mark.parametrize("first", range(6))
def test_polygons_become_triangles_of_the_same_area(first, tmp_path):
    hexagon = [(20, 0), (40, 0), (60, 20), (40, 40), (20, 40), (0, 20)]
    path = tmp_path / "prism.vtp"
    path.write_text(prism_vtp(np.roll(hexagon, first, axis=0).tolist()))
    a, b, c = np.moveaxis(load_mesh(path, "mm").corners_mm, 1, 0)
    sides = 30.0 * np.linalg.norm(np.diff([*hexagon, hexagon[0]], axis=0), axis=1).sum()
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert area == pytest.approx(2 * 1600.0 + sides)


def test_a_polygon_whose_fan_would_fold_back_is_refused(tmp_path):
    (tmp_path / "l.vtp").write_text(prism_vtp([(60, 0), (60, 10), (10, 10), (10, 60), (0, 60), (0, 0)]))
    with pytest.raises(ValueError, match="is not convex: save the mesh as triangles"):
        load_mesh(tmp_path / "l.vtp", "mm")
