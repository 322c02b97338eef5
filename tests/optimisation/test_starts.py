"""Where optimisation begins: in the middle of what was learned, with every side of the joint in contact."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import POSE_NAMES, rotation
from casadi_contact.optimisation.starts import middle_pose, press_together, shares

SIDES = ("Fy_med", "Fy_lat")
FREE = ("tx", "ty", "tz", "rx")
DOWN_N = 1000.0


def pressed(knee, down_n, tx_nmm=0.0):
    """Loads (2,) [N] of both sides of a knee that begins under a force and a torque."""
    rest, loads = middle_pose(knee)[None], np.array([[0.0, -down_n, 0.0, tx_nmm, 0.0, 0.0]])
    return -knee(press_together(knee, rest, rest, loads, FREE), SIDES)[0]


@pytest.mark.parametrize("tx_nmm", [-90_000.0, 90_000.0], ids=["beyond one condyle", "beyond the other"])
@pytest.mark.parametrize("down_n", [DOWN_N, 30.0])
def test_a_force_beyond_both_condyles_leaves_each_side_its_least_force(knee, tx_nmm, down_n):
    least_n = min(20.0, 0.5 * down_n)
    np.testing.assert_allclose(np.sort(pressed(knee, down_n, tx_nmm)), [least_n, down_n - least_n], atol=2.0)


@pytest.mark.parametrize("down_n", [0.1, 1.0, 2.0])
def test_both_sides_touch_however_light_the_load(knee, down_n):
    """Out of contact a load in newtons has no slope, and an optimiser that begins there stays."""
    assert (pressed(knee, down_n) > 0.0).all()


def test_a_force_between_the_condyles_is_shared_by_its_place(knee):
    medial, lateral = knee.scene.anchors_mm[:, 2]
    got = pressed(knee, DOWN_N, (0.7 * medial + 0.3 * lateral) * DOWN_N)
    np.testing.assert_allclose(got, [0.7 * DOWN_N, 0.3 * DOWN_N], atol=2.0)


@pytest.mark.parametrize("sensitive", [["-Fy_med", "-Fy_lat"], ["+Fx_med", "+Fx_lat"], ["-Fy_med", "+Fx_lat"]])
def test_two_patches_share_the_loads_that_they_make_whatever_presses_them(sensitive):
    scene = cc.load_scene("knee", sensitive=sensitive, sensitive_pose=["ty", "tx"])
    along = np.array([normal.direction for normal in scene.controllable_normal_loads])
    sizes = np.array([[700.0, 200.0], [50.0, 900.0]])
    loads = np.hstack([sizes @ along, sizes @ np.cross(scene.anchors_mm, along)])
    np.testing.assert_allclose(np.transpose(shares(scene, loads)), sizes)


def test_a_ball_whose_origin_is_far_begins_in_its_cup_however_it_is_turned():
    """A ball 0.3 mm smaller than its cup, 40 mm from its origin; the middle of what was learned lies 0.5 mm above."""
    hip, far, free_mm = cc.load_scene("hip"), np.array([3.0, 40.0, -2.0]), 0.3
    scene = replace(hip, anchors_mm=far[None])
    start, down = scene.start_pose, np.array([0.0, -1.0, 0.0])
    cup_mm = start[:3] + far - 0.4 * down

    def off(poses):
        moved = poses[:, :3] + rotation(poses[:, 3:]) @ far - cup_mm
        return moved, np.linalg.norm(moved, axis=1, keepdims=True)

    def wrenches(poses):
        moved, distance = off(poses)
        size_n = 3e4 * np.maximum(distance - free_mm, 0.0) ** 2
        return np.concatenate([size_n * moved / np.maximum(distance, 1e-9), 0.0 * moved], axis=1)[:, None]

    model = symbolic(cc.CallableModel(scene, wrenches, lambda poses: free_mm - off(poses)[1]))
    middle = start - np.pad(0.5 * down, (0, 3))
    widths = (6.0, 1.0, 6.0, 0.2, 0.2, 0.2)
    model.record["pose_range"] = {name: (m - w, m + w) for name, m, w in zip(POSE_NAMES, middle, widths, strict=True)}
    turned = {"rx": [0.05, 0.0, -0.05], "ry": [0.0, 0.03, 0.0], "rz": [-0.12, 0.0, 0.12]}
    wanted = {"Fx": [20.0, -30.0, 10.0], "Fy": [-500.0, -90.0, -700.0], "Fz": [10.0, 0.0, -40.0]}
    frames = cc.ContactFrames(model, 3, locked={name: np.array(curve) for name, curve in turned.items()})
    for begun in (frames.start_poses(), frames.start_poses(wanted)):
        np.testing.assert_allclose(off(begun)[1], 0.45, atol=0.15)
    np.testing.assert_allclose(model(begun, list(wanted)), np.transpose(list(wanted.values())), atol=3.0)
