"""Every frame of a solution is told apart: verified on the contact model, different there, unsolved, or not checked."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import pose_index
from casadi_contact.optimisation.verification.verdict import check_solution, reference_model

POSE = np.array([0.7, 27.3, 0.1, 0.002, -0.04, -0.5])


@pytest.fixture(scope="module")
def foundation(knee):
    return reference_model(knee.scene)


def softer(knee, foundation, share):
    """The scene's own model with loads changed by a share of themselves."""
    return cc.CallableModel(knee.scene, lambda poses: (1.0 + share) * foundation.wrenches(poses))


def test_a_scene_s_own_model_is_its_finest_foundation(knee, foundation):
    assert foundation.grid == tuple(knee.scene.grids["teacher"])


def test_frames_that_the_contact_model_confirms_are_verified(knee, foundation):
    verdict = check_solution(knee, np.tile(POSE, (3, 1)), [True] * 3, foundation)
    assert verdict.words == ["solved and verified"] * 3
    assert verdict.exit_code == 0
    assert str(verdict) == "3 of 3 solved and verified on EF 320×160"


def test_a_frame_that_the_contact_model_denies_is_named_with_its_error(knee, foundation):
    poses = np.tile(POSE, (2, 1))
    poses[1, pose_index("ty")] += 1.0  # out of contact, where nothing can differ
    verdict = check_solution(knee, poses, [True, True], softer(knee, foundation, 0.5))
    assert verdict.words[0].startswith("solved, differs by ")
    assert verdict.words[1] == "solved and verified"
    assert verdict.exit_code == 3
    assert "1 solved but differ, at most by" in str(verdict)


def test_the_error_named_is_the_largest_against_its_tolerance(knee, foundation):
    loads, model = knee(POSE[None])[0], softer(knee, foundation, 0.5)
    verdict = check_solution(knee, POSE[None], [True], model)
    expected = np.abs(loads - model(POSE[None])[0]) / [knee.scene.tolerances[name] for name in knee.load_names]
    worst = knee.load_names[int(expected.argmax())]
    assert f"({worst})" in verdict.words[0]


@pytest.mark.parametrize(("share", "verified"), [(2.9, True), (3.1, False)])
def test_a_frame_may_be_off_by_three_times_the_scene_s_tolerance(knee, share, verified):
    class Off:
        load_names = knee.load_names

        def __call__(self, poses):
            return knee(poses) + share * np.array([knee.scene.tolerances[name] for name in knee.load_names])

    assert check_solution(knee, POSE[None], [True], Off()).verified.all() == verified


def test_unsolved_frames_come_first_in_the_exit_code(knee, foundation):
    verdict = check_solution(knee, np.tile(POSE, (2, 1)), [False, True], softer(knee, foundation, 0.5))
    assert verdict.words[0] == "not solved"
    assert verdict.exit_code == 2
    assert str(verdict).endswith("1 not solved")


def test_only_the_loads_that_a_problem_uses_are_judged(knee):
    class Twisted:
        load_names = knee.load_names

        def __call__(self, poses):
            return knee(poses) + np.where([name == "Ty" for name in knee.load_names], 1e4, 0.0)

    assert check_solution(knee, POSE[None], [True], Twisted(), ("Fy_med", "Fy_lat")).exit_code == 0
    assert check_solution(knee, POSE[None], [True], Twisted()).exit_code == 3


def test_a_model_that_gives_no_number_confirms_nothing(knee):
    class Silent:
        load_names = knee.load_names

        def __call__(self, poses):
            return np.where(poses[:, :1] > 1.0, np.nan, knee(poses))

    poses = np.tile(POSE, (2, 1))
    poses[1, 0] = 2.0
    verdict = check_solution(knee, poses, [True, True], Silent())
    assert verdict.verified.tolist() == [True, False]
    assert verdict.exit_code == 3
    nowhere = check_solution(knee, poses[1:], [True], Silent())
    assert nowhere.checked
    assert nowhere.exit_code == 3
    assert nowhere.words == ["solved, differs by inf N (Fy_med)"]


def test_every_frame_has_a_word_on_whether_it_is_solved(knee):
    poses = np.tile(POSE, (3, 1))
    assert str(check_solution(knee, poses, True, knee)).startswith("3 of 3 solved and verified")
    for words in ({"solved": [True]}, {"solved": [True] * 2}, {"solved": True, "on_model": [True]}):
        with pytest.raises(ValueError, match="poses"):
            check_solution(knee, poses, model=knee, **words)


def test_a_scene_without_a_model_of_its_own_says_so(knee):
    table = knee.scene.tables | {"shape": "own_model", "geometry": {"patches": {"med": {}, "lat": {}}}}
    scene = cc.Scene.from_tables({key: value for key, value in table.items() if key not in ("material", "grids")})
    reason = reference_model(scene)
    assert "no contact model at hand" in reason
    verdict = check_solution(knee, POSE[None], [True], reason)
    assert verdict.words == ["solved, not checked"]
    assert str(verdict).startswith("1 of 1 solved, not checked: the scene knee has no contact model at hand")
    assert verdict.exit_code == 0


def test_without_a_model_to_ask_the_surrogate_says_what_it_expects_of_itself(knee):
    far = POSE.copy()
    far[5] -= 2.0
    poses = np.array([POSE, far])
    inside, outside = knee.expected_error(poses) / (3.0 * np.array([knee.scene.tolerances[n] for n in knee.load_names]))
    assert outside.max() > 1.0 > inside.max()
    for solved, shares, pose in ((True, outside, far), ([True, False], inside, POSE)):
        load = int(shares.argmax())
        said = str(check_solution(knee, poses, solved, "no model")).partition(
            "; the surrogate itself expects errors up to "
        )[2]
        value, _, rest = said.partition(" ")
        np.testing.assert_allclose(float(value), knee.expected_error(pose[None])[0, load], rtol=0.01)
        assert f"({knee.load_names[load]}, {3.0 * knee.scene.tolerances[knee.load_names[load]]:g} allowed)" in rest
    assert "expects" not in str(check_solution(knee, poses, [False, False], "no model"))
    assert "expects" not in str(check_solution(knee, poses[:1], True, knee))
    untrusted = type(knee)(knee.scene, knee.networks, knee.record)
    for alone in (False, [True, False]):
        said = str(check_solution(untrusted, poses, True, "no model", on_model=alone))
        assert said.startswith("2 of 2 solved, not checked: no model")
