"""Every frame of a solution is told apart: verified on the contact model, different there, unsolved, or not checked."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import pose_index
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.verification import allowed_errors
from tests.support.meshes import ball_mesh, scene_of, sheet_mesh

POSE = np.array([0.7, 27.3, 0.1, 0.002, -0.04, -0.5])
LIFTED = POSE + np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0])


class Off:
    """A contact model that differs from a surrogate by so much (n, L) at poses (n, 6)."""

    def __init__(self, knee, by):
        self.knee, self.by, self.load_names = knee, by, knee.load_names

    def __call__(self, poses):
        return self.knee(poses) - self.by(poses)


def off_by(knee, times, loads=None):
    """By so many times the scene's tolerance, in these loads."""
    chosen = np.isin(knee.load_names, loads or knee.load_names)
    return Off(knee, lambda poses: times * knee.scene.tolerances_of(knee.load_names) * chosen)


def silent_at(knee, rows, number):
    """Off by 0.25 N and N·mm, but for rows without a number."""
    return Off(knee, lambda poses: np.where(np.isin(np.arange(len(poses)), rows), number, 0.25)[:, None])


def with_teacher(grid):
    return reference_model(cc.load_scene("knee").with_overrides(teacher=grid))


def test_frames_that_the_scene_s_finest_elements_confirm_are_verified_and_pass(knee):
    model = reference_model(knee.scene)
    assert model.grid == tuple(knee.scene.grids["teacher"])
    check = cc.verify(knee, np.tile(POSE, (3, 1)))
    assert check.words == ["solved and verified"] * 3
    assert check.exit_code == 0
    assert check.passed
    assert check.line == "3 of 3 solved and verified on EF 320×160"
    np.testing.assert_allclose(check.errors, knee(check.poses) - model(check.poses))
    np.testing.assert_allclose(check.rms, np.abs(check.errors[0]))
    np.testing.assert_allclose(check.worst, check.rms)
    assert all(f"\n  {name} " in str(check) for name in knee.load_names)
    assert str(check).endswith("\n  passed")


@pytest.mark.parametrize(("times", "verified"), [(-2.9, True), (3.1, False)])
def test_a_frame_may_be_off_by_three_times_the_scene_s_tolerance_their_rms_by_one(knee, times, verified):
    check = cc.verify(knee, [POSE], off_by(knee, times))
    assert check.verified.all() == verified
    assert not check.passed
    assert check.failing.all(), "the RMS of one frame is its error"
    assert "too large" in str(check)


def test_the_error_named_is_the_largest_against_its_tolerance(knee):
    poses = np.array([POSE, LIFTED])
    softer = Off(knee, lambda poses: 0.5 * knee(poses))
    check = cc.verify(knee, poses, softer)
    worst = np.abs(knee(POSE) / knee.scene.tolerances_of(knee.load_names)).argmax()
    assert check.words[0].startswith("solved, differs by ")
    assert check.words[0].endswith(f"({knee.load_names[worst]})")
    assert check.words[1] == "solved and verified, outside the learned region"
    assert check.exit_code == 4
    assert "1 solved, differs by" in check.line


def test_only_the_loads_that_a_problem_uses_are_judged(knee):
    twisted = off_by(knee, 100.0, ["Ty"])
    assert cc.verify(knee, [POSE], twisted, loads=("Fy_med", "Fy_lat")).exit_code == 0
    assert cc.verify(knee, [POSE], twisted).exit_code == 4


def test_unsolved_frames_come_first_in_the_exit_code_and_those_without_load_count_for_nothing(knee):
    poses, model = np.tile(POSE, (3, 1)), off_by(knee, 10.0)
    check = cc.verify(knee, poses, model, [False, True, False], without_load=[False, False, True])
    assert check.words[::2] == ["not solved", "no load"]
    assert check.exit_code == 3
    assert check.line.startswith("0 of 2 solved and verified on Off, 1 bear no load; 1 not solved (0); 1 solved, dif")
    assert cc.verify(knee, poses, knee, [True, True, False], without_load=[False, False, True]).exit_code == 0


def test_frames_that_leap_are_solved_and_not_verified(knee):
    check = cc.verify(knee, [POSE, POSE], knee, leaps=[False, True])
    assert check.words == ["solved and verified", "solved, its pose leaps"]
    assert "pose leaps" in check.line


def test_a_frame_outside_the_learned_region_fails_though_the_model_agrees(knee):
    aside = np.tile(POSE, (5, 1))
    aside[4, pose_index("tz")] += 4.0
    check = cc.verify(knee, aside, knee)
    assert check.outside.nonzero()[0].tolist() == check.failing.nonzero()[0].tolist() == [4]
    assert not check.passed
    assert check.line.endswith("; 1 (4) outside the learned region")
    assert [word.endswith("outside the learned region") for word in check.words] == [False] * 4 + [True]
    unknown = cc.verify(type(knee)(knee.scene, knee.networks, knee.record), aside, knee)
    assert unknown.outside.all(), "not calibrated, it knows no region"


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_frames_without_a_number_confirm_nothing_and_leave_the_errors_of_the_others(knee, number):
    check = cc.verify(knee, np.tile(POSE, (4, 1)), silent_at(knee, [1], number))
    assert check.failing.nonzero()[0].tolist() == [1]
    assert check.words[1] == "solved, differs by inf N (Fy_med)"
    np.testing.assert_allclose(check.rms, 0.25)
    np.testing.assert_allclose(check.worst, 0.25)
    nowhere = cc.verify(knee, [POSE], silent_at(knee, [0], number))
    assert nowhere.checked
    assert nowhere.exit_code == 4


def test_a_scene_without_a_model_of_its_own_says_so(knee):
    table = knee.scene.tables | {"shape": "own_model", "geometry": {"patches": {"med": {}, "lat": {}}}}
    scene = cc.Scene.from_tables({key: value for key, value in table.items() if key not in ("material", "grids")})
    check = cc.verify(knee, [POSE], reference_model(scene))
    assert check.words == ["solved, not checked"]
    assert str(check).startswith("1 of 1 solved, not checked: the scene knee has no contact model at hand")
    assert check.exit_code == 0
    assert not check.verified.any()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"solved": [True]}, "shape"),
        ({"solved": ["False", "True"]}, "solved holds"),
        ({"solved": [2.0, 1.0]}, "True or False"),
        ({"poses": np.empty((0, 6))}, "poses"),
        ({"model": cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (8, 8))}, "Fy_med"),
    ],
)
def test_mistakes_are_named(knee, changed, said):
    given = {"poses": [POSE, LIFTED], "model": knee}
    with pytest.raises(ValueError, match=said):
        cc.verify(knee, **{**given, **changed})


@pytest.mark.parametrize("solved", [[True, True], [True, False], [False, True]])
def test_a_frame_on_elements_that_are_too_coarse_is_solved_and_not_verified(solved):
    model, finer = with_teacher((20, 15)), with_teacher((40, 30))
    check = cc.verify(model, [POSE, LIFTED], model, solved)
    assert check.verified.tolist() == [False, solved[1]], "where nothing touches any elements do"
    assert check.exit_code == (4 if all(solved) else 3)
    if solved[0]:
        off = model([POSE]) - finer([POSE])
        np.testing.assert_allclose(check.off_finer[0], off[0], atol=1e-9)
        assert f"({model.load_names[np.abs(off[0] / check.allowed[0]).argmax()]})" in check.words[0]
        assert check.words[0].startswith("solved, elements half as wide differ by ")
        assert "1 solved, elements half as wide differ by" in check.line
    unknown = replace(check, off_finer=np.full_like(check.off_finer, np.nan))
    assert not unknown.verified.any(), "a difference that is no number verifies nothing"
    fine = with_teacher((160, 80))
    assert cc.verify(fine, [POSE, LIFTED], fine).exit_code == 0


def test_of_a_mesh_a_finer_distance_field_tells_too(tmp_path):
    """Its own triangles are the same for every grid."""
    scene = scene_of(tmp_path, ball_mesh(8.0, 2.0), sheet_mesh(16.0, 4.0), elements="triangles")
    pose, codes = [[0.5, 7.8, 0.0, 0.0, 0.0, 0.0]], []
    for tolerance in (1.0, 0.01):
        model = reference_model(scene.with_tolerances(**dict.fromkeys(scene.tolerances, tolerance)))
        codes.append(cc.verify(model, pose, model).exit_code)
    assert codes == [0, 4]


def test_what_a_frame_may_be_off_by_grows_with_its_load(knee):
    """1 % of its force and 5 N, but no more than three tolerances of the scene."""
    wide = knee.scene.with_tolerances(Fy_med=13.0, Fy_lat=13.0, Fx=13.0, Fz=13.0)
    allowed = allowed_errors(wide, ["Fy_lat", "Tx"], np.array([[-600.0, -800.0], [0.0, 0.0], [-9000.0, 0.0]]))
    np.testing.assert_allclose(allowed[:, 0], [15.0, 5.0, 39.0])
    np.testing.assert_allclose(allowed[:, 1], allowed[:, 0] / 13.0 * wide.tolerances["Tx"])


def test_frames_with_load_at_an_edge_are_said(tmp_path):
    """A ball that leaves a sheet cut at x = 8 mm: with little of its load there it is verified, with much it is not."""
    model = reference_model(scene_of(tmp_path, ball_mesh(8.0, 1.0), sheet_mesh(16.0, 1.0)))
    check = cc.verify(model, [[x, 7.9, 0.0, 0.0, 0.0, 0.0] for x in (0.0, 6.0, 7.0)], model)
    assert check.verified.tolist() == [True, True, False]
    assert 0.0 == check.at_edge[0] < check.at_edge[1] < 0.05 < check.at_edge[2]
    assert "at an edge of the elements" in check.words[2]
