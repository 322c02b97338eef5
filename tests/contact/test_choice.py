"""How a foundation is chosen: what decides, poses that press, and the record that is kept."""

import json
import os

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact import choice as choices
from casadi_contact.contact.cells import choice
from casadi_contact.contact.cells.choice import CellChoice, PressingPoses
from casadi_contact.contact.convergence import Errors, NotGoodEnoughError
from casadi_contact.core.conventions import rotation
from casadi_contact.scenes.tolerance import Tolerance
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh


def errors(of_tolerance, at_rim, forces_n=100.0):
    """Errors of the load Fy in n poses, in tolerances; all other loads are exact."""
    scene = cc.load_scene("sphere_on_plane")
    of_fy = scene.tolerances["Fy"] * np.array([name == "Fy" for name in scene.load_names])
    return Errors(scene, np.outer(of_tolerance, of_fy), np.full(len(of_tolerance), forces_n), np.array(at_rim))


def test_poses_at_the_rim_decide_nothing_and_the_record_says_which_share_exceeds():
    found = errors([0.5, 0.1, 0.3, 0.5, 9.0, 0.2, 5.0, 1.0], [False] * 4 + [True] * 4)
    assert found.ratio == pytest.approx(np.sqrt((0.5**2 + 0.1**2 + 0.3**2 + 0.5**2) / 4.0))
    assert found.ratio_at_rim == pytest.approx(np.sqrt((81.0 + 0.04 + 25.0 + 1.0) / 4.0))
    record, tolerance = found.record(model="cells"), found.scene.tolerances["Fy"]
    assert (record["model"], record["poses"], record["exceeding_at_rim"]) == ("cells", 8, 0.5)
    assert record["largest"]["Fy"] == pytest.approx(0.5 * tolerance)


def test_a_single_error_may_be_larger_where_the_force_is():
    reference = cc.load_scene("sphere_on_plane").reference_load
    light, heavy = (errors([Tolerance.single, *[0.0] * 15], [False] * 16, n * reference) for n in (1.0, 2.0))
    assert light.ratio == pytest.approx(1.0)
    assert heavy.ratio == pytest.approx(Tolerance.single / 4.0)  # the RMS of sixteen


RADIUS_MM = 30.0


def test_the_choice_meets_the_tolerances_with_the_largest_cells_and_says_so():
    scene, few = cc.load_scene("sphere_on_plane"), CellChoice(elements=(120, 120), half=(60, 60), tries=32)
    model = choice.cell_foundation(scene, compiled=False, choice=few)
    assert model.record["cells_mm"] == [model.cells.u_mm, model.cells.v_mm]
    assert all(model.record["rms"][name] <= tolerance for name, tolerance in scene.tolerances.items())


def test_a_body_turns_about_its_anchor_however_far_its_frame_lies(tmp_path):
    """A ball is pressed near the place where it lay; turned about an origin 50 mm away it would swing off the patch."""
    points, faces = cap_mesh(RADIUS_MM, 2.0, 1.5)
    centre = [0.0, 50.0, 0.0]
    start_pose = [0.0, RADIUS_MM - centre[1], 0.0, 0.0, 0.0, 0.0]
    extra = f"start_pose = {start_pose}\n[geometry.patches.contact]\nanchor = {centre}\n"
    scene = scene_of(tmp_path, (points + centre, faces), sheet_mesh(20.0, 2.0), extra=extra)
    poses = PressingPoses().pressed(cc.ElasticFoundation(scene, (40, 40)), 0, (5.0, 500.0), 40)
    assert len(poses) > 30
    assert np.ptp(poses[:, 5]) > 1.0
    middles = poses[:, :3] + rotation(poses[:, 3:]) @ centre
    assert np.abs(middles[:, [0, 2]]).max() < 0.2 * 20.0


def test_some_bodies_sit_as_the_start_pose_does_under_light_and_heavy_loads(tmp_path):
    start_pose = [1.0, RADIUS_MM, -2.0, 0.1, 0.0, 0.0]
    scene = scene_of(tmp_path, cap_mesh(RADIUS_MM, 2.0, 1.5), sheet_mesh(20.0, 2.0), extra=f"start_pose = {start_pose}")
    model = cc.ElasticFoundation(scene, (80, 80))
    poses = PressingPoses().seated(model, 0, (5.0, 500.0))
    still = poses[(poses[:, 3:] == start_pose[3:]).all(axis=1)]
    assert len(still) == PressingPoses.seats // 2
    np.testing.assert_allclose(still[:, [0, 2]], np.tile([1.0, -2.0], (len(still), 1)), atol=1e-3)
    forces = -model(still, ["Fy"])[:, 0]
    np.testing.assert_allclose(forces[[0, -1]], [5.0, 500.0], rtol=0.3)


def test_poses_at_which_elements_are_unsure_themselves_decide_nothing():
    scene = cc.load_scene("sphere_on_plane")
    with pytest.raises(NotGoodEnoughError, match="differ by more than its tolerances allow in every pose"):
        choice.cell_foundation(scene, compiled=False, choice=CellChoice(half=(2, 2)))


@pytest.mark.parametrize(("at_rim", "chosen"), [(1.0, 0.85), (3.0, 2.4)])
def test_the_rim_decides_where_some_cells_are_good_enough_there(monkeypatch, at_rim, chosen):
    """In cells of 0.85 mm errors at the rim are `at_rim` tolerances, in the smallest half of that."""

    class Truth:
        unsure = 0.0

        def __init__(self, scene, choice, given):
            self.scene = scene

        def errors(self, cells):
            tolerances = np.array([self.scene.tolerances[name] for name in self.scene.load_names])
            size = max(cells.u_mm, cells.v_mm)
            of_tolerance = np.array([0.1, 0.1, 0.1, at_rim * size / 0.85])
            return Errors(self.scene, of_tolerance[:, None] * tolerances, np.full(4, 100.0), np.arange(4) == 3)

    monkeypatch.setattr(choice, "_Truth", Truth)
    scene = cc.load_scene("sphere_on_plane", patch_side=60.0)
    cells = choice.cell_foundation(scene, compiled=False).cells
    assert (cells.u_mm, cells.v_mm) == (chosen, chosen)


@pytest.mark.parametrize(("tolerance", "anew"), [(1e4, False), (1e-6, True)])
def test_cells_are_chosen_anew_where_they_miss_the_poses_of_a_cycle(monkeypatch, tolerance, anew):
    scene, asked = cc.load_scene("sphere_on_plane"), []
    coarse = cc.CellFoundation(scene.with_tolerances(**dict.fromkeys(scene.load_names, tolerance)), compiled=False)
    monkeypatch.setattr(choices, "_chosen", lambda *_: coarse)
    monkeypatch.setattr(choices, "cell_foundation", lambda _, poses, **options: asked.append(poses) or coarse)
    poses = [[0.3, 29.9, 0.0, 0.0, 0.0, 0.0]]
    assert cc.foundation(scene, compiled=False, poses=poses) is coarse
    assert [given.tolist() for given in asked] == ([poses] if anew else [])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CASADI_CONTACT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def tests_run(monkeypatch):
    """The scenes that a convergence test ran for."""
    ran = []

    def counted(choose):
        def chosen(scene, **options):
            ran.append(scene)
            return choose(scene, **options)

        return chosen

    kinds = {shape: kind._replace(chosen=counted(kind.chosen)) for shape, kind in choices._KINDS.items()}
    monkeypatch.setattr(choices, "_KINDS", kinds)
    return ran


@pytest.mark.parametrize("name", ["sphere_on_plane", "glenohumeral"])
def test_a_second_model_of_a_scene_is_the_first_without_a_test(folder, tests_run, name):
    first, again = (cc.foundation(name, compiled=False) for _ in range(2))
    assert len(tests_run) == 1
    assert (repr(again), again.record) == (repr(first), first.record)
    pose = first.scene.start_pose
    np.testing.assert_array_equal(again.gaps(pose), first.gaps(pose))
    assert len(list(folder.glob("choice-*.json"))) == 1
    load = first.load_names[0]
    cc.foundation(first.scene.with_overrides(**{load: 2.0 * first.scene.tolerances[load]}), compiled=False)
    assert len(tests_run) == len(list(folder.glob("choice-*.json"))) == 2, "other tolerances are tested themselves"


OF_CELLS = json.dumps({"model": "cubic cells", "cells_mm": [9.0, 9.0]}).encode()


@pytest.mark.parametrize("damage", [lambda content: content[:-20], lambda _: OF_CELLS, lambda _: b"[1, 2]"])
def test_a_file_that_is_not_as_written_is_replaced(folder, tests_run, damage, monkeypatch):
    first = cc.foundation("hip", compiled=False)
    (path,) = folder.glob("choice-*.json")
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    assert cc.foundation("hip", compiled=False).record == first.record
    assert (len(tests_run), path.read_bytes()) == (2, whole)
    (folder.parent / "file").write_text("no folder")
    monkeypatch.setenv("CASADI_CONTACT_CACHE", str(folder.parent / "file" / "cache"))
    assert cc.foundation("hip", compiled=False).record == first.record, "nor where no folder can be written"
    assert len(tests_run) == 3


@pytest.mark.skipif(os.name != "posix", reason="permissions as POSIX has them")
def test_what_another_user_could_have_written_is_not_taken(folder, tests_run):
    first = cc.foundation("hip", compiled=False)
    (path,) = folder.glob("choice-*.json")
    planted = first.record | {"points": 2 * first.record["points"]}
    path.write_bytes(json.dumps(planted).encode())
    assert cc.foundation("hip", compiled=False).record == planted, "what others must not be able to do"
    for private, open_to_all in ((path, 0o666), (folder, 0o777)):
        path.write_bytes(json.dumps(planted).encode())
        before = private.stat().st_mode
        private.chmod(open_to_all)
        assert cc.foundation("hip", compiled=False).record == first.record
        private.chmod(before)
