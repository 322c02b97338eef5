"""Fixed surfaces are looked at as they are pressed, and never seen mirrored."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.pictures.contact_picture import contact_pose
from casadi_contact.pictures.view import PictureAxis, View, view_of

GROWING = {"x": "posterior", "y": "superior", "z": "medial"}
CUP_POLE = np.array([0.15, 0.82, 0.55]) / np.linalg.norm([0.15, 0.82, 0.55])


@pytest.mark.parametrize(
    ("direction", "right", "up"),
    [
        ([0, -1, 0], [0, 0, 1], [1, 0, 0]),  # a knee from above: medial to the right, posterior upwards
        ([0, 1, 0], [0, 0, -1], [1, 0, 0]),
        ([1, 0, 0], [0, 0, 1], [0, 1, 0]),  # a patella from in front: medial to the right, superior upwards
        ([-1, 0, 0], [0, 0, -1], [0, 1, 0]),
        ([0, 0, 1], [-1, 0, 0], [0, 1, 0]),  # a glenoid from the side: anterior to the right
        ([0, 0, -1], [1, 0, 0], [0, 1, 0]),
    ],
)
def test_axes_of_each_direction(direction, right, up):
    view = View.along(np.array(direction, dtype=float))
    np.testing.assert_allclose(view.right.pointing, right, atol=1e-15)
    np.testing.assert_allclose(view.up.pointing, up, atol=1e-15)
    for axis in (view.right, view.up):
        assert axis.label == f"{axis.name}, {GROWING[axis.name]} [mm]"


def test_every_view_is_a_right_handed_frame():
    for direction in np.random.default_rng(3).normal(size=(50, 3)):
        view = View.along(direction)
        frame = np.stack([view.right.pointing, view.up.pointing, view.toward.pointing])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1.0)
        assert view.toward.pointing @ direction == pytest.approx(-np.linalg.norm(direction))
        assert view.behind.toward.pointing @ direction > 0.0


@pytest.mark.parametrize(
    ("scene", "direction", "name"),
    [
        ("knee", [0.0, -1.0, 0.0], "inferior (−y)"),
        ("patellofemoral", [1.0, 0.0, 0.0], "posterior (+x)"),
        ("glenohumeral", [0.0, 0.0, 1.0], "medial (+z)"),
        (
            "hip",
            CUP_POLE,
            "superior-medial (0.15 x + 0.82 y + 0.55 z)",
        ),  # no single direction
    ],
)
def test_scenes_are_seen_as_they_are_pressed_and_the_contact_pose_overlaps_by_a_tenth(scene, direction, name):
    scene = cc.load_scene(scene)
    model = cc.ElasticFoundation(scene, scene.grids["coarse"])
    view = view_of(model)
    np.testing.assert_allclose(-view.toward.pointing, direction, atol=1e-6)
    assert view.name == name
    pose = contact_pose(model)
    assert model.gaps(pose[None]).min() == pytest.approx(-0.1, abs=1e-6)
    assert np.linalg.norm(np.cross(pose[:3] - scene.start_pose[:3], direction)) == pytest.approx(0.0, abs=1e-4)


def test_an_oblique_axis_says_which_sum_it_is_and_grows_along_its_largest_part():
    axis = PictureAxis.along(np.array([0.6, 0.0, -0.8]))
    assert (axis.name, axis.reversed) == ("medial-anterior", True)
    assert axis.label == "medial-anterior [mm]\n−0.60 x + 0.80 z"
    plain = PictureAxis.along(np.array([0.6, 0.0, -0.8]), anatomical=False)
    assert (plain.name, plain.label) == ("−0.60 x + 0.80 z", "−0.60 x + 0.80 z [mm]")
    assert axis.of(np.array([0.0, 5.0, 10.0])) == pytest.approx(8.0)
    np.testing.assert_allclose(axis.pointing, [0.6, 0.0, -0.8])
