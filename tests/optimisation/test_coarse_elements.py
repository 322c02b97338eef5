"""Elements that are too coarse for a pose verify nothing there: finer ones of the same scene would say otherwise."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.verification import verify as coarse_elements
from casadi_contact.optimisation.verification.verdict import Verdict, check_solution, reference_model
from casadi_contact.optimisation.verification.verify import off_finer
from tests.support.meshes import ball_mesh, scene_of, sheet_mesh

POSE = np.array([0.7, 27.3, 0.1, 0.002, -0.04, -0.5])
LIFTED = POSE + np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0])


def with_teacher(grid):
    return reference_model(cc.load_scene("knee").with_overrides(teacher=grid))


def test_a_frame_on_elements_that_are_too_coarse_is_solved_and_not_verified():
    model = with_teacher((20, 15))
    verdict = check_solution(model, [POSE, LIFTED], True, model)
    assert verdict.verified.tolist() == [False, True], "where nothing touches any elements do"
    assert verdict.exit_code == 3
    assert verdict.doubt == "the contact model is too coarse there"
    finer = with_teacher((40, 30))
    off = np.abs(model([POSE]) - finer([POSE]))[0] / verdict.allowed
    assert f"({model.load_names[off.argmax()]})" in verdict.words[0]
    assert verdict.words[0].startswith("solved, elements half as wide differ by ")
    assert "1 solved, but where elements half as wide differ, at most by" in str(verdict)


def test_what_elements_are_off_by_is_what_finer_ones_say():
    model, finer = with_teacher((20, 15)), with_teacher((40, 30))
    np.testing.assert_allclose(
        off_finer(model, np.array([POSE]), model.load_names, np.zeros(len(model.load_names))),
        model([POSE]) - finer([POSE]),
        atol=1e-9,
    )


def test_where_finer_elements_would_be_too_many_wider_ones_stand_in(monkeypatch):
    model, wider = with_teacher((20, 14)), with_teacher((10, 7))
    monkeypatch.setattr(coarse_elements, "MOST_ELEMENTS", 4 * 20 * 14 - 1)
    allowed = np.zeros(len(model.load_names))
    np.testing.assert_allclose(
        off_finer(model, np.array([POSE]), model.load_names, allowed), model([POSE]) - wider([POSE]), atol=1e-9
    )


def test_of_elements_that_are_the_mesh_s_own_triangles_nothing_tells(tmp_path):
    scene = scene_of(tmp_path, ball_mesh(8.0, 1.0), sheet_mesh(16.0, 2.0), elements="triangles")
    model, pose = reference_model(scene), np.array([[0.5, 7.8, 0.0, 0.0, 0.0, 0.0]])
    assert off_finer(model, pose, model.load_names, np.zeros(6)) is None
    assert check_solution(model, pose, True, model).exit_code == 0


def test_a_difference_that_is_no_number_verifies_nothing():
    unknown = np.full((1, 1), np.nan)
    verdict = Verdict(
        ("Fy",), np.array([True]), np.zeros((1, 1)), np.ones(1), "EF", np.array([False]), off_finer=unknown
    )
    assert not verdict.verified.any()


def test_elements_that_are_fine_enough_verify():
    model = with_teacher((160, 80))
    assert check_solution(model, [POSE, LIFTED], True, model).exit_code == 0


@pytest.mark.parametrize("solved", [[True, False], [False, True]])
def test_frames_that_are_not_solved_are_not_said_to_be_on_coarse_elements(solved):
    model = with_teacher((20, 15))
    verdict = check_solution(model, [POSE, POSE], solved, model)
    assert [word.startswith("solved, elements") for word in verdict.words] == solved
    assert verdict.exit_code == 2
