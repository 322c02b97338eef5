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
    with pytest.raises(ValueError, match=said):
        load_mesh(tmp_path / "t.obj", "mm")


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


def stl_solid(name, corners):
    facets = ("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n".format("".join(map(vertex, c))) for c in corners)
    return f"solid {name}\n{''.join(facets)}endsolid {name}\n"


def vertex(point):
    return "vertex {:.6f} {:.6f} {:.6f}\n".format(*point)


def test_a_binary_stl_file_may_have_any_words_in_its_header(tmp_path):
    corners = BALL[0][BALL[1]].astype("<f4")
    facets = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    facets["corners"] = corners
    head = b"solid Exported by a FacetModeller, facet normal".ljust(80) + len(corners).to_bytes(4, "little")
    (tmp_path / "ball.stl").write_bytes(head + facets.tobytes())
    whole_ball(tmp_path / "ball.stl")
    (tmp_path / "named.stl").write_text(stl_solid("facet normal", BALL[0][BALL[1]]))
    whole_ball(tmp_path / "named.stl")


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
