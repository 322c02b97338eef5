"""Archard's law: what a flat punch wears off is known in closed form, and a cylinder that rolls wears nothing."""

import json
import re

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.pressure.law import layer_modulus
from casadi_contact.motion.columns import write_columns
from casadi_contact.motion.pose_file import write_poses
from problems import wear
from problems.common.records import pose_columns
from problems.wear import __main__
from problems.wear.cycle import leap
from problems.wear.report import draw
from tests.support.command import ended

DEPTH_MM, SIDE_MM = 0.1, 10.0


@pytest.fixture(scope="module")
def punch():
    return cc.ElasticFoundation(cc.load_scene("punch_on_plane", area=SIDE_MM**2), (20, 20))


def pressure(scene):
    return layer_modulus(scene.material) / scene.material.thickness * DEPTH_MM


def test_constant_pressure_and_sliding_wear_off_k_p_s_everywhere(punch):
    """There and back by 0, 1, 2, 3, 2, 1 mm: 6 mm slid, h = k·p·s and V = k·F·s."""
    poses = np.zeros((6, 6))
    poses[:, 0] = [0.0, 1.0, 2.0, 3.0, 2.0, 1.0]
    poses[:, 1] = -DEPTH_MM
    (found,) = wear.archard_wear(punch, poses, wear_factor=2e-7)
    expected = 2e-7 * 1e-3 * pressure(punch.scene) * 6.0
    np.testing.assert_allclose(found.depth_mm, expected, rtol=1e-9)
    np.testing.assert_allclose(found.sliding_mm, 6.0, rtol=1e-12)
    assert found.volume_mm3 == pytest.approx(expected * SIDE_MM**2, rel=1e-9)


def test_a_spinning_punch_wears_in_proportion_to_the_distance_from_its_axis(punch):
    """The mean distance of a square's points from its middle is a·(√2 + ln(1 + √2))/6."""
    spin = np.linspace(0.0, 0.02, 3)
    poses = np.zeros((4, 6))
    poses[:, 1], poses[:, 4] = -DEPTH_MM, [*spin, spin[1]]
    (found,) = wear.archard_wear(punch, poses)
    distance = np.hypot(found.centres_mm[:, 0], found.centres_mm[:, 2])
    scale = wear.WEAR_FACTOR * 1e-3 * pressure(punch.scene) * 0.04
    np.testing.assert_allclose(found.depth_mm, scale * distance, rtol=1e-4)
    mean = SIDE_MM * (np.sqrt(2.0) + np.log(1.0 + np.sqrt(2.0))) / 6.0
    assert found.volume_mm3 == pytest.approx(scale * mean * SIDE_MM**2, rel=2e-3)


def test_a_cylinder_that_rolls_wears_next_to_nothing_beside_one_that_slides():
    scene = cc.load_scene("cylinder_on_plane")
    model = cc.ElasticFoundation(scene, (60, 20))
    way = 2.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False))
    sliding = np.tile(scene.start_pose, (24, 1))
    sliding[:, 1] = scene.geometry["radius"] - DEPTH_MM
    sliding[:, 0] = way
    rolling = sliding.copy()
    rolling[:, 5] = -way / scene.geometry["radius"]
    slid, rolled = (wear.volume_mm3(wear.archard_wear(model, poses)) for poses in (sliding, rolling))
    assert slid > 0.0
    assert rolled < 0.01 * slid


def test_wear_is_the_wear_factor_times_force_times_way_also_where_pressure_varies():
    """A sphere that slides over a plane: every step's volume is k·F·Δs, whatever the pressure's shape."""
    scene = cc.load_scene("sphere_on_plane")
    model = cc.ElasticFoundation(scene, (80, 80))
    poses = np.tile(scene.start_pose, (9, 1))
    poses[:, 1] = scene.geometry["radius"] - 0.2
    poses[:, 0] = [0.0, 0.3, 0.6, 0.9, 1.2, 0.9, 0.6, 0.3, 0.0]
    force = -model.wrenches(poses)[:, 0, 1]
    steps = np.abs(np.diff(poses[:, 0]))
    expected = wear.WEAR_FACTOR * 1e-3 * (0.5 * (force[1:] + force[:-1]) @ steps)
    assert wear.volume_mm3(wear.archard_wear(model, poses)) == pytest.approx(expected, rel=1e-6)


def test_pressure_that_grows_evenly_along_a_step_wears_as_its_mean(punch):
    """∮ p ds with p = K·d and d linear in s, over steps of 1, 2 and 3 mm."""
    x_mm, depth_mm = np.array([0.0, 1.0, 3.0, 0.0]), np.array([0.05, 0.1, 0.2, 0.05])
    poses = np.zeros((3, 6))
    poses[:, 0], poses[:, 1] = x_mm[:3], -depth_mm[:3]
    (found,) = wear.archard_wear(punch, poses, wear_factor=2e-7)
    along = (np.arange(100) + 0.5) / 100.0
    ends = zip(x_mm, x_mm[1:], depth_mm, depth_mm[1:], strict=False)
    work = sum(abs(there - here) * np.mean(first + (last - first) * along) for here, there, first, last in ends)
    expected = 2e-7 * 1e-3 * pressure(punch.scene) / DEPTH_MM * work
    np.testing.assert_allclose(found.depth_mm, expected, rtol=1e-9)


def test_a_punch_that_turns_about_a_point_far_from_its_origin_wears_nothing_there(punch):
    """There and back by 0.04 rad about a pivot under the punch, 60 mm from the moving origin, which goes 2.4 mm on a
    circle: every point slides by angle times distance from the pivot, to the cube of the angle."""
    pivot, angle, radius_mm = np.array([1.1, 0.0, -0.7]), 0.04, 60.0
    poses = np.zeros((2, 6))
    poses[:, 4] = [0.3, 0.3 + angle]
    poses[:, 0], poses[:, 2] = pivot[0] + radius_mm * np.cos(poses[:, 4]), pivot[2] - radius_mm * np.sin(poses[:, 4])
    poses[:, 1] = -DEPTH_MM
    (found,) = wear.archard_wear(punch, poses)
    distance = np.linalg.norm((found.centres_mm - pivot)[:, [0, 2]], axis=1)
    assert distance.min() < 0.5
    np.testing.assert_allclose(found.sliding_mm, 2.0 * angle * distance, atol=radius_mm * angle**3)


def test_a_pose_held_and_a_pose_out_of_contact_wear_nothing(punch):
    held = np.tile([0.0, -DEPTH_MM, 0.0, 0.0, 0.0, 0.0], (3, 1))
    apart = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [5.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    assert wear.volume_mm3(wear.archard_wear(punch, held)) == 0.0
    assert wear.volume_mm3(wear.archard_wear(punch, apart)) == 0.0


@pytest.mark.parametrize(
    ("count", "factor", "said"),
    [(1, 1e-7, "1 poses, expected at least 2"), (3, 0.0, "positive number"), (3, np.nan, "positive number")],
)
def test_what_is_no_cycle_or_no_wear_factor_is_refused(punch, count, factor, said):
    with pytest.raises(ValueError, match=said):
        wear.archard_wear(punch, np.zeros((count, 6)), factor)


def test_a_wrong_factor_is_said_before_a_cycle_is_simulated(tmp_path, monkeypatch):
    monkeypatch.setattr(__main__, "simulated_poses", lambda *_: pytest.fail("simulated"))
    assert "positive number" in ended(monkeypatch, __main__.main, "--wear-factor", "nan", "--out", tmp_path)


def test_the_command_wears_a_cycle_from_a_file_and_draws_its_map(tmp_path, monkeypatch):
    scene = tmp_path / "small.toml"
    text = cc.load_scene("sphere_on_plane").with_overrides(teacher=(40, 40), fine=(20, 20)).to_toml()
    scene.write_text(text, "utf-8")
    poses = np.tile(cc.load_scene("sphere_on_plane").start_pose, (5, 1))
    poses[:, 1], poses[:, 0] = 29.8, [0.0, 0.5, 1.0, 0.5, 0.0]
    write_poses(np.arange(5.0), poses, tmp_path / "cycle.csv")
    arguments = ("--scene", scene, "--poses", tmp_path / "cycle.csv", "--out", tmp_path)
    assert ended(monkeypatch, __main__.main, *arguments) == 0
    summary = json.loads((tmp_path / "wear.json").read_text("utf-8"))
    assert summary["volume_mm3"] > 0.0
    assert sum(patch["volume_mm3"] for patch in summary["patches"].values()) == pytest.approx(summary["volume_mm3"])
    assert (tmp_path / "wear.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("scene", "right", "up", "labels"),
    [
        ("knee", [0, 0, 1], [1, 0, 0], ("z, medial [mm]", "x, posterior [mm]")),
        ("patellofemoral", [0, 0, 1], [0, 1, 0], ("z, medial [mm]", "y, superior [mm]")),
        ("glenohumeral", [-1, 0, 0], [0, 1, 0], ("x, posterior [mm]", "y, superior [mm]")),
    ],
)
def test_the_map_of_a_flat_surface_is_seen_as_it_is_pressed(tmp_path, monkeypatch, scene, right, up, labels):
    """Never edge-on: an element 20 mm to the right and one 30 mm up are where they are named, of a page that fits."""
    pages = []
    monkeypatch.setattr("problems.wear.report.save_page", lambda page, *_, **__: pages.append(page))
    model = cc.ElasticFoundation(cc.load_scene(scene), (8, 4))
    centres_mm, ones = np.outer([0.0, 20.0, 0.0], right) + np.outer([0.0, 0.0, 30.0], up), np.ones(3)
    draw(model, [wear.PatchWear("med", centres_mm, ones, ones, ones)], tmp_path / "wear.png")
    (page,) = pages
    first = page.axes[0]
    shown = first.transData.transform(first.collections[0].get_offsets())
    assert shown[1, 0] > shown[0, 0]
    assert shown[2, 1] > shown[0, 1]
    assert (first.get_xlabel(), first.get_ylabel()) == labels
    assert page.get_size_inches().max() <= 10.0


@pytest.fixture
def ball(tmp_path):
    """Arguments of the command on a ball that slides on a plane, and what writes its path: x [mm], scale of lengths."""
    scene = tmp_path / "small.toml"
    ready = cc.load_scene("sphere_on_plane").with_overrides(teacher=(40, 40), fine=(20, 20))
    scene.write_text(ready.to_toml(), "utf-8")

    def write(x_mm, scale=1.0, height_mm=29.8):
        poses = np.zeros((len(x_mm), 6))
        poses[:, 0], poses[:, 1] = x_mm, height_mm
        write_columns(tmp_path / "path.csv", pose_columns(scale * poses))

    return ("--scene", scene, "--poses", tmp_path / "path.csv", "--out", tmp_path / "out"), write


def test_the_path_of_a_result_table_is_taken_and_a_leap_is_said_with_what_is_done(ball, monkeypatch, capsys):
    arguments, write = ball
    write([0.0, 0.5, 1.0, 0.5])
    assert ended(monkeypatch, __main__.main, *arguments) == 0
    said = capsys.readouterr()
    assert said.err == ""
    table = " ".join(said.out.split())
    (elements,) = set(re.findall(r"EF \d+×\d+", table))  # the verdict's are those that the wear is summed on
    assert f"k = 1e-07 mm³/(N·m), {elements}" in table
    write([0.0, 0.5, 1.0, 1.5])
    assert ended(monkeypatch, __main__.main, *arguments) == 0
    said = capsys.readouterr().err
    assert (
        "path.csv: the path's ends are 1.5 mm and 0 degrees apart, 3 times its next largest step: one straight" in said
    )
    write([0.0, 0.25, 0.5, 1.75, 2.0, 1.5, 1.0, 0.5])
    assert ended(monkeypatch, __main__.main, *arguments) == 0
    said = capsys.readouterr().err
    assert "path.csv: poses 2 and 3 are 1.2 mm and 0 degrees apart, 2.5 times its next" in said
    assert said.strip().endswith("give the poses between them")


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ({"scale": 1e-3}, "overlap by 30 mm of a layer of 8 mm: are tx, ty, tz in mm"),
        ({"height_mm": 30.1}, "touch in no pose: are tx, ty, tz in mm, and poses those of the moving body"),
        ({"x_mm": [0.0, 1.0]}, "path.csv has 2 poses, expected a cycle of at least 4"),
    ],
)
def test_a_path_in_metres_out_of_contact_or_of_two_poses_is_refused(ball, monkeypatch, path, said):
    arguments, write = ball
    write(**{"x_mm": [0.0, 0.5, 1.0, 0.5], **path})
    assert said in ended(monkeypatch, __main__.main, *arguments)


def test_the_simulated_cycle_is_closed():
    poses = wear.simulated_poses(cc.load_surrogate("knee"), 40)
    steps = np.abs(np.diff(poses, axis=0)).max(axis=0)
    assert poses.shape == (40, 6)
    assert (np.abs(poses[0] - poses[-1]) <= 1.5 * steps).all()
    assert leap(poses) == ""


def test_a_mistake_is_one_line(tmp_path, monkeypatch):
    said = ended(monkeypatch, __main__.main, "--poses", tmp_path / "none.csv", "--out", tmp_path)
    assert said == "wear: --poses needs --scene, and no --surrogate: its elements are what wears"
