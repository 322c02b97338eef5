"""What two meshes tell of a joint: how the bodies meet, where patches part, which axis is which."""

import numpy as np
import pytest
import trimesh

import casadi_contact as cc
from casadi_contact.conventions import rotation
from casadi_contact.geometry.mesh import axes_rotation, checked_mesh, load_mesh
from casadi_contact.geometry.placement import Placement
from casadi_contact.proposal.doubts import coarse_coordinates
from casadi_contact.proposal.frame import frame_of
from casadi_contact.proposal.joint import Joint
from casadi_contact.proposal.meeting import meeting_of
from casadi_contact.proposal.pair import Pair, centre_of_normals
from casadi_contact.proposal.propose import _shell
from casadi_contact.proposal.regions import regions_of
from casadi_contact.proposal.rest import rest_loads
from casadi_contact.proposal.sight import sight_of
from tests.support.meshes import ball_mesh, cap_mesh, groove, sheet_mesh, shell_mesh, slab_mesh, unit
from tests.support.shared_data import shared_file

POLE, DOWN = unit(np.array([0.2, 0.8, 0.5])), np.array([0.0, -1.0, 0.0])


def seen(moving, fixed, **known):
    """Meeting, regions, joint and frame of two meshes, as a proposal finds them one after another."""
    sight = sight_of({"moving": moving, "fixed": fixed}, upright="axes" not in known)
    return sight.meeting, sight.regions, sight.joint, frame_of(sight, **known)


def ball_in_cup(move=lambda points: points):
    ball, cup = ball_mesh(16.0, 2.5), shell_mesh(16.4, 22.0, 2.0, 1.3, POLE)
    return [checked_mesh(name, move(v), f) for name, (v, f) in (("ball", ball), ("cup", cup))]


def button_on_groove(height=22.0, aside=0.0):
    (button, faces), valley = cap_mesh(22.0, 1.5, 0.7), sheet_mesh(40.0, 2.0, groove)
    return checked_mesh("button", button + np.array([0.0, height, aside]), faces), checked_mesh("groove", *valley)


@pytest.mark.parametrize("far", [np.zeros(3), np.array([300.0, -200.0, 800.0])])
def test_a_ball_presses_along_the_pole_of_its_cup_wherever_the_scan_s_origin_lies(far):
    meeting, regions, joint, frame = seen(*ball_in_cup(lambda points: points + far))
    assert meeting.together
    assert meeting.pressing @ POLE > np.cos(np.radians(3.0))
    assert (joint.kind, joint.patches, joint.sensitive) == ("hip", ("contact",), ["F"])
    np.testing.assert_allclose(regions.anchors_mm[0], far, atol=0.5)  # the ball's centre
    assert frame.axes == ("x", "y", "z")
    centre = frame.points(far[None], "moving")[0]
    np.testing.assert_allclose(centre, 0.0, atol=0.6)


@pytest.mark.parametrize("far_mm", [1.0, 40.0])
def test_a_ball_turns_about_its_own_centre_wherever_its_file_s_origin_is(far_mm):
    """Of the 0.4 mm that the cup leaves a turn about an origin far away would take all; a knee's poses stay its files'.

    The cup keeps its file's origin, which torques refer to."""
    ball, cup = (
        checked_mesh("ball", *ball_mesh(16.0, 2.5)),
        checked_mesh("cup", *shell_mesh(16.4, 22.0, 2.0, 1.3, DOWN)),
    )
    aside = np.array([0.0, far_mm, 0.0])
    frame = seen(checked_mesh("ball", ball.vertices_mm + aside, ball.faces), cup)[3]
    centre = frame.points(aside[None], "moving")[0]
    np.testing.assert_allclose(centre, 0.0, atol=0.3 if far_mm == 40.0 else 1.5)
    assert frame.offsets_mm["fixed"] == (0.0, 0.0, 0.0)
    assert any("from what it turns about" in line for line in frame.told) == (far_mm == 40.0)


def test_a_turned_scan_is_turned_back():
    """z up and x forwards in the file, as scanners have it: superior is the file's z."""
    to_file = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    frame = seen(*ball_in_cup(lambda points: points @ to_file.T))[3]
    assert frame.axes == ("y", "z", "x")
    np.testing.assert_allclose(frame.directions(to_file @ POLE), POLE, atol=1e-12)


def test_a_left_ball_and_cup_are_mirrored_into_right_ones():
    mirrored = [checked_mesh(m.name, m.vertices_mm * [1.0, 1.0, -1.0], m.faces[:, ::-1]) for m in ball_in_cup()]
    frame = seen(*mirrored, side="left")[3]
    assert frame.mirror == "z"
    np.testing.assert_allclose(frame.directions(POLE * [1.0, 1.0, -1.0]), POLE, atol=1e-12)


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


def condyles_in_dishes(radius=20.0, dish=32.0, side=22.0):
    """Two balls as a femur's condyles, the middle of both at the origin, just above dishes that are wider."""
    (ball, faces), out = cap_mesh(radius, 1.5, 0.8), np.array([0.0, 0.0, side])

    def dishes(x, z):
        across = np.minimum(x**2 + (np.abs(z) - side) ** 2, 20.0**2)
        return dish - np.sqrt(dish**2 - across) - radius - 0.05

    condyles = np.vstack([ball - out, ball + out]), np.vstack([faces, faces + len(ball)])
    return condyles, sheet_mesh(76.0, 2.0, dishes)


@pytest.mark.parametrize("to_file", [np.eye(3), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])])
def test_a_femur_flexes_about_its_condyles_wherever_the_scan_s_origin_lies(to_file):
    """Its origin is put where they have their middle, though the dishes that they touch have theirs higher up."""
    far = np.array([300.0, -200.0, 800.0])
    bodies = zip(("femur", "insert"), condyles_in_dishes(), strict=True)
    meshes = [checked_mesh(name, points @ to_file.T + far, faces) for name, (points, faces) in bodies]
    meeting, regions, joint, frame = seen(*meshes)
    assert (joint.kind, meeting.together) == ("knee", True)
    np.testing.assert_allclose(frame.points(far[None], "moving")[0], 0.0, atol=1.0)
    anchors = frame.points(regions.anchors_mm, "moving")
    np.testing.assert_allclose(anchors[anchors[:, 2].argsort()], [[0.0, 0.0, -22.0], [0.0, 0.0, 22.0]], atol=1.0)


def test_coordinates_that_single_precision_rounds_coarsely_are_doubted(tmp_path):
    """Binary STL holds single precision: 1e5 mm to steps of 1/128 mm; an OBJ file holds all its digits."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    said = {}
    for far in (0.0, 1e5):
        moved = ball.copy().apply_translation([far, 0.0, 0.0])
        for kind in ("stl", "obj"):
            moved.export(tmp_path / f"ball.{kind}")
            said[far, kind] = coarse_coordinates({"moving": load_mesh(tmp_path / f"ball.{kind}", "mm")}, "mm")
    assert [line.split(":")[0] for line in said.pop((1e5, "stl"))] == ["where the surfaces are to less than 0.0078 mm"]
    assert not any(said.values())


def ball_on_box(triangles_mm=None):
    """As CAD exports a box: twelve triangles, unless they are divided."""
    ball, faces = ball_mesh(15.0, 2.0)
    box = trimesh.creation.box((60.0, 10.0, 60.0))
    if triangles_mm:
        box = box.subdivide_to_size(triangles_mm)
    return checked_mesh("ball", ball + np.array([0.0, 20.0, 0.0]), faces), checked_mesh("box", box.vertices, box.faces)


@pytest.mark.parametrize("triangles_mm", [None, 3.0])
def test_large_flat_triangles_tell_where_a_surface_is_as_small_ones_do(triangles_mm):
    meeting, regions, joint, _ = seen(*ball_on_box(triangles_mm))
    np.testing.assert_allclose(meeting.pressing, [0.0, -1.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(meeting.translation_mm, 0.0, atol=0.2)
    np.testing.assert_allclose(regions.anchors_mm, [[0.0, 20.0, 0.0]], atol=0.3)
    assert (joint.kind, joint.patches) == ("other", ("contact",))


@pytest.mark.parametrize("dish_mm", [45.0, 100.0, 200.0, 400.0])
def test_a_condyle_on_a_dish_has_one_patch_however_shallow_the_dish_is(dish_mm):
    """Turned about the dish's far centre it would roll from one end to the other, to places that are no patches."""
    condyle, faces = cap_mesh(25.0, 1.5, 1.2)
    dish = sheet_mesh(48.0, 2.0, lambda x, z: (x**2 + z**2) / (2.0 * dish_mm) - 25.0)
    _, regions, joint, _ = seen(checked_mesh("condyle", condyle, faces), checked_mesh("dish", *dish))
    assert joint.patches == ("contact",)
    np.testing.assert_allclose(regions.anchors_mm, 0.0, atol=1.0)


def test_an_open_condyle_touches_with_its_outside_and_never_with_its_hollow():
    """Behind an open surface distances are negative however far it is: the way there is no touch."""
    condyle, faces = cap_mesh(25.0, 1.5, 1.2)
    box = trimesh.creation.box((44.0, 8.0, 22.0)).subdivide_to_size(1.5)
    pair = Pair.of(checked_mesh("condyle", condyle, faces), checked_mesh("insert", box.vertices, box.faces))
    down = np.array([0.0, -1.0, 0.0])
    np.testing.assert_allclose(pair.dropped(np.eye(3), np.zeros(3), down), [0.0, 29.0, 0.0], atol=0.1)
    assert pair.dropped(np.eye(3), np.zeros(3), -down) is None


def test_an_open_surface_inside_out_is_refused():
    ball, box = ball_on_box(3.0)
    top = box.part(box.normals[:, 1] > 0.9)
    assert meeting_of(Pair.of(ball, top)).together
    inside_out = checked_mesh("top", top.vertices_mm, top.faces[:, ::-1])
    with pytest.raises(ValueError, match="the fixed surface faces away from the moving one"):
        meeting_of(Pair.of(ball, inside_out))


def test_an_open_condyle_inside_out_is_refused_and_a_hollow_cup_on_a_ball_is_none():
    condyle, faces = cap_mesh(25.0, 1.5, 1.2)
    box = trimesh.creation.box((44.0, 8.0, 22.0)).subdivide_to_size(1.5)
    insert = checked_mesh("insert", box.vertices, box.faces)
    assert len(seen(checked_mesh("condyle", condyle, faces), insert)[2].patches) == 1
    with pytest.raises(ValueError, match=r"over \d+ mm² with its inside out, expected its outside towards it: turn"):
        seen(checked_mesh("condyle", condyle, faces[:, ::-1]), insert)
    cup, faces = cap_mesh(16.5, 1.5, 1.2)  # a bowl: upside down, and its inside out as it was, it covers the ball
    ball = checked_mesh("ball", *ball_mesh(16.0, 2.5))
    assert len(seen(checked_mesh("cup", cup * [1.0, -1.0, 1.0], faces), ball)[2].patches) == 1


def placed(frame, body, points):
    """Points (n, 3) of a body's file where the scene's placement takes them."""
    placement = Placement(frame.offsets_mm[body], frame.rotation_deg, frame.mirror)
    return placement.points(points @ axes_rotation(frame.axes).T)


@pytest.mark.parametrize(("turn_deg", "turned"), [([-10.0, 3.0, 7.0], False), ([20.0, 8.0, -12.0], True)])
def test_a_scan_that_stands_askew_is_set_upright(turn_deg, turned):
    """Condyles as far off their axes as scans are: patches lie side by side again, and press down."""
    far, R = np.array([300.0, -200.0, 800.0]), rotation(np.radians(turn_deg))
    bodies = zip(("femur", "insert"), condyles_in_dishes(), strict=True)
    meshes = [checked_mesh(name, points @ R.T + far, faces) for name, (points, faces) in bodies]
    _, _, joint, frame = seen(*meshes)
    assert (joint.kind, len(joint.patches)) == ("knee", 2)
    assert any(frame.rotation_deg) == turned
    if turned:
        middle, above = placed(frame, "moving", far + np.array([np.zeros(3), 10.0 * R[:, 1]]))
        np.testing.assert_allclose(middle, 0.0, atol=1.0)
        np.testing.assert_allclose(above - middle, [0.0, 10.0, 0.0], atol=0.3)
        assert any("askew by 2" in line for line in frame.told)


def test_a_groove_stands_upright_though_the_scan_has_the_button_nearer_to_one_facet():
    """That facet alone faces 24 degrees off the direction in which both are pressed."""
    meeting, _, joint, frame = seen(*button_on_groove(24.0, aside=3.0))
    assert meeting.together
    assert (joint.kind, frame.rotation_deg) == ("patella", (0.0, 0.0, 0.0))


def test_given_axes_are_kept_as_they_are():
    R = rotation(np.radians([20.0, 8.0, -12.0]))
    meshes = [checked_mesh("body", points @ R.T, faces) for points, faces in condyles_in_dishes()]
    frame = seen(*meshes, axes=("x", "y", "z"))[3]
    assert frame.rotation_deg == (0.0, 0.0, 0.0)


def revolved(radius, half_angle, half_width):
    """A surface of revolution about the z axis, its middle at the bottom, seen from the axis: vertices, faces."""
    points, faces = sheet_mesh(2.0, 0.04)
    angle, z = half_angle * points[:, 0], half_width * points[:, 2]
    return np.stack([radius(z) * np.sin(angle), -radius(z) * np.cos(angle), z], axis=1), faces


def test_a_spool_that_bears_on_both_sides_of_its_notch_has_one_patch():
    """As at an elbow: flexion turns it about its axis, which shifts no load from one side to the other."""
    spool, faces = revolved(lambda z: 10.0 + 0.03 * z**2, 2.9, 11.0)
    notch = checked_mesh("notch", *revolved(lambda z: 10.35 + 0.0275 * z**2, 1.4, 10.0))
    sight = sight_of({"moving": checked_mesh("spool", spool, faces[:, ::-1]), "fixed": notch})
    assert sight.places == 2
    assert (sight.joint.kind, sight.joint.patches) == ("other", ("contact",))
    assert len(sight.regions.anchors_mm) == 1
    assert sight.joint.sensitive_pose == ["tx", "ty", "tz"]


def test_a_spool_turns_about_the_axis_of_its_file():
    """Its normals meet in no point: about the one nearest to all of them flexion would move it across its notch."""
    spool, faces = revolved(lambda z: 9.0 + 0.466 * np.sqrt(z**2 + 2.0), 2.6, 9.0)
    notch = checked_mesh("notch", *revolved(lambda z: 9.3 + 0.45 * np.sqrt(z**2 + 2.0), 1.5, 8.0))
    _, _, joint, frame = seen(checked_mesh("spool", spool, faces[:, ::-1]), notch)
    assert not joint.pressing
    assert frame.offsets_mm["moving"] == (0.0, 0.0, 0.0)


def flat_backed(side_mm, back_mm, height):
    """A closed body whose top is y = height(x, z) over a square, and whose back is a plane."""
    points, faces = slab_mesh(*sheet_mesh(side_mm, 1.0, height), 1.0)
    points[len(points) // 2 :, 1] = back_mm
    return points, faces


def test_parts_with_flat_backs_meet_with_the_sides_that_bear():
    """As of a disc prosthesis: a dome in a trough, each in its own frame. Their backs would meet over a larger area."""
    dome, faces = flat_backed(20.0, 5.0, lambda x, z: np.sqrt(16.0**2 - x**2 - z**2))
    moving = checked_mesh("dome", dome * [1.0, -1.0, 1.0] + np.array([0.0, 60.0, 0.0]), faces[:, ::-1])
    fixed = checked_mesh("trough", *flat_backed(24.0, -4.0, lambda x, z: 16.3 - np.sqrt(16.3**2 - z**2) + 0.0 * x))
    meeting = meeting_of(Pair.of(moving, fixed))
    np.testing.assert_array_equal(meeting.pressing, DOWN)
    assert not meeting.together


def test_plates_meet_with_their_planes():
    """No curved side is there to meet: edges do not count for one."""
    plate, faces = slab_mesh(*sheet_mesh(16.0, 1.0), 3.0)
    moving = checked_mesh("moving", plate + np.array([0.0, 40.0, 0.0]), faces)
    meeting = meeting_of(Pair.of(moving, checked_mesh("fixed", plate, faces)))
    np.testing.assert_array_equal(np.abs(meeting.pressing), [0.0, 1.0, 0.0])


def test_a_saddle_in_a_saddle_is_no_ball_in_a_cup():
    """As at the base of a thumb: it is hollow one way only, though all of it is seen from one point."""
    fixed, (points, faces) = (sheet_mesh(side, 1.0, lambda x, z: x**2 / 18.0 - z**2 / 22.0) for side in (12.0, 11.0))
    moving = checked_mesh("moving", points, faces[:, ::-1])
    _, regions, joint, frame = seen(moving, checked_mesh("fixed", *fixed), side="left")
    assert not regions.hollow
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


def test_a_force_that_turns_presses_down_where_the_scene_names_no_other_way():
    loads = rest_loads(cc.load_scene("hip"), Joint("other", ("contact",), ""), 100.0)
    assert loads == {"Fx": 0.0, "Fy": -100.0, "Fz": 0.0}


def test_lines_along_the_normals_of_a_sphere_meet_at_its_centre_and_those_of_a_plane_nowhere():
    normals = rotation(np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3)))[:, :, 1]
    centre = np.array([3.0, -2.0, 1.0])
    np.testing.assert_allclose(centre_of_normals(centre + 20.0 * normals, normals, np.ones(200)), centre, atol=0.3)
    flat = np.random.default_rng(1).uniform(-5.0, 5.0, (200, 3)) * [1.0, 0.0, 1.0]
    up = np.tile([0.0, 1.0, 0.0], (200, 1))
    np.testing.assert_allclose(centre_of_normals(flat, up, np.ones(200)), flat.mean(axis=0), atol=1e-9)


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
