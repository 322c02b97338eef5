"""Meshes are cleaned and checked, and those that cannot work are refused by name; smooth surfaces and their fields."""

import sys

import numpy as np
import pytest

from casadi_contact.geometry.distance_field import build_field, kept_field
from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.geometry.smooth_surface import SmoothSurface
from casadi_contact.geometry.triangle_mesh import RayCaster
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh
from tests.support.agreement import differences
from tests.support.meshes import ball_mesh, cap_mesh, scene_of, sheet_mesh, shell_mesh, torus_mesh, unit

TETRAHEDRON = (
    10.0 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def test_degenerate_and_repeated_triangles_are_dropped_and_counted():
    """As exporters write them: the same triangle again, from any corner; a mesh written twice is the same mesh."""
    vertices, faces = TETRAHEDRON
    on_edge = np.vstack([vertices, [5.0, 0.0, 0.0]])
    for more in ([[0, 0, 1], [0, 1, 4]], [faces[2], np.roll(faces[1], 1)], faces):
        mesh = checked_mesh("t", on_edge, np.vstack([faces, more]))
        assert (len(mesh.faces), mesh.dropped) == (4, len(more))


def test_triangles_that_do_not_join_are_no_surface():
    """Corners of neighbours that differ in their fourth digit are different vertices; a few single plates may stand."""
    vertices, triangles = ball_mesh(20.0, 5.0)
    corners = vertices[triangles].reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    assert checked_mesh("ball", corners, faces).pieces.max() == 0
    apart = corners + np.random.default_rng(0).uniform(-1e-3, 1e-3, corners.shape)
    with pytest.raises(ValueError, match="pieces"):
        checked_mesh("ball", apart, faces)
    assert checked_mesh("plates", apart[:9], faces[:3]).pieces.max() == 2


def damaged(vertex=None, value=None, scale=1.0, faces=TETRAHEDRON[1]):
    vertices = scale * TETRAHEDRON[0]
    if vertex is not None:
        vertices[vertex] = value
    return vertices, faces


@pytest.mark.parametrize(
    ("mesh", "units", "said"),
    [
        (damaged(faces=np.zeros((0, 3))), "mm", "is empty"),
        (damaged(1, np.nan), "mm", "vertex 1 is .*nan"),
        (damaged(scale=0.001), "mm", "is the file in m?"),
        (damaged(), "m", "is the file in mm?"),
        (damaged(), "foot", "units = 'foot', expected m or mm"),
        (damaged(faces=TETRAHEDRON[1][:, ::-1]), "mm", "inside-out"),
        (damaged(faces=np.vstack([TETRAHEDRON[1][:3], [[1, 3, 2]]])), "mm", "opposite"),
        (damaged(faces=np.vstack([TETRAHEDRON[1], [[1, 2, 0]]])), "mm", "not manifold"),
        (damaged(faces=np.array([[0, 1, 1]])), "mm", "all 1 triangles are degenerate"),
        (damaged(faces=np.vstack([*2 * [TETRAHEDRON[1]], [[0, 2, 1]]])), "mm", "repeated"),
        (damaged(faces=np.array([[0, 1, 9]])), "mm", "names vertex 9 of 4"),
    ],
)
def test_meshes_that_cannot_work_are_refused(mesh, units, said):
    with pytest.raises(ValueError, match=said):
        checked_mesh("t", *mesh, units)


@pytest.mark.parametrize("stray", [[5000.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
def test_a_vertex_that_no_triangle_uses_says_nothing_about_the_mesh(stray):
    vertices, faces = TETRAHEDRON
    plain = checked_mesh("t", vertices, faces)
    mesh = checked_mesh("t", np.vstack([vertices[:2], stray, vertices[2:]]), faces + (faces > 1))
    np.testing.assert_array_equal(mesh.vertices_mm, plain.vertices_mm)
    np.testing.assert_array_equal(mesh.faces, plain.faces)


def with_fin(at):
    """A sheet y = 0 with a triangle that stands on one of its edges near (x, z)."""
    vertices, faces = sheet_mesh(40.0, 1.0)
    at = np.array([at[0], 0.0, at[1]])
    first, second = faces[np.linalg.norm(vertices[faces].mean(axis=1) - at, axis=1).argmin()][:2]
    top = vertices[first] + np.array([0.0, 1.0, 0.0])
    return np.vstack([vertices, top]), np.vstack([faces, [first, second, len(vertices)]])


def test_non_manifold_edges_are_refused_near_contact_and_counted_elsewhere():
    contact = [((-10.0, -np.inf, -10.0), (-2.0, np.inf, 10.0)), ((2.0, -np.inf, -10.0), (10.0, np.inf, 10.0))]
    for at in ((5.0, 0.0), (-5.0, 3.0), (11.5, 0.0)):
        with pytest.raises(ValueError, match="manifold near contact"):
            checked_mesh("sheet", *with_fin(at), contact=contact)
    for at in ((17.0, 0.0), (5.0, -16.0)):
        mesh = checked_mesh("sheet", *with_fin(at), contact=contact)
        assert len(mesh.nonmanifold_edges) == 1
        assert "1 non-manifold edges away from contact" in str(build_field(mesh).fit)
        with pytest.raises(ValueError, match="sheet is not manifold: "):
            checked_mesh("sheet", *with_fin(at))


def test_a_scene_bears_them_on_its_fixed_body_away_from_the_patches_only(tmp_path):
    fin, bounds = with_fin((17.0, 0.0)), "[geometry.patches.contact]\nx = [-10.0, 10.0]\n"
    scene = scene_of(tmp_path, fin, fin, extra=bounds)
    assert len(body_mesh(scene.geometry, "fixed").nonmanifold_edges) == 1
    with pytest.raises(ValueError, match="is not manifold: "):
        body_mesh(scene.geometry, "moving")


def test_the_smooth_surface_of_a_torus_is_its_distance_and_the_field_follows():
    vertices, faces = torus_mesh(18.0, 12.0, 1.2)
    mesh = checked_mesh("torus", vertices, faces[(vertices[faces][..., 1] < -24.0).all(axis=1)])
    centres = mesh.corners_mm.mean(axis=1)
    centres = centres[(centres[:, 1] < -25.5)]
    normals = unit(centres - 18.0 * unit(centres * [1.0, 1.0, 0.0]))
    points = centres + np.random.default_rng(0).uniform(-0.5, 0.5, (len(centres), 1)) * normals
    exact = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 18.0, points[:, 2]) - 12.0
    assert np.abs(SmoothSurface(mesh).distance(points) - exact).max() < 1e-3
    field = build_field(mesh)
    values, gradients = field(points)
    assert np.sqrt(np.mean((values - exact) ** 2)) < 3e-4
    np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1.0, atol=0.01)
    assert field.fit.rms_mm < 0.01


def test_gradient_of_the_field_agrees_with_differences_inside_and_outside_its_grid():
    field = build_field(checked_mesh("cap", *cap_mesh(20.0, 1.2, 0.5)))
    points = np.random.default_rng(0).uniform([-20.0, -30.0, -20.0], [20.0, -10.0, 20.0], (500, 3))
    slopes = differences(lambda at: field(at)[0], points, 1e-6)
    np.testing.assert_allclose(field(points)[1], slopes, atol=1e-6)


def test_a_fine_field_is_exact_at_a_thin_shell_and_beside_it():
    """Spheres of 10 and 11 mm: half way between them the distance has a kink, which a coarse grid carries to both."""
    shell = checked_mesh("shell", *shell_mesh(10.0, 11.0, 0.6, 0.7, [0.0, 1.0, 0.0]))
    x, z = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 2000))
    away = unit(np.stack([x, np.ones(2000), z], axis=1))
    off = {}
    for spacing in (0.4, 0.17):
        field = build_field(shell, spacing)
        off[spacing] = max(np.abs(field(radius * away)[0]).max() for radius in (10.0, 11.0))
        beside = [field(radius * away)[0] - abs(radius - 10.5) + 0.5 for radius in (7.5, 8.5, 9.0, 12.0, 13.0)]
        assert np.abs(beside).max() < 5e-3
    assert off[0.17] < 2e-3 < 8e-3 < off[0.4]


def test_a_field_is_made_once_and_again_where_its_file_is_damaged(tmp_path, monkeypatch):
    monkeypatch.setenv("CASADI_CONTACT_CACHE", str(tmp_path / "cache"))
    mesh, asked = checked_mesh("t", *TETRAHEDRON), []

    def surface():
        asked.append(mesh)
        return SmoothSurface(mesh)

    first = kept_field(mesh, 1.0, surface, least_bytes=0)
    (file,) = (tmp_path / "cache").iterdir()
    for damage, made in ((lambda content: content, 1), (lambda content: content[:-8], 2), (lambda _: b"", 3)):
        file.write_bytes(damage(file.read_bytes()))
        again = kept_field(mesh, 1.0, surface, least_bytes=0)
        np.testing.assert_array_equal(again.parameters, first.parameters)
        assert (again.fit, len(asked)) == (first.fit, made)
    kept_field(mesh, 1.4, surface, least_bytes=0, most_bytes=file.stat().st_size)
    assert [each != file for each in file.parent.iterdir()] == [True], "the latest alone has room"


def test_triangles_that_are_halved_stay_joined_and_keep_their_area():
    mesh, plain = checked_mesh("t", *TETRAHEDRON).subdivided(1.5), checked_mesh("t", *TETRAHEDRON)
    assert np.linalg.norm(mesh.corners_mm - np.roll(mesh.corners_mm, 1, axis=1), axis=2).max() <= 1.5
    assert len(mesh.boundary_edges) == 0
    assert mesh.areas_mm2.sum() == pytest.approx(plain.areas_mm2.sum())


def test_a_field_too_fine_for_memory_is_refused():
    with pytest.raises(ValueError, match="choose a larger spacing"):
        build_field(checked_mesh("t", *TETRAHEDRON), 0.01)


@pytest.mark.parametrize(("library", "use"), [("igl", SmoothSurface), ("trimesh", RayCaster)])
def test_a_missing_library_is_named_with_the_way_to_get_it(monkeypatch, library, use):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=r"pip install casadi_contact\[mesh\]"):
        use(checked_mesh("t", *TETRAHEDRON))


def test_rays_hit_the_first_triangle_in_double_precision():
    caster = RayCaster(checked_mesh("t", *TETRAHEDRON))
    origins = np.array([[2.0, 3.0, -5.0], [2.0, 3.0, 1.0], [20.0, 3.0, -5.0]])
    directions = np.tile([0.0, 0.0, 1.0], (3, 1))
    distance, face = caster.first_hits(origins, directions)
    np.testing.assert_allclose(distance, [5.0, 4.0, np.inf], atol=1e-12)
    assert caster.leaves(directions, face).tolist() == [False, True, False]
