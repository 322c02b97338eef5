"""The scene's axes and origins, from two meshes that lie as scans and CAD files do."""

import numpy as np
import pytest

from casadi_contact.core.conventions import rotation
from casadi_contact.geometry.mesh import Placement, axes_rotation, checked_mesh
from tests.support.joint_meshes import DOWN, POLE, analysed, ball_in_cup, condyles_in_dishes
from tests.support.meshes import ball_mesh, shell_mesh


@pytest.mark.parametrize("far_mm", [1.0, 40.0])
def test_a_ball_turns_about_its_own_centre_wherever_its_file_s_origin_is(far_mm):
    """A turn about an origin far away would take all of the 0.4 mm that the cup leaves; the cup keeps its origin."""
    ball, cup = (
        checked_mesh("ball", *ball_mesh(16.0, 2.5)),
        checked_mesh("cup", *shell_mesh(16.4, 22.0, 2.0, 1.3, DOWN)),
    )
    aside = np.array([0.0, far_mm, 0.0])
    frame = analysed(checked_mesh("ball", ball.vertices_mm + aside, ball.faces), cup)[3]
    centre = frame.points(aside[None], "moving")[0]
    np.testing.assert_allclose(centre, 0.0, atol=0.3 if far_mm == 40.0 else 1.5)
    assert frame.offsets_mm["fixed"] == (0.0, 0.0, 0.0)
    assert any("from what it turns about" in line for line in frame.findings) == (far_mm == 40.0)


def test_a_turned_scan_is_turned_back_and_a_left_one_mirrored():
    """z up and x forwards in the file, as scanners have it: superior is the file's z."""
    to_file = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    frame = analysed(*ball_in_cup(lambda points: points @ to_file.T))[3]
    assert frame.axes == ("y", "z", "x")
    np.testing.assert_allclose(frame.directions(to_file @ POLE), POLE, atol=1e-12)
    mirrored = [checked_mesh(m.name, m.vertices_mm * [1.0, 1.0, -1.0], m.faces[:, ::-1]) for m in ball_in_cup()]
    frame = analysed(*mirrored, side="left")[3]
    assert frame.mirror == "z"
    np.testing.assert_allclose(frame.directions(POLE * [1.0, 1.0, -1.0]), POLE, atol=1e-12)


@pytest.mark.parametrize("to_file", [np.eye(3), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])])
def test_a_femur_flexes_about_its_condyles_wherever_the_scan_s_origin_lies(to_file):
    """Its origin is put where they have their middle, though the dishes that they touch have theirs higher up."""
    far = np.array([300.0, -200.0, 800.0])
    bodies = zip(("femur", "insert"), condyles_in_dishes(), strict=True)
    meshes = [checked_mesh(name, points @ to_file.T + far, faces) for name, (points, faces) in bodies]
    placement, patches, joint, frame = analysed(*meshes)
    assert (joint.kind, placement.together) == ("knee", True)
    np.testing.assert_allclose(frame.points(far[None], "moving")[0], 0.0, atol=1.0)
    anchors = frame.points(patches.anchors_mm, "moving")
    np.testing.assert_allclose(anchors[anchors[:, 2].argsort()], [[0.0, 0.0, -22.0], [0.0, 0.0, 22.0]], atol=1.0)


def test_a_scan_that_stands_askew_is_set_upright():
    """Condyles as far off their axes as scans are: patches lie side by side again, and press down."""
    far, R = np.array([300.0, -200.0, 800.0]), rotation(np.radians([20.0, 8.0, -12.0]))
    bodies = zip(("femur", "insert"), condyles_in_dishes(), strict=True)
    meshes = [checked_mesh(name, points @ R.T + far, faces) for name, (points, faces) in bodies]
    _, _, joint, frame = analysed(*meshes)
    assert (joint.kind, len(joint.patches)) == ("knee", 2)
    placement = Placement(frame.offsets_mm["moving"], frame.rotation_deg, frame.mirror)
    points = far + np.array([np.zeros(3), 10.0 * R[:, 1]])
    middle, above = placement.points(points @ axes_rotation(frame.axes).T)
    np.testing.assert_allclose(middle, 0.0, atol=1.0)
    np.testing.assert_allclose(above - middle, [0.0, 10.0, 0.0], atol=0.3)
    assert any("askew by 2" in line for line in frame.findings)
