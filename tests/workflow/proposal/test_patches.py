"""Where two bodies touch: patches, their kind, and what joint they make."""

import numpy as np
import pytest

from casadi_contact.geometry.mesh import checked_mesh, load_mesh
from casadi_contact.workflow.proposal.joint_geometry import joint_geometry
from casadi_contact.workflow.proposal.propose import _shell
from tests.support.joint_meshes import POLE, analysed, button_on_groove
from tests.support.meshes import ball_mesh, cap_mesh, sheet_mesh, shell_mesh, slab_mesh, unit
from tests.support.shared_data import shared_file

GROUND = (
    np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0]]) * 300.0 - [150.0, 0.0, 150.0],
    (np.array([[0, 1, 2], [1, 3, 2]])),
)


@pytest.mark.parametrize("height", [22.0, 60.0])
def test_a_button_rests_on_both_facets_of_its_groove(height):
    """Whether the files place the bodies together, or each about its own origin."""
    placement, patches, joint, frame = analysed(*button_on_groove(height))
    assert placement.together == (height == 22.0)
    np.testing.assert_allclose(placement.pressing, [0.0, -1.0, 0.0], atol=0.02)
    assert (joint.kind, joint.patches, joint.pressing) == ("patella", ("med", "lat"), "+x")
    assert patches.axis == 2
    np.testing.assert_allclose(patches.cuts_mm, [0.0], atol=1.0)
    np.testing.assert_allclose(frame.directions(placement.pressing), [1.0, 0.0, 0.0], atol=0.02)


def test_the_two_condyles_of_a_finger_are_told_apart_on_its_own_scale():
    """Balls of 4 mm in dishes of 6, 4 mm from the middle: in between the gap is less than a knee's in one place."""
    (ball, faces), out = cap_mesh(4.0, 0.5, 0.8), np.array([0.0, 0.0, 4.0])
    condyles = np.vstack([ball - out, ball + out]), np.vstack([faces, faces + len(ball)])

    def dishes(x, z):
        return 6.0 - np.sqrt(6.0**2 - np.minimum(x**2 + (np.abs(z) - 4.0) ** 2, 16.0))

    moving = checked_mesh("condyles", condyles[0] + np.array([0.0, 9.0, 0.0]), condyles[1])
    _, patches, joint, _ = analysed(moving, checked_mesh("dishes", *sheet_mesh(14.0, 0.5, dishes)))
    np.testing.assert_allclose(patches.cuts_mm, [0.0], atol=0.5)
    assert (joint.kind, joint.patches, joint.sensitive) == ("other", ("p1", "p2"), ["-Fy_p1", "-Fy_p2"])


@pytest.mark.parametrize("dish_mm", [45.0, 400.0])
def test_a_condyle_on_a_dish_has_one_patch_however_shallow_the_dish_is(dish_mm):
    """Turned about the dish's far centre it would roll from one end to the other, to places that are no patches."""
    condyle, faces = cap_mesh(25.0, 1.5, 1.2)
    dish = sheet_mesh(48.0, 2.0, lambda x, z: (x**2 + z**2) / (2.0 * dish_mm) - 25.0)
    _, patches, joint, _ = analysed(checked_mesh("condyle", condyle, faces), checked_mesh("dish", *dish))
    assert joint.patches == ("contact",)
    np.testing.assert_allclose(patches.anchors_mm, 0.0, atol=1.0)


SOLES = {
    "flat": lambda x, z: 0.0 * x,
    "without heel": lambda x, z: np.maximum(x - 70.0, 0.0) ** 2 / 240.0 + 3.0 * (z / 47.0) ** 2,
    "with heel, rough": lambda x, z: (
        12.0 / (1.0 + np.exp(-x - 50.0)) / (1.0 + np.exp(x / 8.0)) + 0.1 * np.sin(7 * x * z)
    ),
}


@pytest.mark.parametrize(("kind", "first"), [*zip(SOLES, ("sole", "sole", "ground"), strict=True)])
def test_a_sole_rolls_over_the_ground_as_one_patch_whichever_is_given_first(kind, first):
    sheet, faces = sheet_mesh(20.0, 1.0, lambda x, z: -SOLES[kind](13.0 * x, 4.7 * z))
    sole, faces = slab_mesh(sheet * [13.0, 1.0, 4.7], faces, 30.0)
    bodies = checked_mesh("sole", sole * [1.0, -1.0, -1.0], faces), checked_mesh("ground", *slab_mesh(*GROUND, 20.0))
    _, patches, joint, _ = analysed(*(bodies if first == "sole" else bodies[::-1]))
    assert (joint.kind, joint.sensitive) == ("other", ["-Fy"])
    assert patches.plane == ("fixed" if first == "sole" else "moving")


def test_condyles_on_a_flat_tray_are_a_knee():
    (ball, faces), out = cap_mesh(20.0, 2.0, 0.8), np.array([0.0, 0.0, 24.0])
    condyles = np.vstack([ball - out, ball + out]), np.vstack([faces, faces + len(ball)])
    moving = checked_mesh("condyles", condyles[0] + np.array([0.0, 20.0, 0.0]), condyles[1])
    _, patches, joint, _ = analysed(moving, checked_mesh("tray", *sheet_mesh(70.0, 2.5)))
    assert (joint.kind, joint.patches, patches.plane) == ("knee", ("med", "lat"), "fixed")


@pytest.mark.parametrize(("kind", "noise_mm"), [(None, 0.0), ("hip", 0.25)])
def test_a_socket_is_one_patch_whatever_pit_and_notch_it_has(kind, noise_mm):
    """What bears of an acetabulum is a horseshoe about one centre; a rough scan's joint has to be named."""
    ball, (socket, faces) = ball_mesh(25.0, 2.5), shell_mesh(25.3, 32.0, 1.5, 1.5, POLE)
    across, aside = unit(np.cross(POLE, [0.0, 0.0, 1.0])), np.cross(POLE, unit(np.cross(POLE, [0.0, 0.0, 1.0])))
    pit, notch = socket @ POLE > 25.3 * np.cos(0.56), (socket @ across > 0.0) & (np.abs(socket @ aside) < 12.0)
    socket[(np.linalg.norm(socket, axis=1) < 26.0) & (pit | notch)] *= 29.3 / 25.3
    socket += noise_mm * np.random.default_rng(0).standard_normal((len(socket), 1)) * unit(socket)
    meshes = {"moving": checked_mesh("ball", *ball), "fixed": checked_mesh("socket", socket, faces)}
    geometry = joint_geometry(meshes, kind)
    assert geometry.patches.hollow
    assert (geometry.joint.kind, geometry.joint.sensitive) == ("hip", ["F"])


def test_a_saddle_in_a_saddle_is_no_ball_in_a_cup():
    """As at the base of a thumb: it is hollow one way only, though all of it is analysed from one point."""
    fixed, (points, faces) = (sheet_mesh(side, 1.0, lambda x, z: x**2 / 18.0 - z**2 / 22.0) for side in (12.0, 11.0))
    moving = checked_mesh("moving", points, faces[:, ::-1])
    _, patches, joint, frame = analysed(moving, checked_mesh("fixed", *fixed), side="left")
    assert not patches.hollow
    assert joint.kind == "other"
    assert any("--side left" in question for question in frame.open_questions)


def test_both_sides_of_a_saddle_shell_count_and_the_outer_one_of_a_cap():
    saddle, faces = slab_mesh(*sheet_mesh(14.0, 0.5, lambda x, z: z**2 / 22.0 - x**2 / 20.0), 1.0)
    fixed = checked_mesh("fixed", *sheet_mesh(16.0, 0.5, lambda x, z: x**2 / 26.0 - z**2 / 18.0))
    moving = checked_mesh("moving", saddle * [1.0, -1.0, 1.0], faces[:, ::-1])
    assert _shell(joint_geometry({"moving": moving, "fixed": fixed})) == "whole"
    cap, faces = shell_mesh(14.5, 16.0, 1.0, 1.0, [0.0, -1.0, 0.0])
    moving = checked_mesh("moving", cap + np.array([0.0, 16.0, 0.0]), faces)
    assert _shell(joint_geometry({"moving": moving, "fixed": checked_mesh("plate", *sheet_mesh(16.0, 1.0))})) == "outer"


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
    placement, patches, joint, frame = analysed(*meshes, side="right")
    assert placement.together == together
    assert (joint.kind, joint.patches, joint.sensitive) == ("knee", ("med", "lat"), ["-Fy_med", "-Fy_lat"])
    assert frame.axes == axes
    assert len(patches.cuts_mm) == 1
    assert abs(patches.cuts_mm[0]) < 3.0
    anchors = frame.points(patches.anchors_mm, "moving")
    assert np.abs(np.abs(anchors[:, 2]) - 22.0).max() < 5.0  # condyles, medial and lateral
