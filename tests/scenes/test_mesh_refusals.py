"""Mesh scenes that would give wrong loads in silence are refused with the cure; rims of a part are no cuts."""

import numpy as np
import pytest

import casadi_contact as cc
from tests.support import meshes
from tests.support.meshes import ball_mesh, cap_mesh, sheet_mesh, shell_mesh, slab_mesh

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
        ("[geometry.patches.a]\nx = [-6, 1]\n[geometry.patches.b]\nx = [0, 6]", "twice"),
        ("[geometry.patches.a]\nx = [-0.006, 0.006]\nz = [-0.006, 0.006]", "in m"),
        ("[geometry.patches.a]\nx = [-0.05, 0.05]", "in m"),
        ("[geometry.patches.a]\nx = [6.0, 6.4]\nz = [6.0, 6.4]", "at least"),
    ],
)
def test_patches_that_overlap_or_hold_hardly_any_surface(tmp_path, patches, said):
    scene = scene_of(tmp_path, BALL, sheet_mesh(14.0, 0.5), patches)
    with pytest.raises(ValueError, match=said):
        cc.ElasticFoundation(scene)


def test_a_surface_that_faces_z_is_told_to_be_turned(tmp_path):
    vertices, faces = sheet_mesh(14.0, 2.0)
    scene = scene_of(tmp_path, BALL, (vertices[:, [2, 0, 1]], faces))
    with pytest.raises(ValueError, match="axes"):
        cc.ElasticFoundation(scene)


def test_a_thin_closed_shell_says_which_of_its_sides_counts(tmp_path):
    """Pressed by more than its thickness a whole shell loses load; its outer side alone pushes back as a ball."""
    points, faces = shell_mesh(14.5, 16.0, 1.5, 1.0, POLE)
    shell = (points * [1.0, -1.0, 1.0], faces[:, ::-1])  # opens upwards: its outside is below
    with pytest.raises(ValueError, match="outer"):
        cc.ElasticFoundation(scene_of(tmp_path, shell, sheet_mesh(14.0, 1.0)))
    with pytest.raises(ValueError, match="spacing"):
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
    with pytest.raises(ValueError, match="spacing"):
        cc.ElasticFoundation(scene_of(tmp_path, ball, plate))
    scene = scene_of(tmp_path, ball, plate, "spacing = {moving = 0.75, fixed = 0.15}", grid=(60, 60))
    load = -cc.ElasticFoundation(scene)([0.0, 20.0 - 0.1, 0.0, 0.0, 0.0, 0.0])[1]
    assert load == pytest.approx(np.pi * 267.5728 * 0.1**2 * (20.0 - 0.1 / 3.0), rel=0.02)


def test_the_outer_side_of_a_saddle_shell_is_refused_as_it_is_on_both_sides(tmp_path):
    """As at the base of a thumb. Both of its sides bear as a whole, while overlaps are small."""
    top = sheet_mesh(14.0, 0.5, lambda x, z: z**2 / 22.0 - x**2 / 20.0)
    points, faces = slab_mesh(*top, 1.0)
    saddle = (points * [1.0, -1.0, 1.0], faces[:, ::-1])
    fixed = sheet_mesh(12.0, 0.5, lambda x, z: x**2 / 20.0 - z**2 / 22.0)
    anchor = "[geometry.patches.contact]\nanchor = [-0.1, 0.7, -0.1]"
    with pytest.raises(ValueError, match="both sides"):
        cc.ElasticFoundation(scene_of(tmp_path, saddle, fixed, f'shell = "outer"\n{anchor}'))
    whole = cc.ElasticFoundation(scene_of(tmp_path, saddle, fixed, f'shell = "whole"\nspacing = 0.35\n{anchor}'))
    load = -whole([0.0, -0.1, 0.0, 0.0, 0.0, 0.0])[1]
    x, z = np.meshgrid(*2 * [np.linspace(-6.0, 6.0, 100)])
    overlap = 0.1 / np.sqrt(1.0 + (x / 10.0) ** 2 + (z / 11.0) ** 2)  # normal to the surface, of 0.1 mm downwards
    assert load == pytest.approx(267.5728 * overlap.mean() * 144.0, rel=0.05)


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
