"""Archard's law in closed form: a punch that slides, spins or turns; a sphere; a cylinder that rolls."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.pose_file import write_poses
from problems import wear

DEPTH_MM, SIDE_MM = 0.1, 10.0


@pytest.fixture(scope="module")
def punch():
    return cc.ElasticFoundation(cc.load_scene("punch_on_plane", area=SIDE_MM**2), (20, 20))


def test_pressure_that_grows_evenly_along_a_step_wears_as_its_mean(punch):
    """h = k·∮ p ds with p = (K/h)·d and d linear in s, over steps of 1, 2 and 3 mm; every element alike."""
    x_mm, depth_mm = np.array([0.0, 1.0, 3.0, 0.0]), np.array([0.05, 0.1, 0.2, 0.05])
    poses = np.zeros((3, 6))
    poses[:, 0], poses[:, 1] = x_mm[:3], -depth_mm[:3]
    (found,) = wear.archard_wear(punch, poses, wear_factor=2e-7)
    work = np.abs(np.diff(x_mm)) @ (0.5 * (depth_mm[1:] + depth_mm[:-1]))
    stiffness = punch.scene.material.modulus / punch.scene.material.thickness  # K/h [MPa/mm]
    np.testing.assert_allclose(found.depth_mm, 2e-7 * 1e-3 * stiffness * work, rtol=1e-9)
    np.testing.assert_allclose(found.sliding_mm, 6.0, rtol=1e-12)
    assert found.volume_mm3 == pytest.approx(found.depth_mm[0] * SIDE_MM**2, rel=1e-9)


def test_a_punch_slides_by_angle_times_distance_from_the_pivot_far_from_its_origin(punch):
    """There and back by 0.04 rad about a pivot under the punch, 60 mm from the moving origin."""
    pivot, angle, radius_mm = np.array([1.1, 0.0, -0.7]), 0.04, 60.0
    poses = np.zeros((2, 6))
    poses[:, 4] = [0.3, 0.3 + angle]
    poses[:, 0], poses[:, 2] = pivot[0] + radius_mm * np.cos(poses[:, 4]), pivot[2] - radius_mm * np.sin(poses[:, 4])
    poses[:, 1] = -DEPTH_MM
    (found,) = wear.archard_wear(punch, poses)
    distance = np.linalg.norm((found.centres_mm - pivot)[:, [0, 2]], axis=1)
    np.testing.assert_allclose(found.sliding_mm, 2.0 * angle * distance, atol=radius_mm * angle**3)


def test_the_volume_is_wear_factor_times_force_times_way_whatever_the_pressure(punch):
    scene = cc.load_scene("sphere_on_plane")
    model = cc.ElasticFoundation(scene, (80, 80))
    poses = np.tile(scene.start_pose, (9, 1))
    poses[:, 1] = scene.geometry["radius"] - 0.2
    poses[:, 0] = [0.0, 0.3, 0.6, 0.9, 1.2, 0.9, 0.6, 0.3, 0.0]
    force, steps = -model.wrenches(poses)[:, 0, 1], np.abs(np.diff(poses[:, 0]))
    expected = 1e-7 * 1e-3 * (0.5 * (force[1:] + force[:-1]) @ steps)
    (found,) = wear.archard_wear(model, poses)
    assert found.volume_mm3 == pytest.approx(expected, rel=1e-6)


def test_a_cylinder_that_rolls_wears_next_to_nothing_beside_one_that_slides():
    scene = cc.load_scene("cylinder_on_plane")
    model = cc.ElasticFoundation(scene, (60, 20))
    sliding = np.tile(scene.start_pose, (24, 1))
    sliding[:, 1] = scene.geometry["radius"] - DEPTH_MM
    sliding[:, 0] = 2.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False))
    rolling = sliding.copy()
    rolling[:, 5] = -sliding[:, 0] / scene.geometry["radius"]
    slid, rolled = (wear.archard_wear(model, poses)[0].volume_mm3 for poses in (sliding, rolling))
    assert slid > 0.0
    assert rolled < 0.01 * slid


def test_a_pose_held_and_poses_out_of_contact_wear_nothing(punch):
    held = np.tile([0.0, -DEPTH_MM, 0.0, 0.0, 0.0, 0.0], (3, 1))
    apart = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [5.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    for poses in (held, apart):
        assert wear.archard_wear(punch, poses)[0].volume_mm3 == 0.0


@pytest.mark.parametrize(("count", "factor"), [(1, 1e-7), (3, 0.0), (3, np.nan)])
def test_what_is_no_cycle_or_no_wear_factor_is_refused(punch, count, factor):
    with pytest.raises(ValueError, match="wear factor"):
        wear.archard_wear(punch, np.zeros((count, 6)), factor)


def test_the_program_wears_a_cycle_from_a_file(tmp_path, capsys):
    scene = cc.load_scene("sphere_on_plane").with_overrides(teacher=(40, 40), fine=(20, 20))
    (tmp_path / "small.toml").write_text(scene.to_toml(), "utf-8")
    poses = np.tile(scene.start_pose, (5, 1))
    poses[:, 1], poses[:, 0] = 29.8, [0.0, 0.5, 1.0, 0.5, 0.0]
    write_poses(np.arange(5.0), poses, tmp_path / "cycle.csv")
    wear.main(scene=str(tmp_path / "small.toml"), poses=tmp_path / "cycle.csv", out=tmp_path)
    assert "deepest" in capsys.readouterr().out
    assert (tmp_path / "wear.csv").read_text("utf-8").count("\n") == 1601
    assert (tmp_path / "wear.png").stat().st_size > 1000
    write_poses(np.arange(5.0), poses * [1, 2, 1, 1, 1, 1], tmp_path / "cycle.csv")
    with pytest.raises(ValueError, match="penetration"):
        wear.main(scene=str(tmp_path / "small.toml"), poses=tmp_path / "cycle.csv", out=tmp_path)
