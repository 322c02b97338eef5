"""Mesh scenes that would give wrong loads in silence are refused with the cure; rims of a part are no cuts."""

import numpy as np
import pytest

import casadi_contact as cc
from tests.support import meshes
from tests.support.meshes import ball_mesh, cap_mesh, mesh_scene_text, sheet_mesh, shell_mesh, slab_mesh, write_obj

POLE = [0.0, 1.0, 0.0]


def scene_of(folder, moving, fixed, extra="", grid=(30, 30)):
    return meshes.scene_of(folder, moving, fixed, extra=extra, grid=grid)


def plate(side=14.0, thickness=4.0):
    """A closed slab with its top at y = 0."""
    import trimesh

    box = trimesh.creation.box((side, thickness, side)).subdivide_to_size(2.0)
    return box.vertices - [0.0, 0.5 * thickness, 0.0], box.faces


BALL = cap_mesh(20.0, 3.0, 0.5)


@pytest.mark.parametrize(
    ("patches", "said"),
    [
        ("[geometry.patches.a]\nx = [-6, 1]\n[geometry.patches.b]\nx = [0, 6]", "a and b share .* carry load twice"),
        ("[geometry.patches.a]\nx = [-0.006, 0.006]\nz = [-0.006, 0.006]", r"holds 0 mm².*are its bounds in m\?"),
        ("[geometry.patches.a]\nx = [-0.05, 0.05]", r"a holds .*are its bounds in m\?"),
        ("[geometry.patches.a]\nx = [6.0, 6.4]\nz = [6.0, 6.4]", r"a holds 0\.\d+ mm².*expected 4 mm² at least"),
    ],
)
def test_patches_that_overlap_or_hold_hardly_any_surface(tmp_path, patches, said):
    names = [line.split(".")[-1].rstrip("]") for line in patches.splitlines() if line.startswith("[")]
    write_obj(tmp_path / "moving.obj", *BALL)
    write_obj(tmp_path / "fixed.obj", *sheet_mesh(14.0, 0.5))
    scene_text = mesh_scene_text("moving.obj", "fixed.obj", extra=patches)
    sensitive = ", ".join(f'"Fy_{name}"' for name in names)
    scene_text = scene_text.replace('sensitive = ["Fy"]', f"sensitive = [{sensitive}]")
    scene_text = scene_text.replace('names = ["Fx", "Fy",', f'names = ["Fx", {sensitive},')
    scene_text = scene_text.replace("\nFy = 1.0", "".join(f"\nFy_{name} = 1.0" for name in names))
    (tmp_path / "scene.toml").write_text(scene_text)
    scene = cc.load_scene(tmp_path / "scene.toml")
    with pytest.raises(ValueError, match=said):
        cc.ElasticFoundation(scene)


def test_a_surface_that_faces_z_is_told_to_be_turned(tmp_path):
    vertices, faces = sheet_mesh(14.0, 2.0)
    scene = scene_of(tmp_path, BALL, (vertices[:, [2, 0, 1]], faces))
    with pytest.raises(ValueError, match=r"its surface faces \+z: turn it to the moving body with geometry\.axes"):
        cc.ElasticFoundation(scene)


def test_a_grid_on_the_back_of_a_cup_is_refused_and_one_on_its_inside_carries_load(tmp_path):
    """The head lies below, in a cup that opens downwards: a ray from above meets the back first."""
    head, cup = ball_mesh(16.0, 2.5), shell_mesh(16.4, 20.0, 2.0, 1.2, POLE)
    with pytest.raises(ValueError, match=r"faces away from the moving body.*pressing = \[0\.0, 1\.0, 0\.0\]"):
        cc.ElasticFoundation(scene_of(tmp_path, head, cup))
    thick = shell_mesh(16.4, 26.0, 2.0, 1.9, POLE)
    for extra in ("", "cup_centre = [0.0, 60.0, 0.0]"):
        with pytest.raises(ValueError, match=r"faces away from the moving body.*say where"):
            cc.ElasticFoundation(scene_of(tmp_path, head, thick, extra))
    inside = cc.ElasticFoundation(scene_of(tmp_path, head, cup, "pressing = [0.0, 1.0, 0.0]"))
    assert inside([0.0, 0.6, 0.0, 0.0, 0.0, 0.0])[1] > 100.0


def test_a_thin_closed_shell_says_which_of_its_sides_counts(tmp_path):
    """Pressed by more than its thickness a whole shell loses load; its outer side alone pushes back as a ball."""
    points, faces = shell_mesh(14.5, 16.0, 1.5, 1.0, POLE)
    shell = (points * [1.0, -1.0, 1.0], faces[:, ::-1])  # opens upwards: its outside is below
    with pytest.raises(ValueError, match=r"thin shell about 1\.5 mm thick.*geometry\.shell to 'outer'"):
        cc.ElasticFoundation(scene_of(tmp_path, shell, sheet_mesh(14.0, 1.0)))
    with pytest.raises(ValueError, match=r"spacing = 0\.75 mm too coarse for it: expected at most 0\.6"):
        cc.ElasticFoundation(scene_of(tmp_path, shell, sheet_mesh(14.0, 1.0), 'shell = "whole"'))
    depths = np.array([0.3, 2.0])
    poses = np.zeros((2, 6))
    poses[:, 1] = 16.0 - depths
    exact = np.pi * 267.5728 * depths**2 * (16.0 - depths / 3.0)
    plate = sheet_mesh(18.0, 1.0)
    outer = cc.ElasticFoundation(scene_of(tmp_path, shell, plate, 'shell = "outer"', grid=(60, 60)))
    np.testing.assert_allclose(-outer(poses)[:, 1], exact, rtol=0.02)
    whole = cc.ElasticFoundation(scene_of(tmp_path, shell, plate, 'shell = "whole"\nspacing = 0.4', grid=(60, 60)))
    found = -whole(poses)[:, 1] / exact
    assert found[0] == pytest.approx(1.0, abs=0.06)
    assert found[1] < 0.9


def test_a_thin_shell_of_the_fixed_body_alone_has_a_fine_field(tmp_path):
    """A ball of 20 mm, whose own field need not be fine, on a plate of 1 mm carries its closed form."""
    ball, plate = ball_mesh(20.0, 2.0), slab_mesh(*sheet_mesh(12.0, 1.0), 1.0)
    with pytest.raises(ValueError, match=r"fixed mesh fixed\.obj is a thin shell.*spacing = 0\.75 mm too coarse"):
        cc.ElasticFoundation(scene_of(tmp_path, ball, plate))
    scene = scene_of(tmp_path, ball, plate, "spacing = {moving = 0.75, fixed = 0.15}", grid=(60, 60))
    load = -cc.ElasticFoundation(scene)([0.0, 20.0 - 0.1, 0.0, 0.0, 0.0, 0.0])[1]
    assert load == pytest.approx(np.pi * 267.5728 * 0.1**2 * (20.0 - 0.1 / 3.0), rel=0.02)


def test_a_shell_with_a_missing_triangle_is_refused_as_a_closed_one_and_its_outer_side_carries_the_same(tmp_path):
    """Missing on the side that does not touch; without a word, the load would be twice that of the closed shell."""
    points, faces = shell_mesh(14.5, 16.0, 1.5, 1.0, POLE)
    inner = int(np.linalg.norm(points[faces].mean(axis=1) - [0.0, 14.4, 0.0], axis=1).argmin())
    shell = (points * [1.0, -1.0, 1.0], np.delete(faces, inner, axis=0)[:, ::-1])
    with pytest.raises(ValueError, match=r"thin shell about 1\.5 mm thick.*geometry\.shell to 'outer'"):
        cc.ElasticFoundation(scene_of(tmp_path, shell, sheet_mesh(14.0, 1.0)))
    outer = cc.ElasticFoundation(scene_of(tmp_path, shell, sheet_mesh(14.0, 1.0), 'shell = "outer"', grid=(60, 60)))
    load = -outer([0.0, 16.0 - 0.3, 0.0, 0.0, 0.0, 0.0])[1]
    assert load == pytest.approx(np.pi * 267.5728 * 0.3**2 * (16.0 - 0.1), rel=0.02)


def test_the_outer_side_of_a_saddle_shell_is_refused_as_it_is_on_both_sides(tmp_path):
    """As at the base of a thumb. Both of its sides bear as a whole, while overlaps are small."""
    top = sheet_mesh(14.0, 0.5, lambda x, z: z**2 / 22.0 - x**2 / 20.0)
    points, faces = slab_mesh(*top, 1.0)
    saddle = (points * [1.0, -1.0, 1.0], faces[:, ::-1])
    fixed = sheet_mesh(12.0, 0.5, lambda x, z: x**2 / 20.0 - z**2 / 22.0)
    anchor = "[geometry.patches.contact]\nanchor = [-0.1, 0.7, -0.1]"
    with pytest.raises(ValueError, match=r"'outer' keeps both sides of the moving mesh .* over \d+% .*expected one"):
        cc.ElasticFoundation(scene_of(tmp_path, saddle, fixed, f'shell = "outer"\n{anchor}'))
    whole = cc.ElasticFoundation(scene_of(tmp_path, saddle, fixed, f'shell = "whole"\nspacing = 0.35\n{anchor}'))
    load = -whole([0.0, -0.1, 0.0, 0.0, 0.0, 0.0])[1]
    x, z = np.meshgrid(*2 * [np.linspace(-6.0, 6.0, 100)])
    overlap = 0.1 / np.sqrt(1.0 + (x / 10.0) ** 2 + (z / 11.0) ** 2)  # normal to the surface, of 0.1 mm downwards
    assert load == pytest.approx(267.5728 * overlap.mean() * 144.0, rel=0.05)


def test_two_sheets_that_nothing_joins_are_a_shell(tmp_path):
    top, faces = sheet_mesh(14.0, 1.0)
    fixed = np.vstack([top, top - [0.0, 0.5, 0.0]]), np.vstack([faces, faces[:, ::-1] + len(top)])
    with pytest.raises(ValueError, match=r"the fixed mesh .* thin shell about 0\.5 mm .* expected at most 0\.2 mm"):
        cc.ElasticFoundation(scene_of(tmp_path, BALL, fixed))


@pytest.mark.parametrize(
    ("fixed", "extra", "cut"),
    [
        (sheet_mesh(14.0, 2.0), "", True),  # an open edge may be a cut of a larger part
        (sheet_mesh(14.0, 2.0), 'open_edges = "rim"', False),
        (plate(), "", False),  # the slab ends there
        (plate(), "[geometry.patches.contact]\nx = [-7.0, 4.0]", True),  # the patch ends, the slab goes on
    ],
)
def test_contact_that_reaches_the_rim_of_a_part_is_complete_and_that_which_reaches_a_cut_is_not(
    tmp_path, fixed, extra, cut
):
    model = cc.ElasticFoundation(scene_of(tmp_path, BALL, fixed, extra))
    poses = np.zeros((2, 6))
    poses[:, 1] = 19.8
    poses[1, 0] = 5.0
    assert (model(poses)[:, 1] < -10.0).all()
    assert model.at_edge(poses)[:, 0].tolist() == [False, cut]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("pressing = [0.0, 0.0, 0.0]", "geometry.pressing = .* expected a direction"),
        ("pressing = [0.0, -1.0]", "geometry.pressing = .* expected 3 numbers"),
        ("start_pose = [1.0]", "geometry.start_pose = .* expected 6 numbers tx, ty, tz"),
        ('open_edges = "torn"', "geometry.open_edges = 'torn', expected cut or rim"),
        ('shell = "inner"', "geometry.shell = 'inner', expected outer or whole"),
        (
            '[geometry.placement.moving]\nmirror = "w"',
            r"geometry\.placement\.moving\.mirror = 'w', expected x or y or z",
        ),
        (
            "[geometry.placement.moving]\noffset = 3.0",
            r"geometry\.placement\.moving\.offset = 3\.0, expected 3 numbers",
        ),
        ("[geometry.placement.femur]\noffset = [1, 2, 3]", r"unknown key geometry\.placement\.femur"),
    ],
)
def test_a_bad_value_is_named(tmp_path, lines, said):
    with pytest.raises(ValueError, match=said):
        scene_of(tmp_path, BALL, sheet_mesh(14.0, 2.0), lines)
