"""Where two bodies touch: patches, their kind, and what joint they make."""

import numpy as np
import pytest

from casadi_contact.geometry.mesh import checked_mesh, load_mesh
from casadi_contact.workflow.proposal.meeting import meeting_of
from casadi_contact.workflow.proposal.pair import Pair, axis_of_normals
from casadi_contact.workflow.proposal.propose import _shell
from casadi_contact.workflow.proposal.regions import regions_of
from casadi_contact.workflow.proposal.sight import sight_of
from tests.support.joint_meshes import POLE, ball_in_cup, button_on_groove, medial_pivot, revolved, seen
from tests.support.meshes import ball_mesh, cap_mesh, sheet_mesh, shell_mesh, slab_mesh, turn_to, unit
from tests.support.shared_data import shared_file


def test_a_ball_is_round_where_it_touches_and_a_cup_on_a_ball_is_hollow():
    ball, cup = ball_in_cup()
    for moving, fixed, is_round in ((ball, cup, True), (cup, ball, False)):
        pair = Pair.of(moving, fixed)
        assert regions_of(pair, meeting_of(pair)).round == is_round


@pytest.mark.parametrize("height", [22.0, 60.0])
def test_a_button_rests_on_both_facets_of_its_groove(height):
    """Whether the files place the bodies together, or each about its own origin."""
    meeting, regions, joint, frame = seen(*button_on_groove(height))
    assert meeting.together == (height == 22.0)
    np.testing.assert_allclose(meeting.pressing, [0.0, -1.0, 0.0], atol=0.02)
    assert (joint.kind, joint.patches, joint.pressing) == ("patella", ("med", "lat"), "+x")
    assert regions.axis == 2
    np.testing.assert_allclose(regions.cuts_mm, [0.0], atol=1.0)
    np.testing.assert_allclose(frame.directions(meeting.pressing), [1.0, 0.0, 0.0], atol=0.02)


def test_the_two_condyles_of_a_finger_are_told_apart_on_its_own_scale():
    """Balls of 4 mm in dishes of 6, 4 mm from the middle: in between the gap is less than a knee's in one place."""
    (ball, faces), out = cap_mesh(4.0, 0.5, 0.8), np.array([0.0, 0.0, 4.0])
    condyles = np.vstack([ball - out, ball + out]), np.vstack([faces, faces + len(ball)])

    def dishes(x, z):
        return 6.0 - np.sqrt(6.0**2 - np.minimum(x**2 + (np.abs(z) - 4.0) ** 2, 16.0))

    moving = checked_mesh("condyles", condyles[0] + np.array([0.0, 9.0, 0.0]), condyles[1])
    _, regions, joint, _ = seen(moving, checked_mesh("dishes", *sheet_mesh(14.0, 0.5, dishes)))
    np.testing.assert_allclose(regions.cuts_mm, [0.0], atol=0.5)
    assert (joint.kind, joint.patches, joint.sensitive) == ("other", ("p1", "p2"), ["-Fy_p1", "-Fy_p2"])


def test_a_joint_of_small_pieces_far_apart_carries_what_its_largest_piece_can():
    """The facets of a vertebra span as much as a knee, and carry less; a file in fragments is one surface."""
    (facet, faces), apart = sheet_mesh(14.0, 1.0), np.array([0.0, 0.0, 40.0])
    two = checked_mesh("facets", np.vstack([facet, facet + apart]), np.vstack([faces, faces + len(facet)]))
    one = checked_mesh("plate", *sheet_mesh(54.0, 2.0))
    ball = checked_mesh("ball", *ball_mesh(8.0, 1.0))
    assert (Pair.of(ball, two).scale, Pair.of(ball, two).carrying) == (1.0, pytest.approx(14.0 / 28.0))
    assert Pair.of(ball, one).carrying == 1.0
    fragments = [facet + 14.5 * np.array([i, 0.0, j]) for i in range(4) for j in range(4)]
    shifted = np.vstack([faces + k * len(facet) for k in range(16)])
    assert Pair.of(ball, checked_mesh("fragments", np.vstack(fragments), shifted)).carrying == 1.0


@pytest.mark.parametrize("dish_mm", [45.0, 100.0, 200.0, 400.0])
def test_a_condyle_on_a_dish_has_one_patch_however_shallow_the_dish_is(dish_mm):
    """Turned about the dish's far centre it would roll from one end to the other, to places that are no patches."""
    condyle, faces = cap_mesh(25.0, 1.5, 1.2)
    dish = sheet_mesh(48.0, 2.0, lambda x, z: (x**2 + z**2) / (2.0 * dish_mm) - 25.0)
    _, regions, joint, _ = seen(checked_mesh("condyle", condyle, faces), checked_mesh("dish", *dish))
    assert joint.patches == ("contact",)
    np.testing.assert_allclose(regions.anchors_mm, 0.0, atol=1.0)


def test_a_spool_that_bears_on_both_sides_of_its_notch_has_one_patch():
    """As at an elbow: flexion turns it about its axis, which shifts no load from one side to the other."""
    spool, faces = revolved(lambda z: 10.0 + 0.03 * z**2, 2.9, 11.0)
    notch = checked_mesh("notch", *revolved(lambda z: 10.35 + 0.0275 * z**2, 1.4, 10.0))
    sight = sight_of({"moving": checked_mesh("spool", spool, faces[:, ::-1]), "fixed": notch})
    assert sight.places == 2
    assert (sight.joint.kind, sight.joint.patches) == ("other", ("contact",))
    assert len(sight.regions.anchors_mm) == 1
    assert sight.joint.sensitive_pose == ["tx", "ty", "tz"]
    assert not sight.regions.hollow
    np.testing.assert_allclose(sight.regions.cup_mm, 0.0, atol=0.1)  # on its axis, from where its walls are seen


def test_the_axis_of_a_surface_of_revolution_is_the_one_it_turns_about_in_itself():
    points, faces = revolved(lambda z: 10.0 + 0.05 * z**2, 1.3, 9.0)
    turn, aside = turn_to([0.3, -0.5, 0.8]), np.array([40.0, -7.0, 3.0])
    mesh = checked_mesh("notch", points @ turn.T + aside, faces)
    place, way = axis_of_normals(mesh.corners_mm.mean(axis=1), mesh.normals, mesh.areas_mm2)
    assert abs(way @ turn[:, 2]) > 1.0 - 1e-6
    np.testing.assert_allclose(np.cross(place - aside, way), 0.0, atol=0.02)


@pytest.mark.parametrize(("asked", "noise_mm"), [(None, 0.0), ("hip", 0.25)])
def test_a_socket_is_one_patch_whatever_pit_and_notch_it_has(asked, noise_mm):
    """As an acetabulum's: what bears is a horseshoe, and all of it lies about one centre. A rough scan's lies so far
    from one that the joint has to be named."""
    ball, (socket, faces) = ball_mesh(25.0, 2.5), shell_mesh(25.3, 32.0, 1.5, 1.5, POLE)
    across, aside = unit(np.cross(POLE, [0.0, 0.0, 1.0])), np.cross(POLE, unit(np.cross(POLE, [0.0, 0.0, 1.0])))
    pit, notch = socket @ POLE > 25.3 * np.cos(0.56), (socket @ across > 0.0) & (np.abs(socket @ aside) < 12.0)
    socket[(np.linalg.norm(socket, axis=1) < 26.0) & (pit | notch)] *= 29.3 / 25.3
    socket += noise_mm * np.random.default_rng(0).standard_normal((len(socket), 1)) * unit(socket)
    meshes = {"moving": checked_mesh("ball", *ball), "fixed": checked_mesh("socket", socket, faces)}
    sight = sight_of(meshes, asked)
    assert sight.regions.hollow
    assert (sight.joint.kind, sight.joint.sensitive, sight.places) == ("hip", ["F"], 1)


@pytest.mark.parametrize(("asked", "sensitive"), [(None, ["-Fy"]), ("hip", ["F"])])
def test_a_hip_that_is_asked_for_may_have_a_shallow_socket(asked, sensitive):
    ball, faces = ball_mesh(25.0, 2.5)
    dish = checked_mesh("dish", *sheet_mesh(24.0, 1.5, lambda x, z: -np.sqrt(26.0**2 - x**2 - z**2)))
    meshes = {"moving": checked_mesh("ball", ball - [0.0, 0.95, 0.0], faces), "fixed": dish}
    assert sight_of(meshes, asked).joint.sensitive == sensitive


def test_a_saddle_in_a_saddle_is_no_ball_in_a_cup():
    """As at the base of a thumb: it is hollow one way only, though all of it is seen from one point."""
    fixed, (points, faces) = (sheet_mesh(side, 1.0, lambda x, z: x**2 / 18.0 - z**2 / 22.0) for side in (12.0, 11.0))
    moving = checked_mesh("moving", points, faces[:, ::-1])
    _, regions, joint, frame = seen(moving, checked_mesh("fixed", *fixed), side="left")
    assert not regions.hollow
    assert regions.cup_mm is None, "nor a notch with walls"
    assert joint.kind == "other"
    assert any("what left means here" in said for said in frame.untold)


def test_both_sides_of_a_saddle_shell_count_and_the_outer_one_of_a_cap():
    saddle, faces = slab_mesh(*sheet_mesh(14.0, 0.5, lambda x, z: z**2 / 22.0 - x**2 / 20.0), 1.0)
    fixed = checked_mesh("fixed", *sheet_mesh(16.0, 0.5, lambda x, z: x**2 / 26.0 - z**2 / 18.0))
    moving = checked_mesh("moving", saddle * [1.0, -1.0, 1.0], faces[:, ::-1])
    assert _shell(sight_of({"moving": moving, "fixed": fixed})) == "whole"
    cap, faces = shell_mesh(14.5, 16.0, 1.0, 1.0, [0.0, -1.0, 0.0])
    moving = checked_mesh("moving", cap + np.array([0.0, 16.0, 0.0]), faces)
    assert _shell(sight_of({"moving": moving, "fixed": checked_mesh("plate", *sheet_mesh(16.0, 1.0))})) == "outer"


@pytest.mark.parametrize(
    ("moving", "fixed", "axes", "together"),
    [
        ("dm_tka/femoral_component.stl", "dm_tka/tibial_insert.stl", ("x", "y", "z"), False),
        ("jam/femur_cartilage.obj", "jam/tibia_cartilage.stl", ("-x", "y", "-z"), True),
    ],
)
def test_real_knees_have_two_patches_and_flex_backwards(moving, fixed, axes, together):
    """Axes as the files' sources state them: implant as ours, natural knee anterior, superior, lateral."""
    meshes = [load_mesh(shared_file(f"data/{name}"), "m") for name in (moving, fixed)]
    meeting, regions, joint, frame = seen(*meshes, side="right")
    assert meeting.together == together
    assert (joint.kind, joint.patches, joint.sensitive) == ("knee", ("med", "lat"), ["-Fy_med", "-Fy_lat"])
    assert frame.axes == axes
    assert len(regions.cuts_mm) == 1
    assert abs(regions.cuts_mm[0]) < 3.0
    anchors = frame.points(regions.anchors_mm, "moving")
    assert np.abs(np.abs(anchors[:, 2]) - 22.0).max() < 5.0  # condyles, medial and lateral


def test_a_small_place_beside_a_close_socket_is_told_and_parted_where_a_knee_is_asked_for():
    """A medial pivot knee."""
    meshes = dict(zip(("moving", "fixed"), medial_pivot(), strict=True))
    alone, asked = sight_of(meshes), sight_of(meshes, "knee")
    assert alone.joint.patches == ("contact",)
    assert alone.regions.passed_over
    assert asked.joint.patches == ("med", "lat")
    assert asked.regions.axis == 2
    np.testing.assert_allclose(asked.regions.cuts_mm, [-3.0], atol=5.0)
    np.testing.assert_allclose(np.sort(asked.regions.anchors_mm[:, 2]), [-22.0, 22.0], atol=1.5)


@pytest.mark.parametrize("meshes", [ball_in_cup, button_on_groove])
def test_nothing_is_passed_over_where_there_is_one_place_or_two(meshes):
    assert not seen(*meshes())[1].passed_over
