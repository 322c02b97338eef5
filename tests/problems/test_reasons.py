"""Frames that are not verified say why: outside the learned range by how much in what, infeasible, or not found."""

import csv
import re
from dataclasses import replace

import numpy as np

import casadi_contact as cc
from casadi_contact.core.quantities import two_digits
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.muscle_walk import example_walk
from casadi_contact.optimisation.starts import pose_bounds
from casadi_contact.optimisation.verification.verdict import judge
from problems import muscle_contact
from problems.common.learned_range import beyond_learned, held_beyond, reasons
from problems.common.outcome import print_reasons, rows_in_words
from problems.muscle_contact.compared import Compared
from problems.muscle_contact.diagnosis import diagnose
from problems.muscle_contact.picture import draw
from problems.muscle_contact.proof import least_overload
from problems.static_equilibrium import __main__ as equilibrium_command
from tests.support.command import ended

NO_MODEL = "no contact model at hand"


def loaded(knee, force_n):
    """A pose (1, 6) of walking with that force on both sides."""
    poses = np.array([[0.5, 27.23, 0.1, 0.0, 0.0, -0.3]])
    targets = dict.fromkeys(("Fy_med", "Fy_lat"), -force_n)
    return cc.settle(knee, poses, free=("ty", "rx"), targets=targets)[0]


def test_a_pose_outside_names_the_parameter_and_the_load_that_are_and_by_how_much(knee):
    usual, heavy = loaded(knee, 600.0), loaded(knee, 2600.0)
    assert beyond_learned(knee, usual)[0] == ""
    low = knee.record["pose_range"]["rz"][0]
    bent = usual.copy()
    bent[0, 5] = low - 0.2
    assert "rz by 0.2 rad" in beyond_learned(knee, bent)[0]
    bent[0, [1, 5]] = 24.0, low - 0.5
    assert "rz by 0.5 rad" in beyond_learned(knee, bent)[0]
    assert "load by" not in beyond_learned(knee, bent)[0], "what a surrogate extrapolates there is no load"
    learned = -(knee.trust.root_high**2) * knee.scene.reference_load
    said = beyond_learned(knee, heavy)[0]
    for patch, most in zip(("med", "lat"), learned, strict=True):
        assert f"{patch} load by {two_digits(2600.0 + most)} N" in said
    assert "validity" in said


def test_a_frame_that_is_solved_and_not_verified_says_what_the_contact_model_says(knee):
    poses = np.vstack([loaded(knee, 600.0)] * 2)
    coarse = cc.ElasticFoundation(knee.scene, (20, 15))
    verdict = judge(coarse, poses, [True, False], coarse)
    assert reasons(coarse, poses, verdict).tolist() == [verdict.words[0], ""]
    assert "elements half as wide differ by" in verdict.words[0]


def test_a_pose_on_the_bound_of_a_range_is_not_outside_by_what_rounding_leaves(knee):
    """Far enough from all samples for a validity that is low, and beyond bounds by as little as IPOPT lets slip."""
    _, high = pose_bounds(knee)
    corner = high + 1e-8
    assert knee.validity(corner[None])[0] < 0.5
    assert not re.search(r"\b[tr][xyz] by", beyond_learned(knee, corner[None])[0])
    assert held_beyond(knee, corner[None], ()) == [""]
    assert "tx by 0.3 mm" in beyond_learned(knee, corner[None] + np.array([0.3, 0, 0, 0, 0, 0]))[0]


def scaled_walk(scale):
    walk = example_walk(frames=9)
    return replace(walk, loads={name: scale * curve for name, curve in walk.loads.items()})


def diagnosed(knee, scale, **options):
    problem = muscle_contact.build(knee, scaled_walk(scale))
    result = muscle_contact.solve(problem, **options)
    return problem, result, diagnose(problem, result, judge(knee, result.poses, result.converged, NO_MODEL))


def test_a_muscle_problem_that_muscles_cannot_balance_is_infeasible_and_says_what_is_left(knee):
    problem, result, told = diagnosed(knee, 15.0)
    assert result.overloaded.any()
    for k in range(len(told.reason)):
        assert ("muscles and contact leave" in told.reason[k]) == result.overloaded[k]
        if result.overloaded[k]:
            least = least_overload(problem, problem.contact_model, result.poses[k], k)
            assert told.reason[k].startswith("infeasible: " if least > 1.0 else "overloaded: ")
    assert any(" of knee_" in reason for reason in told.reason)
    kinds = {reason.partition(":")[0] for reason in told.reason[result.overloaded]}
    assert kinds == {"infeasible", "overloaded"}, "some frames are beyond the muscles, some beyond the rules"


def test_a_least_activation_that_no_balance_allows_is_among_the_rules_that_are_named(knee):
    problem = muscle_contact.build(knee, example_walk(frames=5), least_activation=0.9)
    result = muscle_contact.solve(problem)
    told = diagnose(problem, result, judge(knee, result.poses, result.converged, NO_MODEL))
    lazier = muscle_contact.solve(muscle_contact.build(knee, example_walk(frames=5)))
    assert result.overloaded.any()
    assert not lazier.overloaded.any(), "the rules of co-contraction alone allow a balance"
    assert all("least activation" in reason for reason in told.reason[result.overloaded])


def test_the_picture_of_a_walk_too_heavy_for_muscles_marks_the_frames_that_are_not_solved(knee, tmp_path, monkeypatch):
    problem, result, _ = diagnosed(knee, 15.0)
    pages = []
    monkeypatch.setattr("problems.muscle_contact.picture.save_page", lambda page, path, **_: pages.append(page))
    draw(problem, result, Compared.of(problem, result, None), tmp_path / "page.png")
    assert f", {int(result.overloaded.sum())} overloaded" in pages[0].get_suptitle()
    marked = {line.get_label(): line for line in pages[0].axes[0].get_lines()}["not solved"]
    np.testing.assert_array_equal(marked.get_xdata(), problem.walk.percent[result.overloaded])


def test_a_muscle_problem_that_ipopt_leaves_is_not_found(knee):
    _, result, told = diagnosed(knee, 1.0, max_iterations=2)
    assert not result.converged.any()
    assert all(reason.startswith("not found: IPOPT stopped: Maximum_Iterations_Exceeded") for reason in told.reason)


def test_a_sound_muscle_problem_has_no_reasons(knee):
    assert not diagnosed(knee, 1.0)[2].reason.any()


def test_loads_beyond_the_samples_are_refused_a_verdict_and_the_table_says_why(tmp_path, monkeypatch, capsys):
    arguments = ["--flexions", "15", "--fy", "-7000", "--starts", "0", "--out", tmp_path]
    assert ended(monkeypatch, equilibrium_command.main, *arguments) == 3
    assert capsys.readouterr().out.splitlines()[0].startswith("0 of 1 solved and verified on EF 320×160; 1 solved but")
    (row,) = csv.DictReader((tmp_path / "static_equilibrium.csv").open())
    assert "outside the learned range (med load by" in row["reason"]


def test_neighbouring_rows_are_told_by_their_ends():
    chosen = np.zeros(101, dtype=bool)
    assert rows_in_words(chosen) == ""
    chosen[[0, 3, 4, 5, 6, 9, 10]] = True
    assert rows_in_words(chosen) == "0, 3 to 6, 9, 10"
    assert rows_in_words(np.ones(101, dtype=bool)) == "0 to 100"


def test_neighbouring_rows_of_one_kind_share_one_line():
    console = PlainConsole(record=True, width=200)
    said = ["", "beyond by 1 mm", "beyond by 2 mm", "beyond by 3 mm", "solved", "", "none: a", "none: a", "none: b"]
    print_reasons(console, np.array(said, dtype=object))
    assert console.export_text().split("\n")[:-1] == [
        "frames 1 to 3, as 2: beyond by 2 mm",
        "frame 4: solved",
        "frames 6 to 8, as 7: none: a",
    ]
    print_reasons(console, np.full(20_000, "no load", dtype=object))
    assert console.export_text().split("\n")[-2] == "frames 0 to 19999: no load"
