"""Sections hold the direction of pressing, upwards, and lie where contact is."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import casadi_contact as cc
from casadi_contact.contact.pressures import PressureMap
from casadi_contact.pictures.contact_picture import contact_pose
from casadi_contact.pictures.section import draw_section
from casadi_contact.pictures.view import view_of


@pytest.mark.parametrize(
    ("scene", "labels", "reversed_axes"),
    [
        ("knee", ("x, posterior [mm]", "y, superior [mm]"), (False, False)),
        ("patellofemoral", ("y, superior [mm]", "x, posterior [mm]"), (False, True)),
        ("glenohumeral", ("y, superior [mm]", "z, medial [mm]"), (False, True)),
    ],
)
def test_the_moving_body_lies_above_the_fixed_one_and_both_meet_at_the_centre_of_pressure(scene, labels, reversed_axes):
    scene = cc.load_scene(scene)
    model = cc.ElasticFoundation(scene, scene.grids["coarse"])
    pose, view = contact_pose(model), view_of(model)
    pressed = model.pressure_maps(pose)[0]
    axis = Figure().subplots()
    draw_section(axis, model, pose, [pressed], along=view.up, across=view.right, toward=view.toward)
    assert (axis.get_xlabel(), axis.get_ylabel()) == labels
    assert (axis.xaxis.get_inverted(), axis.yaxis.get_inverted()) == reversed_axes
    fixed, centre = (line.get_xydata() for line in axis.get_lines())
    assert np.nanmin(np.hypot(*(fixed - centre).T)) < 1.0
    outline = np.concatenate([path.vertices for path in axis.collections[1].get_paths()])
    assert np.hypot(*(outline - centre).T).min() < 1.0
    upwards = -1.0 if reversed_axes[1] else 1.0
    assert upwards * (outline[:, 1].mean() - centre[0, 1]) > 1.0  # bends away from contact


def test_a_section_of_both_patches_draws_each_one_in_the_plane_of_their_common_centre():
    scene = cc.load_scene("knee")
    model = cc.ElasticFoundation(scene, scene.grids["coarse"])
    pose, view = contact_pose(model), view_of(model)
    maps = model.pressure_maps(pose)
    axis = Figure().subplots()
    draw_section(axis, model, pose, maps, along=view.right, across=view.up, toward=view.toward)
    lines = [line.get_xdata() for line in axis.get_lines() if line.get_color() != "red"]
    assert [(x.min() > 0.0, x.max() < 0.0) for x in lines] == [(True, False), (False, True)]
    middle = np.mean([pressed.centre_mm[0] for pressed in maps])  # pressed alike
    assert axis.get_title() == f"medial, lateral: section at x = {middle:.1f} mm"


def test_condyles_that_touch_are_each_drawn_round_with_no_spike_between_them():
    """The frontal section through both: each outline stays on its own side, below the middle of its condyle."""
    scene = cc.load_scene("knee")
    model = cc.ElasticFoundation(scene, scene.grids["coarse"])
    pose, view = contact_pose(model), view_of(model)
    axis = Figure().subplots()
    draw_section(axis, model, pose, model.pressure_maps(pose), along=view.right, across=view.up, toward=view.toward)
    outlines = [np.concatenate([path.vertices for path in axis.collections[k].get_paths()]) for k in (1, 3)]
    for side, outline in zip((1.0, -1.0), outlines, strict=True):
        assert (side * outline[:, 0] > 2.0).all()
        inner = outline[np.abs(outline[:, 0]) < 10.0]
        assert inner[:, 1].max() < pose[1] - 10.0  # where both are round they meet at the height of their centres


def test_a_condyle_that_is_turned_is_drawn_round_and_no_higher_than_its_arcs_reach():
    """Height over width is convex below the middle of a condyle; beyond the outermost arcs there is no surface."""
    scene = cc.load_scene("knee")
    model = cc.ElasticFoundation(scene, scene.grids["coarse"])
    pose, view = np.array([0.5, 27.23, 0.1, 0.001, -0.05, -0.3]), view_of(model)
    axis = Figure().subplots()
    draw_section(axis, model, pose, model.pressure_maps(pose), along=view.right, across=view.up, toward=view.toward)
    for k in (1, 3):
        width, height = np.concatenate([path.vertices for path in axis.collections[k].get_paths()]).T
        order = np.argsort(width)
        at = np.linspace(width.min(), width.max(), 15)[1:-1]
        assert (np.diff(np.interp(at, width[order], height[order]), 2) > 0.0).all()


def test_midway_between_two_rows_of_a_sloping_surface_the_line_follows_one_of_them():
    model = cc.ElasticFoundation(cc.load_scene("knee"), (10, 10))
    x, z = (side.ravel() for side in np.meshgrid(np.arange(-9.5, 10.0), np.arange(-4.5, 5.0)))
    sloping = PressureMap("med", np.stack([x, 30.0 + 0.5 * z, z], 1), np.ones(x.size), np.ones(x.size))
    axis, view = Figure().subplots(), view_of(model)
    draw_section(axis, model, contact_pose(model), [sloping], along=view.up, across=view.right, toward=view.toward)
    along, height = axis.get_lines()[0].get_xydata().T
    np.testing.assert_allclose(along, np.arange(-9.5, 10.0))
    assert np.ptp(height) == 0.0
    assert abs(height[0] - 30.0) == 0.25
