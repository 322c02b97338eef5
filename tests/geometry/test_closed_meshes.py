"""A mesh is closed, and its outside out, by what its triangles enclose: slivers in it change nothing."""

import numpy as np
import pytest
import trimesh

from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.geometry.smooth_surface import SmoothSurface
from casadi_contact.scenes.shapes.mesh_bodies import shell_thickness
from tests.support.meshes import ball_mesh, cap_mesh, sheet_mesh, shell_mesh, wheel_mesh, with_slid_vertex


def with_sliver(vertices, faces, face=0):
    """One triangle halved at the middle of its first edge, the gap to its neighbour filled by a triangle of no area."""
    a, b, c = faces[face]
    middle = len(vertices)
    halves = [[a, middle, c], [middle, b, c], [a, b, middle]]
    return np.vstack([vertices, 0.5 * (vertices[a] + vertices[b])]), np.vstack([np.delete(faces, face, axis=0), halves])


def test_a_closed_mesh_with_a_sliver_is_closed():
    mesh = checked_mesh("ball", *with_sliver(*ball_mesh(16.0, 2.5)))
    assert mesh.dropped == 1
    assert len(mesh.boundary_edges) == 0
    points = np.random.default_rng(0).normal(size=(300, 3)) * 9.0
    exact = np.linalg.norm(points, axis=1) - 16.0
    near = np.abs(exact) < 4.0
    assert near.sum() > 50
    assert np.abs(SmoothSurface(mesh).distance(points) - exact)[near].max() < 0.01


def test_a_vertex_that_slid_over_its_neighbours_leaves_the_outside_outside():
    """Pseudonormals of the triangles that it turns over tell points the wrong side, at any distance."""
    mesh = checked_mesh("ball", *with_slid_vertex(*ball_mesh(16.0, 2.5), 5.0))
    assert ((mesh.normals * mesh.corners_mm.mean(axis=1)).sum(axis=1) < 0.0).any()
    points = np.random.default_rng(0).normal(size=(20_000, 3)) * 9.0
    exact = np.linalg.norm(points, axis=1) - 16.0
    near = np.abs(exact) < 8.0
    assert np.abs(SmoothSurface(mesh).distance(points[near]) - exact[near]).max() < 1.0


def test_slivers_at_an_open_edge_leave_it_open():
    vertices, faces = cap_mesh(20.0, 2.0, 0.6)
    plain = checked_mesh("cap", vertices, faces)
    rim = plain.boundary_edges[0]
    middle = plain.vertices_mm[rim].mean(axis=0)
    beside = np.vstack([plain.faces, [*rim, len(plain.vertices_mm)]])
    mesh = checked_mesh("cap", np.vstack([plain.vertices_mm, middle]), beside)
    assert (mesh.dropped, len(mesh.boundary_edges)) == (1, len(plain.boundary_edges))
    inner = np.flatnonzero((plain.vertices_mm[plain.faces][..., 1] < -19.0).all(axis=1))[0]
    filled = checked_mesh("cap", *with_sliver(plain.vertices_mm, plain.faces, inner))
    assert (filled.dropped, len(filled.boundary_edges)) == (1, len(plain.boundary_edges))


def test_a_shell_with_a_hole_and_two_unjoined_sheets_are_as_thin_as_a_closed_shell():
    """However far from the file's origin they lie."""
    vertices, faces = shell_mesh(14.5, 16.0, 1.5, 1.0, [0.0, 1.0, 0.0])
    holed = checked_mesh("shell", vertices + np.array([1e7, -8e6, 1.2e7]), np.delete(faces, 400, axis=0))
    assert len(holed.boundary_edges) == 3
    assert shell_thickness(holed) == pytest.approx(1.5, abs=0.05)
    sheet, front = sheet_mesh(14.0, 2.0)
    sheets = together((sheet, front), (sheet - [0.0, 0.5, 0.0], front[:, ::-1]))
    assert shell_thickness(checked_mesh("sheets", *sheets)) == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize("angle", [0.6, 1.9])
def test_nothing_is_thin_about_a_single_open_surface(angle):
    """A cap's back is open; of a femur's profile some rays come out at its other end, most do not."""
    assert shell_thickness(checked_mesh("cap", *cap_mesh(20.0, 2.0, angle))) == np.inf


def together(*meshes):
    vertices, faces = zip(*meshes, strict=True)
    return trimesh.util.append_faces(vertices, faces)


def ball(radius, centre, *, inside_out=False):
    vertices, faces = ball_mesh(radius, radius / 5.0)
    return vertices + centre, faces[:, ::-1] if inside_out else faces


MIDDLE, ASIDE = [0.0, 0.0, 0.0], [50.0, 0.0, 0.0]
BIG = ball(20.0, MIDDLE)
CUP = shell_mesh(10.0, 20.0, 2.0, 1.2, [0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("meshes", "where"),
    [
        ([BIG, ball(8.0, ASIDE, inside_out=True)], r"1 of its 2 pieces, first about \((50|49\.9)"),
        ([BIG, ball(8.0, ASIDE), ball(4.0, ASIDE), ball(0.5, [0.0, 25.0, 0.0], inside_out=True)], "1 of its 4 pieces"),
        ([CUP, ball(5.0, MIDDLE, inside_out=True)], "1 of its 2 pieces"),  # in its hollow, not in its solid
        ([sheet_mesh(40.0, 2.0), ball(5.0, [0.0, 20.0, 0.0], inside_out=True)], "1 of its 2 pieces"),
    ],
)
def test_a_closed_piece_that_is_inside_out_and_no_cavity_is_refused(meshes, where):
    with pytest.raises(ValueError, match=where):
        checked_mesh("bodies", *together(*meshes))


OPEN_BONE = (lambda vertices, faces: (vertices, faces[(vertices[faces][..., 0] < 16.0).all(axis=1)]))(*BIG)


@pytest.mark.parametrize(
    "meshes",
    [
        [BIG, ball(8.0, ASIDE)],
        [BIG, ball(12.0, [3.0, 0.0, 0.0], inside_out=True), ball(5.0, [3.0, 0.0, 0.0])],
        [CUP, ball(3.0, [0.0, 15.0, 0.0], inside_out=True)],
        [OPEN_BONE, ball(3.0, MIDDLE, inside_out=True)],
    ],
)
def test_bodies_side_by_side_and_cavities_in_solid_have_the_sign_of_what_they_are_in(meshes):
    mesh = checked_mesh("bodies", *together(*meshes))
    assert mesh.pieces.max() + 1 == len(meshes)
    centres = mesh.corners_mm.mean(axis=1)[::7]
    normals = mesh.normals[::7]
    surface = SmoothSurface(mesh)
    assert (surface.distance(centres + 0.5 * normals) > 0.0).all()
    assert (surface.distance(centres - 0.5 * normals) < 0.0).all()


PEG = wheel_mesh(4.0, 5.0, 1.0)  # along z


@pytest.mark.parametrize(
    "meshes",
    [
        [BIG, ball(15.0, MIDDLE)],  # bone under cartilage
        [BIG, (PEG[0] + [0.0, 0.0, 19.0], PEG[1])],  # through the surface
        [sheet_mesh(40.0, 2.0), (sheet_mesh(40.0, 2.0)[0] - [0.0, 0.3, 0.0], sheet_mesh(40.0, 2.0)[1])],
    ],
)
def test_a_piece_in_the_solid_of_another_is_refused(meshes):
    """All face outwards. Loads would be off several times: the sign of the distance turns between the surfaces."""
    with pytest.raises(ValueError, match="inside another"):
        checked_mesh("bodies", *together(*meshes))


def test_pieces_in_each_other_far_from_contact_change_nothing_there():
    stem = [BIG, (PEG[0] + [0.0, 0.0, 19.0], PEG[1])]
    near, far = (((-30.0, -30.0, low), (30.0, 30.0, low + 20.0)) for low in (0.0, -30.0))
    with pytest.raises(ValueError, match="inside another"):
        checked_mesh("bodies", *together(*stem), contact=[near])
    mesh = checked_mesh("bodies", *together(*stem), contact=[far])
    points = np.array([[0.0, 0.0, -19.7], [3.0, 2.0, -20.5]])
    np.testing.assert_allclose(SmoothSurface(mesh).distance(points), np.linalg.norm(points, axis=1) - 20.0, atol=0.01)


def test_pieces_that_stand_apart_or_meet_at_a_seam_are_left_alone():
    """Side by side; two halves of a ball that share no vertex, a hundredth of a micrometre off; a piece far inside."""
    vertices, faces = BIG
    left = vertices[faces].mean(axis=1)[:, 0] < 0.0
    seam = [(vertices, faces[left]), (vertices + 1e-5, faces[~left])]
    for meshes in ([BIG, ball(8.0, [29.0, 0.0, 0.0])], seam, [BIG, ball(5.0, MIDDLE)]):
        assert checked_mesh("bodies", *together(*meshes)).pieces.max() == 1
