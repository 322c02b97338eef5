"""How two bodies meet: along which direction they press each other, and with which sides."""

import numpy as np
import pytest
import trimesh

from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.workflow.proposal.pair import Pair, contact_placement
from tests.support.joint_meshes import DOWN, POLE, analysed, ball_in_cup
from tests.support.meshes import ball_mesh, cap_mesh, sheet_mesh, slab_mesh


@pytest.mark.parametrize("far", [np.zeros(3), np.array([300.0, -200.0, 800.0])])
def test_a_ball_presses_along_the_pole_of_its_cup_wherever_the_scan_s_origin_lies(far):
    placement, patches, joint, frame = analysed(*ball_in_cup(lambda points: points + far))
    assert placement.together
    assert placement.pressing @ POLE > np.cos(np.radians(3.0))
    assert (joint.kind, joint.patches, joint.sensitive) == ("hip", ("contact",), ["F"])
    np.testing.assert_allclose(patches.anchors_mm[0], far, atol=0.5)  # the ball's centre
    assert frame.axes == ("x", "y", "z")
    centre = frame.points(far[None], "moving")[0]
    np.testing.assert_allclose(centre, 0.0, atol=0.6)


def test_open_surfaces_touch_with_their_outside_and_are_refused_inside_out():
    """Behind an open surface distances are negative however far it is: the way there is no touch."""
    condyle, faces = cap_mesh(25.0, 1.5, 1.2)
    box = trimesh.creation.box((44.0, 8.0, 22.0)).subdivide_to_size(1.5)
    insert, outside = checked_mesh("insert", box.vertices, box.faces), checked_mesh("condyle", condyle, faces)
    pair, down = Pair.of(outside, insert), np.array([0.0, -1.0, 0.0])
    np.testing.assert_allclose(pair.dropped(np.eye(3), np.zeros(3), down), [0.0, 29.0, 0.0], atol=0.1)
    assert pair.dropped(np.eye(3), np.zeros(3), -down) is None
    assert len(analysed(outside, insert)[2].patches) == 1
    with pytest.raises(ValueError, match="inside out"):
        analysed(checked_mesh("condyle", condyle, faces[:, ::-1]), insert)
    top = insert.part(insert.normals[:, 1] > 0.9)
    ball, ball_faces = ball_mesh(15.0, 2.0)
    ball = checked_mesh("ball", ball + np.array([0.0, 19.0, 0.0]), ball_faces)
    assert contact_placement(Pair.of(ball, top)).together
    with pytest.raises(ValueError, match="faces away"):
        contact_placement(Pair.of(ball, checked_mesh("top", top.vertices_mm, top.faces[:, ::-1])))


def test_a_hollow_cup_on_a_ball_is_not_taken_for_inside_out():
    """A bowl upside down: its inside out as it was, it covers the ball."""
    cup, faces = cap_mesh(16.5, 1.5, 1.2)
    ball = checked_mesh("ball", *ball_mesh(16.0, 2.5))
    assert len(analysed(checked_mesh("cup", cup * [1.0, -1.0, 1.0], faces), ball)[2].patches) == 1


def flat_backed(side_mm, back_mm, height):
    """A closed body whose top is y = height(x, z) over a square, and whose back is a plane."""
    points, faces = slab_mesh(*sheet_mesh(side_mm, 1.0, height), 1.0)
    points[len(points) // 2 :, 1] = back_mm
    return points, faces


def test_parts_with_flat_backs_meet_with_the_sides_that_bear():
    """As of a disc prosthesis: a dome in a trough, each in its own frame. Their backs would meet over a larger area."""
    dome, faces = flat_backed(20.0, 5.0, lambda x, z: np.sqrt(16.0**2 - x**2 - z**2))
    moving = checked_mesh("dome", dome * [1.0, -1.0, 1.0] + np.array([0.0, 60.0, 0.0]), faces[:, ::-1])
    trough = flat_backed(24.0, -4.0, lambda x, z: 16.3 - np.sqrt(16.3**2 - z**2) + 0.0 * x)
    placement = contact_placement(Pair.of(moving, checked_mesh("trough", *trough)))
    np.testing.assert_array_equal(placement.pressing, DOWN)
    assert not placement.together
