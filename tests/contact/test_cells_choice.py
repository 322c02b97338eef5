"""What decides how large cells may be: the joint's own size, its own motion, and elements that are sure themselves."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells import choice
from casadi_contact.contact.cells.choice import CellChoice, PressingPoses
from casadi_contact.contact.convergence import Errors, NotGoodEnoughError
from casadi_contact.core.conventions import rotation
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh

RADIUS_MM = 30.0


def test_the_choice_meets_the_tolerances_with_the_largest_cells_and_says_so():
    scene = cc.load_scene("glenohumeral")
    model = choice.cell_foundation(scene, compiled=False)
    assert model.record["cells_mm"] == [model.cells.u_mm, model.cells.v_mm]
    for name, tolerance in scene.tolerances.items():
        assert model.record["rms"][name] <= tolerance


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
    model = cc.ElasticFoundation(scene, (160, 160))
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
    """Errors at the rim grow with the size of the cells; in those of 0.85 mm they are `at_rim` tolerances, in the
    smallest half of that. Where even these are not good enough, the rest of the patch decides alone."""

    class Truth:
        unsure = 0.0

        def __init__(self, scene, choice):
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
