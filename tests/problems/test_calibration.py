"""Calibration: the truth is found again, the stated uncertainty is the real one, and what data leave open is named."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.scene import Scene
from problems import calibration
from problems.calibration import __main__
from problems.calibration.measurement import TRUTH, in_fixed_body, in_scene_frame
from problems.calibration.solve import start_values
from problems.calibration.uncertainty import reduced_hessian, uncertainty
from tests.support.command import ended
from tests.support.compiler import needs_compiler

pytestmark = needs_compiler
FRAMES = 12


@pytest.fixture(scope="module")
def knee():
    return cc.PolarFoundation(cc.load_scene("knee"))


def made_up(knee, names=calibration.DEFAULT, **options):
    truth = {name: TRUTH[name] for name in names}
    measured = calibration.synthetic_measurement(knee, truth, frames=FRAMES, **options)
    return calibration.build(knee, measured, names), np.array(list(truth.values()))


def test_without_noise_the_truth_is_recovered(knee):
    problem, truth = made_up(knee, noise=0.0)
    result = calibration.solve(problem)
    assert result.solved
    np.testing.assert_allclose(result.values, truth, rtol=1e-6)
    assert np.abs(result.load_error).max() < 1e-3


def test_estimates_scatter_about_the_truth_as_their_standard_deviations_say(knee):
    """Twelve noises, six parameters: the root mean square of 72 normal numbers lies within 0.75 and 1.25."""
    scores, misfits = [], []
    for seed in range(12):
        problem, truth = made_up(knee, seed=seed)
        result = calibration.solve(problem)
        scores.append((result.values - truth) / result.uncertainty.deviation)
        misfits.append(result.misfit)
    assert 0.75 < np.sqrt(np.mean(np.square(scores))) < 1.25
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.15)


def test_pressing_tells_stiffness_from_height_better_than_walking(knee):
    """By the Cramér-Rao bound at the truth; every fourfold of frames halves it."""

    def relative(motion, frames):
        truth = {name: TRUTH[name] for name in calibration.DEFAULT}
        measured = calibration.synthetic_measurement(knee, truth, frames=frames, motion=motion, noise=0.0)
        problem = calibration.build(knee, measured)
        z = problem.variables(np.array(list(truth.values())))
        found = uncertainty(problem, z, np.zeros((frames, 6)))
        assert found.parameters[0] == "youngs_modulus"
        return found.deviation[0] / TRUTH["youngs_modulus"]

    walking, pressing = relative("walking", 60), relative("pressing", 60)
    assert pressing < 0.65 * walking
    assert relative("pressing", 240) == pytest.approx(0.5 * pressing, rel=0.05)
    assert pressing * np.sqrt(60 / 1400) < 0.01, "1,400 frames know Young's modulus to 1 %"


def test_the_reduced_hessian_is_the_schur_complement_of_that_of_all_variables(knee):
    problem, _ = made_up(knee)
    x = start_values(problem)
    m = len(problem.parameters)
    whole = np.array(problem.hessian(x, [], 1.0, []))
    whole = np.triu(whole) + np.triu(whole, 1).T
    whole[:m, :m] -= np.eye(m)  # the damping
    schur = whole[:m, :m] - whole[:m, m:] @ np.linalg.solve(whole[m:, m:], whole[m:, :m])
    np.testing.assert_allclose(reduced_hessian(problem, x[:m], x[m:].reshape(-1, 6)), schur, rtol=1e-6)


def test_random_starts_reach_the_same_estimate(knee):
    problem, _ = made_up(knee)
    result = calibration.solve(problem)
    for start in calibration.random_starts(problem, 3):
        away = np.abs(calibration.solve(problem, start).values - result.values)
        assert (away < 1e-3 * result.uncertainty.deviation).all()


def test_stiffness_and_thickness_are_not_told_apart_but_their_ratio_is_found(knee):
    problem, truth = made_up(knee, ("youngs_modulus", "thickness"), noise=0.0)
    result = calibration.solve(problem)
    assert result.uncertainty.tied == (("youngs_modulus", "thickness"),)
    assert np.isinf(result.uncertainty.deviation).all()
    assert result.values[0] / result.values[1] == pytest.approx(truth[0] / truth[1], rel=1e-6)


def test_data_that_the_model_does_not_explain_are_said_to_be_such(knee):
    """Loads of an insert that was moved, and only its stiffness to choose."""
    problem, _ = made_up(knee)
    assert calibration.solve(problem).explained
    result = calibration.solve(calibration.build(knee, problem.measured, ["youngs_modulus", "fixed_ty"]))
    assert not result.explained
    assert "does not explain these data" in __main__.failure(result)
    assert "youngs_modulus" in result.uncertainty.at_bound
    assert np.isinf(result.uncertainty.deviation[0])


def test_an_unsolved_estimate_names_what_the_data_leave_open(knee):
    """Modulus and Poisson's ratio make one stiffness: there is a valley of estimates, and no end to walk to."""
    problem, _ = made_up(knee, ("youngs_modulus", "poissons_ratio"))
    result = calibration.solve(problem, max_iterations=4)
    assert not result.solved
    assert "do not tell apart: youngs_modulus and poissons_ratio" in __main__.failure(result)


def test_an_unsolved_estimate_far_from_the_data_asks_for_their_units(knee):
    problem, _ = made_up(knee)
    metres = replace(problem.measured, poses=problem.measured.poses / np.repeat([1000.0, 1.0], 3))
    result = calibration.solve(calibration.build(knee, metres), max_iterations=4)
    assert not result.solved
    assert "are poses in mm and rad" in __main__.failure(result)


@pytest.mark.parametrize(("load", "value"), [("Fy_med", -5000.0), ("Fy_lat", 0.0)])
def test_one_wrong_frame_is_named_and_without_it_the_truth_is_found(knee, load, value):
    problem, _ = made_up(knee)
    measured = problem.measured
    loads = measured.loads.copy()
    loads[7, measured.load_names.index(load)] = value
    result = calibration.solve(calibration.build(knee, replace(measured, loads=loads)))
    assert "frame 7 alone has " in __main__.failure(result)
    assert "mm and rad" not in __main__.failure(result), "units are those of all other frames"
    kept = np.arange(len(loads)) != 7
    again = calibration.build(knee, replace(measured, loads=loads[kept], poses=measured.poses[kept]))
    assert __main__.failure(calibration.solve(again)) == ""


def test_forces_of_the_wrong_sign_are_refused_with_the_cure(knee):
    problem, _ = made_up(knee)
    with pytest.raises(ValueError, match=r"Fy_med is .* on average, but compression is negative .*: turn its sign"):
        calibration.build(knee, replace(problem.measured, loads=-problem.measured.loads))


def test_a_measurement_of_totals_alone_is_refused_and_told_which_loads_are_missing():
    """Poses are settled under the normal loads, whichever loads the scene names."""
    tables, totals = cc.load_scene("knee").tables, ["Fy", "Fx", "Tx", "Tz"]
    loads = {**tables["loads"], "names": totals}
    scene = Scene.from_tables({**tables, "loads": loads, "tolerances": dict.fromkeys(totals, 10.0)})
    measured = calibration.Measurement(np.zeros((4, 6)), np.full((4, 4), -500.0), scene.load_names)
    said = r"loads are Fy, Fx, Tx, Tz, expected the normal loads .*: have Fy_med, Fy_lat in its \[loads\] names"
    with pytest.raises(ValueError, match=said):
        calibration.build(cc.PolarFoundation(scene), measured)


def test_a_dish_turned_about_its_own_axis_is_the_same_dish(knee):
    """Its axis lies along z at a height of one radius: slope and anterior-posterior place are one number."""
    problem, _ = made_up(knee, ("fixed_tx", "fixed_ty", "fixed_rz"))
    tied = calibration.solve(problem).uncertainty.tied
    assert len(tied) == 1
    assert {"fixed_tx", "fixed_rz"} <= set(tied[0])


def test_estimates_that_explain_the_data_as_well_differ_by_no_more_than_is_said_to_be_known(knee):
    """What goes a little way along with an open direction is as open, in multiples of its own small deviation."""
    problem, _ = made_up(knee, (*calibration.DEFAULT, "fixed_rz"), motion="pressing")
    one, other = calibration.solve(problem), calibration.solve(problem, {"fixed_tx": -1.0})
    assert abs(one.misfit - other.misfit) < 1e-4
    assert np.abs(one.values - other.values).max() > 0.5
    for result in (one, other):
        assert (np.abs(one.values - other.values) <= 3.0 * result.uncertainty.deviation).all()


def test_another_estimate_that_explains_the_data_as_well_is_told_and_ends_with_status_2(tmp_path, monkeypatch, capsys):
    """Turned to either side the dish's axis comes to lie at one place: two minima. Deviations know of one each."""
    options = ("--parameters", "fixed_tx,fixed_rz", "--noise", 0, "--starts", 4)
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, *options) == 2
    said = capsys.readouterr().err
    assert "end at other estimates that explain these data as well, such as fixed_tx" in said
    assert json.loads((tmp_path / "calibration.json").read_text("utf-8"))["random_starts"]["others_as_good"]


def test_frames_of_scene_and_insert_lead_to_each_other():
    poses, place = np.array([[1.0, 27.0, -2.0, 0.1, -0.2, -0.9]]), np.array([3.0, -2.0, 5.0, 0.2, -0.1, 0.3])
    np.testing.assert_allclose(in_fixed_body(in_scene_frame(poses, place), place), poses, atol=1e-12)


def test_what_cannot_be_estimated_is_refused(knee):
    problem, _ = made_up(knee)
    with pytest.raises(ValueError, match="parameters radius, expected some of"):
        calibration.build(knee, problem.measured, ("radius",))
    with pytest.raises(ValueError, match="deviation force_n is 0"):
        calibration.Measurement(problem.measured.poses, problem.measured.loads, knee.load_names, force_n=0.0)
    with pytest.raises(ValueError, match="start holds thickness, expected youngs_modulus"):
        calibration.solve(problem, {"thickness": 7.0})
    with pytest.raises(ValueError, match="motion is 'running', expected one of walking, pressing"):
        calibration.synthetic_measurement(knee, {}, motion="running")


def test_a_measurement_written_is_read_back(knee, tmp_path):
    problem, _ = made_up(knee)
    write_columns(tmp_path / "measured.csv", problem.measured.columns())
    again = calibration.read_measurement(tmp_path / "measured.csv", knee, force_n=7.0)
    np.testing.assert_array_equal(again.poses, problem.measured.poses)
    np.testing.assert_array_equal(again.loads, problem.measured.loads)
    assert again.load_deviation.tolist() == [7.0] * 4 + [100.0] * 3


def test_a_measurement_in_degrees_is_refused(knee, tmp_path):
    problem, _ = made_up(knee)
    poses = problem.measured.poses * np.repeat([1.0, 180.0 / np.pi], 3)
    write_columns(tmp_path / "degrees.csv", replace(problem.measured, poses=poses).columns())
    with pytest.raises(ValueError, match=r"degrees.csv: r[xyz] reaches .*, expected radians"):
        calibration.read_measurement(tmp_path / "degrees.csv", knee)


def test_no_start_reaches_an_estimate_that_the_data_do_not_determine(tmp_path, monkeypatch, capsys):
    options = ("--frames", FRAMES, "--starts", 1, "--parameters", "youngs_modulus,thickness")
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, *options) == 2
    said = capsys.readouterr().out
    assert "not identifiable together: youngs_modulus, thickness" in said
    assert "random starts" not in said


def test_ctrl_c_during_random_starts_leaves_what_was_estimated(tmp_path, monkeypatch):
    solve, starts = calibration.solve, []

    def interrupted(problem, start=None):
        if start is None:
            return solve(problem)
        starts.append(start)
        raise KeyboardInterrupt

    monkeypatch.setattr(__main__, "solve", interrupted)
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--frames", FRAMES, "--starts", 2) == 130
    assert len(starts) == 1
    assert json.loads((tmp_path / "calibration.json").read_text("utf-8"))["explained"] is True
    assert {path.name for path in tmp_path.iterdir()} >= {"calibration.csv", "calibration.png"}


def test_the_command_writes_table_summary_and_picture(tmp_path, monkeypatch, capsys):
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--frames", FRAMES, "--starts", 1) == 0
    assert "1 of 1 random starts reach it" in capsys.readouterr().out.replace("\n", " ")
    rows = list(csv.DictReader((tmp_path / "calibration.csv").open(encoding="utf-8")))
    assert [row["parameter"] for row in rows] == list(calibration.DEFAULT)
    assert json.loads((tmp_path / "calibration.json").read_text("utf-8"))["not_identifiable_together"] == []
    assert json.loads((tmp_path / "calibration.json").read_text("utf-8"))["random_starts"] == {
        "tried": 1,
        "same": 1,
        "others_as_good": [],
    }
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")


def test_parameters_that_are_not_identifiable_together_end_with_status_2(tmp_path, monkeypatch, capsys):
    arguments = ("--parameters", "youngs_modulus,thickness", "--frames", FRAMES, "--starts", 0, "--out", tmp_path)
    assert ended(monkeypatch, __main__.main, *arguments) == 2
    assert "do not tell apart: youngs_modulus and thickness" in capsys.readouterr().err
    rows = list(csv.DictReader((tmp_path / "calibration.csv").open(encoding="utf-8")))
    assert [(row["standard_deviation"], row["error_over_deviation"]) for row in rows] == [("inf", "nan")] * 2


def test_a_mistake_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "short.csv").write_text("tx_mm\n1.0\n", "utf-8")
    said = ended(monkeypatch, __main__.main, "--measured", tmp_path / "short.csv", "--out", tmp_path)
    assert said.startswith("calibration: ")
    assert "lacks the columns ty_mm" in said
    assert "\n" not in said
