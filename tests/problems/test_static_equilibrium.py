"""Settling under six loads: golden poses, balance, far starts, honest reports, the elastic foundation's own answer."""

import csv
import json
import sys

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.conventions import POSE_NAMES, WRENCH_NAMES, angular_velocity_map
from casadi_contact.verification import own_model
from problems import static_equilibrium
from problems.static_equilibrium import __main__
from problems.static_equilibrium.diagnosis import diagnose
from problems.static_equilibrium.starts import solve_from_lifts

FLEXIONS_DEG = (5.0, 30.0, 75.0)
LOADS = (-100.0, -1500.0, 0.0, 7500.0, -2000.0, 0.0)
SOFT = np.array([static_equilibrium.SOFT_TISSUE[name] for name in POSE_NAMES])


@pytest.fixture(scope="module")
def knee():
    return cc.load_surrogate("knee")


@pytest.fixture(scope="module")
def rest():
    poses = np.zeros((len(FLEXIONS_DEG), 6))
    poses[:, 1], poses[:, 5] = 27.5, -np.radians(FLEXIONS_DEG)
    return poses


@pytest.fixture(scope="module")
def solved(knee, rest):
    problem = static_equilibrium.build(knee, np.tile(LOADS, (len(rest), 1)), rest=rest, about="moving")
    return problem, static_equilibrium.solve(problem)


def test_golden_poses(solved):
    _, result = solved
    assert result.converged.all(), result.reason
    golden = [
        [0.9485, 27.4322, 0.1230, -0.00175, -0.04085],
        [-1.7170, 27.2652, 0.0183, -0.00305, -0.06585],
        [-0.4326, 27.0532, 0.1216, -0.00370, -0.07954],
    ]
    np.testing.assert_allclose(result.poses[:, :5], golden, atol=5e-3)  # by which networks of 0.3 N differ


def test_contact_carries_the_given_loads_along_every_free_direction(solved):
    problem, result = solved
    for pose, wrench in zip(result.poses, result.wrenches, strict=True):
        # About the moving origin, by a plain cross product; the rest is the torque that the lock of rz gives.
        torque = wrench[3:] - np.cross(pose[:3], wrench[:3])
        left = angular_velocity_map(pose[3:]).T @ (torque - problem.loads[0, 3:])
        np.testing.assert_allclose(wrench[:3], problem.loads[0, :3], atol=1e-4)
        np.testing.assert_allclose(left[:2], 0.0, atol=1e-2)


def test_loads_about_the_fixed_origin_give_the_same_pose(knee, rest, solved):
    _, result = solved
    about_fixed = np.tile(LOADS, (len(rest), 1))
    about_fixed[:, 3:] += np.cross(result.poses[:, :3], about_fixed[:, :3])
    again = static_equilibrium.solve(static_equilibrium.build(knee, about_fixed, rest=rest))
    np.testing.assert_allclose(again.poses, result.poses, atol=1e-4)


def test_six_free_parameters_share_the_loads_with_the_springs(knee, rest):
    problem = static_equilibrium.build(
        knee, np.tile(LOADS, (len(rest), 1)), free=POSE_NAMES, rest=rest, stiffness=SOFT, about="moving"
    )
    result = static_equilibrium.solve(problem)
    assert result.converged.all(), result.reason
    springs = SOFT * (result.poses - rest)
    np.testing.assert_allclose(result.wrenches[:, :3] + springs[:, :3], np.tile(LOADS[:3], (3, 1)), atol=0.1)
    assert np.abs(np.degrees(result.poses[:, 5] - rest[:, 5])).max() > 0.05  # flexion moved, held by its spring


def test_starts_far_out_of_contact_and_too_deep_reach_the_same_pose(solved):
    assert (solve_from_lifts(*solved, 3, (2.0, 20.0, -5.0)).shares == 1.0).all()


def test_the_elastic_foundation_has_its_equilibrium_close_by(knee, solved):
    problem, result = solved
    poses = static_equilibrium.on_model(problem, result, cc.ElasticFoundation(knee.scene, (160, 80)))
    off = np.abs(poses - result.poses).max(axis=0)
    assert off[:3].max() < 0.02
    assert np.degrees(off[3:].max()) < 0.03


def test_another_model_does_not_turn_a_ball_that_nothing_keeps_from_turning():
    model = cc.foundation("hip")
    up = np.array([[-100.0, 1500.0, 400.0, 0.0, 0.0, 0.0]])
    problem = static_equilibrium.build(model, up, rest=[model.scene.start_pose], about="moving")
    result = static_equilibrium.solve(problem)
    assert result.converged.all(), result.reason
    off = np.abs(
        static_equilibrium.on_model(problem, result, cc.ElasticFoundation(model.scene, (60, 60))) - result.poses
    )
    assert off[:, :3].max() < 0.01
    assert np.degrees(off[:, 3:].max()) < 0.01
    assert (solve_from_lifts(problem, result, 3, (2.0, -0.5)).shares == 1.0).all()  # turned, but in the same place


def test_loads_that_nothing_carries_are_named_row_by_row(knee, rest):
    loads = np.tile(LOADS, (3, 1))
    loads[0, WRENCH_NAMES.index("Fy")] = 50.0
    loads[1, WRENCH_NAMES.index("Tx")] = 90_000.0  # outside both condyles
    result = static_equilibrium.solve(static_equilibrium.build(knee, loads, rest=rest, about="moving"))
    assert result.converged.tolist() == [False, False, True]
    assert "does not press the bodies together" in result.reason[0]
    assert "not found in the learned range" in result.reason[1]


def test_the_contact_model_says_whether_an_unsolved_row_lies_outside_of_what_was_learned(knee, rest):
    loads = np.tile(LOADS, (3, 1))
    loads[1, WRENCH_NAMES.index("Fz")] = 900.0  # up the side of the dish
    loads[2, WRENCH_NAMES.index("Tx")] = 90_000.0  # outside both condyles
    problem = static_equilibrium.build(knee, loads, rest=rest, about="moving")
    result = diagnose(problem, static_equilibrium.solve(problem), own_model(knee.scene))
    assert result.reason[0] == ""
    assert result.reason[1].startswith("outside the learned range (tz by ")
    assert "finds no equilibrium either" in result.reason[2]
    assert diagnose(problem, result, "none at hand") is result


def test_a_flexion_held_beyond_what_was_learned_is_named_whatever_the_contact_model_finds(knee, rest):
    bent = rest.copy()
    bent[1, 5] = knee.record["pose_range"]["rz"][0] - 0.7
    problem = static_equilibrium.build(knee, np.tile(LOADS, (3, 1)), rest=bent, about="moving")
    result = static_equilibrium.solve(problem)
    assert result.converged.tolist() == [True, False, True]
    for told in (result, diagnose(problem, result, own_model(knee.scene))):
        assert told.reason[1].startswith("held outside the learned range (rz by 0.7 rad): at the nearest ")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"loads": np.zeros((2, 5))}, r"loads has shape \(2, 5\)"),
        ({"loads": [0.0, -np.inf, 0.0, 0.0, 0.0, 0.0]}, r"loads holds -inf at row 0 \(Fy\)"),
        ({"free": ("tx", "tx")}, "each named once"),
        ({"free": ("tx", "qx")}, "unknown pose parameter 'qx'"),
        ({"free": POSE_NAMES}, "contact does not hold flexion"),
        ({"stiffness": [-1.0] * 6}, "expected 6 numbers >= 0"),
        ({"rest": np.zeros((2, 6))}, "rest has 2 poses"),
        ({"about": "middle"}, "about is 'middle'"),
    ],
)
def test_wrong_requests_are_refused(knee, given, said):
    arguments = {"loads": np.array([LOADS]), **given}
    with pytest.raises(ValueError, match=said):
        static_equilibrium.build(knee, **arguments)


def command(monkeypatch, *arguments):
    """Exit status (text where a mistake is reported) of the command line."""
    monkeypatch.setattr(sys, "argv", ["static_equilibrium", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        __main__.main()
    return end.value.code


def test_the_command_writes_table_csv_summary_and_picture(tmp_path, monkeypatch, capsys):
    assert command(monkeypatch, "--out", tmp_path, "--starts", 1, "--flexions", "10,40") == 0
    assert "2 of 2 in equilibrium" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "static_equilibrium.csv").open(encoding="utf-8")))
    assert [round(float(row["Fy_contact_N"])) for row in rows] == [-1500, -1500]
    # Along what is free the contact carries the wanted torques, about the same origin; rz is held.
    for row in rows:
        left = [float(row[f"T{axis}_contact_Nmm"]) - float(row[f"T{axis}_wanted_Nmm"]) for axis in "xyz"]
        turned = angular_velocity_map(np.array([float(row[f"{name}_rad"]) for name in POSE_NAMES[3:]])).T @ left
        np.testing.assert_allclose(turned[:2], 0.0, atol=1.0)
        assert abs(float(row["Tx_ef_Nmm"]) - float(row["Tx_contact_Nmm"])) < 100.0
    assert json.loads((tmp_path / "static_equilibrium.json").read_text("utf-8"))["converged"] == 2
    assert (tmp_path / "static_equilibrium.png").read_bytes().startswith(b"\x89PNG")


def test_loads_without_equilibrium_end_with_status_2(tmp_path, monkeypatch, capsys):
    assert command(monkeypatch, "--out", tmp_path, "--starts", 0, "--flexions", "20", "--fy", "300") == 2
    assert "static_equilibrium: not solved: frames 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--flexions", "ten"), "--flexions is 'ten', expected numbers"),
        (("--surrogate", "hip"), "unknown surrogate 'hip'"),
        (("--out", "/proc/nowhere"), "cannot write in folder /proc/nowhere"),
    ],
)
def test_a_mistake_is_one_line(arguments, said, tmp_path, monkeypatch):
    code = command(monkeypatch, "--out", tmp_path, *arguments)
    assert code.startswith("static_equilibrium: ")
    assert said in code
    assert "\n" not in code
