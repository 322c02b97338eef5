"""Sensitive directions: ranked by the loads they change, in units that compare."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.reference import found_sensitive_pose
from casadi_contact.samples.settings import SamplePoint
from casadi_contact.scenes.walking import reference_motion_cycles
from casadi_contact.workflow.project import Project
from tests.support.ready_poses import at


def test_a_sphere_on_a_plane_feels_its_height_and_nothing_else_as_much():
    found = cc.sensitive_directions(cc.ElasticFoundation(cc.load_scene("sphere_on_plane")), at(29.9)[0])
    assert found.names[0] == "ty"
    assert max(found.stiffness[name] for name in ("rx", "ry", "rz")) < 1e-3 * found.stiffness["ty"]
    np.testing.assert_allclose(np.abs(found.directions[0]), [0, 1, 0, 0, 0, 0], atol=1e-2)
    assert "ty" in str(found).splitlines()[1]


def test_directions_are_those_of_the_scaled_jacobian():
    model = cc.ElasticFoundation(cc.load_scene("knee"), (40, 20))
    pose, _ = cc.settle(model, [[0.5, 27.4, 0.1, 0.0, -0.05, -0.3]], ("ty", "rx"), {"Fy_med": -700.0, "Fy_lat": -500.0})
    found = cc.sensitive_directions(model, pose[0], lever_mm=20.0)
    np.testing.assert_allclose(found.directions @ found.directions.T, np.eye(6), atol=1e-12)
    assert (np.diff(found.stiffnesses) <= 0.0).all()
    forces = np.array([name.startswith("F") for name in model.load_names])
    for direction, stiffness in zip(found.directions, found.stiffnesses, strict=True):
        motion = direction / [1, 1, 1, 20, 20, 20]
        change = model.jacobian(pose)[1][0] @ motion
        assert np.linalg.norm(np.where(forces, change, change / 20.0)) == pytest.approx(stiffness, abs=1e-6)
    assert sum(v**2 for v in found.stiffness.values()) == pytest.approx((found.stiffnesses**2).sum())


@pytest.mark.parametrize(
    ("name", "sensitive"),
    [("knee", ("ty", "rx")), ("hip", ("tx", "ty", "tz")), ("patellofemoral", ("tx", "tz")), ("glenohumeral", ("tz",))],
)
def test_those_found_are_those_declared(name, sensitive):
    scene = cc.load_scene(name)
    assert scene.sensitive_pose in ((), sensitive)
    model = cc.ElasticFoundation(scene, scene.grids["coarse"])
    assert found_sensitive_pose(model, reference_motion_cycles(scene, ())) == sensitive


def test_a_project_finds_what_its_scene_leaves_out(tmp_path):
    assert cc.load_scene("glenohumeral").sensitive_pose == ()
    project = Project.open("glenohumeral", "quick", tmp_path)
    assert project.scene.sensitive_pose == ("tz",)
    assert Project.open("glenohumeral", "quick", tmp_path).scene == project.scene
    other = tmp_path / "other.toml"
    other.write_text(cc.load_scene("glenohumeral", ball_radius=23.0).to_toml())
    assert Project.open(other, "quick", tmp_path).scene.geometry["ball_radius"] == 23.0
    with pytest.raises(ValueError, match="has no sensitive_pose"):
        SamplePoint.of_scene(cc.load_scene("glenohumeral"))
