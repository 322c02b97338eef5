"""Mesh scenes that would give wrong loads in silence are refused with the cure; rims of a part are no cuts."""

import numpy as np
import pytest

import casadi_contact as cc
from tests.support.meshes import STIFFNESS, ball_mesh, cap_mesh, revolved, scene_of, sheet_mesh, shell_mesh, slab_mesh

BALL = cap_mesh(20.0, 3.0, 0.5)
PATCH = "[geometry.patches.contact]"
PLATE, SLAB = sheet_mesh(14.0, 2.0), slab_mesh(*sheet_mesh(14.0, 2.0), 4.0)
_SHELL = shell_mesh(8.5, 10.0, 1.0, 1.0, [0.0, 1.0, 0.0])
SHELL = _SHELL[0] * [1.0, -1.0, 1.0], _SHELL[1][:, ::-1]  # opens upwards: its outside is below
_TOP = slab_mesh(*sheet_mesh(14.0, 0.5, lambda x, z: z**2 / 22.0 - x**2 / 20.0), 1.0)
SADDLE = _TOP[0] * [1.0, -1.0, 1.0], _TOP[1][:, ::-1]
UNDER_SADDLE = sheet_mesh(12.0, 0.5, lambda x, z: x**2 / 20.0 - z**2 / 22.0)
ANCHOR = f"{PATCH}\nanchor = [-0.1, 0.7, -0.1]"


@pytest.mark.parametrize(
    ("moving", "fixed", "extra", "said"),
    [
        (BALL, PLATE, "[geometry.patches.a]\nx = [-6, 1]\n[geometry.patches.b]\nx = [0, 6]", "twice"),
        (BALL, PLATE, "[geometry.patches.a]\nx = [-0.006, 0.006]\nz = [-0.006, 0.006]", "in m"),
        (BALL, sheet_mesh(14.0, 0.5), "[geometry.patches.a]\nx = [6.0, 6.4]\nz = [6.0, 6.4]", "at least"),
        (BALL, (PLATE[0][:, [2, 0, 1]], PLATE[1]), "", "axes"),  # faces z
        (SHELL, PLATE, "", "outer"),
        (SHELL, PLATE, 'shell = "whole"', "spacing"),
        (BALL, slab_mesh(*PLATE, 1.0), "", "spacing"),
        (SADDLE, UNDER_SADDLE, f'shell = "outer"\n{ANCHOR}', "both sides"),
    ],
)
def test_meshes_that_would_give_wrong_loads_are_refused(tmp_path, moving, fixed, extra, said):
    with pytest.raises(ValueError, match=said):
        cc.ElasticFoundation(scene_of(tmp_path, moving, fixed, extra=extra, grid=(30, 30)))


def ball_force(radius, depth):
    """π·K/h·d²·(R - d/3) on a plane."""
    return np.pi * STIFFNESS * depth**2 * (radius - depth / 3.0)


def test_the_outer_side_of_a_thin_shell_pushes_back_as_a_ball_and_all_of_it_loses_load(tmp_path):
    depths, poses = np.array([0.3, 2.0]), np.zeros((2, 6))
    poses[:, 1] = 10.0 - depths
    found = {}
    for extra in ('shell = "outer"', 'shell = "whole"\nspacing = 0.4'):
        scene = scene_of(tmp_path, SHELL, sheet_mesh(18.0, 1.0), extra=extra, grid=(60, 60))
        found[extra[9]] = -cc.ElasticFoundation(scene)(poses)[:, 1] / ball_force(10.0, depths)
    np.testing.assert_allclose(found["o"], 1.0, rtol=0.02)
    assert found["w"][0] == pytest.approx(1.0, abs=0.06)
    assert found["w"][1] < 0.9


def test_a_thin_shell_of_the_fixed_body_alone_has_a_fine_field(tmp_path):
    """A ball of 20 mm, whose own field need not be fine, on a plate of 1 mm."""
    fine = {"extra": "spacing = {moving = 0.75, fixed = 0.15}", "grid": (60, 60)}
    scene = scene_of(tmp_path, BALL, slab_mesh(*sheet_mesh(12.0, 1.0), 1.0), **fine)
    load = -cc.ElasticFoundation(scene)([0.0, 20.0 - 0.1, 0.0, 0.0, 0.0, 0.0])[1]
    assert load == pytest.approx(ball_force(20.0, 0.1), rel=0.02)


def test_both_sides_of_a_saddle_shell_bear_as_a_whole_while_overlaps_are_small(tmp_path):
    """As at the base of a thumb."""
    whole = scene_of(tmp_path, SADDLE, UNDER_SADDLE, extra=f'shell = "whole"\nspacing = 0.35\n{ANCHOR}')
    load = -cc.ElasticFoundation(whole)([0.0, -0.1, 0.0, 0.0, 0.0, 0.0])[1]
    x, z = np.meshgrid(*2 * [np.linspace(-6.0, 6.0, 100)])
    overlap = 0.1 / np.sqrt(1.0 + (x / 10.0) ** 2 + (z / 11.0) ** 2)  # normal to the surface, of 0.1 mm downwards
    assert load == pytest.approx(STIFFNESS * overlap.mean() * 144.0, rel=0.05)


@pytest.mark.parametrize(
    ("fixed", "extra", "cut"),
    [
        (PLATE, "", True),  # an open edge may be a cut of a larger part
        (PLATE, 'open_edges = "rim"', False),
        (SLAB, "", False),  # the slab ends there
        (SLAB, f"{PATCH}\nx = [-7.0, 4.0]", True),  # the patch ends, the slab goes on
    ],
)
def test_contact_at_the_rim_of_a_part_is_complete_and_at_a_cut_is_not(tmp_path, fixed, extra, cut):
    model = cc.ElasticFoundation(scene_of(tmp_path, BALL, fixed, extra=extra, grid=(30, 30)))
    poses = np.zeros((2, 6))
    poses[:, 1] = 19.8
    poses[1, 0] = 5.0
    assert (model(poses)[:, 1] < -10.0).all()
    assert model.at_edge(poses)[:, 0].tolist() == [False, cut]


def oval_dish(edge_mm, hollow_mm):
    """A closed dish, hollow by the sphere's radius, whose outline is an ellipse; its rim falls steeply."""
    points, faces = revolved([(s, 0.0) for s in np.linspace(1.0, 0.0, int(17.0 / edge_mm))], int(107.0 / edge_mm))
    points *= [13.0, 0.0, 17.0]
    points[:, 1] = hollow_mm - np.sqrt(hollow_mm**2 - (points**2).sum(axis=1))
    return slab_mesh(points, faces, 6.0)


def test_elements_are_cut_where_a_patch_ends_before_the_part_and_not_at_its_rim(tmp_path):
    """Whatever the grid."""
    dish, ball = oval_dish(0.8, 27.0), ball_mesh(24.0, 1.5)
    whole = scene_of(tmp_path, ball, dish)
    bounded = scene_of(tmp_path, ball, dish, extra=f"{PATCH}\nx = [-100.0, 5.0]\n")
    for grid in ((40, 20), (160, 80)):
        assert len(whole.elements(grid)[0].edge_centres_mm) == 0
        cut = bounded.elements(grid)[0].edge_centres_mm
        assert len(cut) >= grid[1] // 2
        assert np.all(cut[:, 0] > 5.0 - 1.5 * 18.0 / grid[0])


def socket(radius_mm, angle, edge_mm, outer_mm):
    """A closed block with a spherical hollow as deep as an angle from its pole, flat around it."""
    down = np.linspace(angle, 0.0, int(radius_mm * angle / edge_mm) + 1)
    hollow = radius_mm * np.stack([np.sin(down), np.cos(angle) - np.cos(down)], axis=1)
    brim = np.linspace(outer_mm, hollow[0, 0], int((outer_mm - hollow[0, 0]) / edge_mm) + 1)[:-1]
    profile = [*((r, 0.0) for r in brim), *hollow]
    return slab_mesh(*revolved(profile, int(2.0 * np.pi * outer_mm / edge_mm)), radius_mm + 5.0)


def test_elements_are_cut_where_a_socket_grows_too_steep_for_them(tmp_path):
    """Its wall goes on and faces the ball: a load to the side is carried there, by no element of this grid."""
    scene = scene_of(tmp_path, ball_mesh(9.5, 1.0), socket(10.0, np.radians(85.0), 0.8, 14.0))
    (patch,) = scene.elements((60, 60))
    assert len(patch.edge_centres_mm) > 30
    assert np.median(np.hypot(patch.edge_centres_mm[:, 0], patch.edge_centres_mm[:, 2])) > 8.0
