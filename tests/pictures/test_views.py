"""Fixed surfaces are looked at as they are pressed, never mirrored; sections lie where contact is."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import casadi_contact as cc
from casadi_contact.pictures.contact_picture import contact_pose, draw_section
from casadi_contact.pictures.page import PictureAxis, View, view_of


def coarse(name):
    scene = cc.load_scene(name)
    return cc.ElasticFoundation(scene, scene.grids["coarse"])


@pytest.mark.parametrize(
    ("scene", "labels", "reversed_axes"),
    [
        ("knee", ("x, posterior [mm]", "y, superior [mm]"), (False, False)),
        ("patellofemoral", ("y, superior [mm]", "x, posterior [mm]"), (False, True)),
    ],
)
def test_the_moving_body_lies_above_the_fixed_one_and_both_meet_at_the_centre_of_pressure(scene, labels, reversed_axes):
    model = coarse(scene)
    pose, view = contact_pose(model), view_of(model)
    pressed = model.pressure_maps(pose)[0]
    axis = Figure().subplots()
    draw_section(axis, model, pose, [pressed], View(view.up, view.right, view.toward))
    assert (axis.get_xlabel(), axis.get_ylabel()) == labels
    assert (axis.xaxis.get_inverted(), axis.yaxis.get_inverted()) == reversed_axes
    fixed, centre = (line.get_xydata() for line in axis.get_lines())
    assert np.nanmin(np.hypot(*(fixed - centre).T)) < 1.0
    outline = np.concatenate([path.vertices for path in axis.collections[1].get_paths()])
    assert np.hypot(*(outline - centre).T).min() < 1.0
    upwards = -1.0 if reversed_axes[1] else 1.0
    assert upwards * (outline[:, 1].mean() - centre[0, 1]) > 1.0  # bends away from contact


def test_condyles_are_each_drawn_round_on_their_own_side():
    """The frontal section through both: height over width is convex, with no spike between the condyles."""
    model = coarse("knee")
    pose, view = np.array([0.5, 27.23, 0.1, 0.001, -0.05, -0.3]), view_of(model)
    axis = Figure().subplots()
    draw_section(axis, model, pose, model.pressure_maps(pose), view)
    assert axis.get_title().startswith("medial, lateral: section at x = ")
    for k, side in ((1, 1.0), (3, -1.0)):
        width, height = np.concatenate([path.vertices for path in axis.collections[k].get_paths()]).T
        assert (side * width > 2.0).all()
        order = np.argsort(width)
        at = np.linspace(width.min(), width.max(), 15)[1:-1]
        assert (np.diff(np.interp(at, width[order], height[order]), 2) > 0.0).all()


@pytest.mark.parametrize(
    ("direction", "right", "up"),
    [
        ([0, -1, 0], [0, 0, 1], [1, 0, 0]),  # a knee from above: medial to the right, posterior upwards
        ([1, 0, 0], [0, 0, 1], [0, 1, 0]),  # a patella from in front: medial to the right, superior upwards
        ([0, 0, 1], [-1, 0, 0], [0, 1, 0]),  # a glenoid from the side: anterior to the right
    ],
)
def test_axes_of_each_direction(direction, right, up):
    view, growing = View.along(np.array(direction, dtype=float)), {"x": "posterior", "y": "superior", "z": "medial"}
    np.testing.assert_allclose(view.right.pointing, right, atol=1e-15)
    np.testing.assert_allclose(view.up.pointing, up, atol=1e-15)
    for axis in (view.right, view.up):
        assert axis.label == f"{axis.name}, {growing[axis.name]} [mm]"


def test_every_view_is_a_right_handed_frame():
    for direction in np.random.default_rng(3).normal(size=(50, 3)):
        view = View.along(direction)
        frame = np.stack([view.right.pointing, view.up.pointing, view.toward.pointing])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1.0)
        assert view.toward.pointing @ direction == pytest.approx(-np.linalg.norm(direction))
        assert view.behind.toward.pointing @ direction > 0.0


CUP_POLE = np.array([0.15, 0.82, 0.55]) / np.linalg.norm([0.15, 0.82, 0.55])


@pytest.mark.parametrize(
    ("scene", "direction", "name"),
    [
        ("knee", [0.0, -1.0, 0.0], "inferior (−y)"),
        ("patellofemoral", [1.0, 0.0, 0.0], "posterior (+x)"),
        ("hip", CUP_POLE, "superior-medial (0.15 x + 0.82 y + 0.55 z)"),  # no single direction
    ],
)
def test_scenes_are_seen_as_they_are_pressed_and_the_contact_pose_overlaps_by_a_tenth(scene, direction, name):
    model = coarse(scene)
    view, pose = view_of(model), contact_pose(model)
    np.testing.assert_allclose(-view.toward.pointing, direction, atol=1e-6)
    assert view.name == name
    assert model.gaps(pose[None]).min() == pytest.approx(-0.1, abs=1e-6)
    travel = pose[:3] - model.scene.start_pose[:3]
    assert np.linalg.norm(np.cross(travel, direction)) == pytest.approx(0.0, abs=1e-4)


def test_an_oblique_axis_says_which_sum_it_is_and_grows_along_its_largest_part():
    axis = PictureAxis.along(np.array([0.6, 0.0, -0.8]))
    assert (axis.name, axis.reversed) == ("medial-anterior", True)
    assert axis.label == "medial-anterior [mm]\n−0.60 x + 0.80 z"
    assert PictureAxis.along(np.array([0.6, 0.0, -0.8]), anatomical=False).label == "−0.60 x + 0.80 z [mm]"
    assert axis.of(np.array([0.0, 5.0, 10.0])) == pytest.approx(8.0)
