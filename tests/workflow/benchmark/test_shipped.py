"""Before anything is built, the shipped surrogates of a scene and their measured front serve it."""

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.cli import pipeline
from casadi_contact.core.quantities import quantity
from casadi_contact.samples.samples import load_errors
from casadi_contact.workflow.benchmark.front_file import shipped_front
from casadi_contact.workflow.benchmark.measure import unseen_walking
from casadi_contact.workflow.project import Project, available_surrogates, built_in_motion
from tests.support.own_contact import SCENE as SOCKET


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A knee in an empty folder."""
    return Project.open("knee", "quick", tmp_path_factory.mktemp("fresh"))


@pytest.fixture(scope="module")
def motion(project):
    return built_in_motion(project.scene)


def test_its_errors_on_unseen_walking_are_those_of_the_surrogates_that_are_shipped_and_of_the_readme(project, motion):
    """The front's within 5 %; the README's within a factor of 1.3 either way, in forces and in torques."""
    _, front = shipped_front(project.scene)
    poses = unseen_walking(cc.ElasticFoundation(project.scene, project.scene.grids["settle"]), motion)
    loads = cc.ElasticFoundation(project.scene, (320, 160))(poses)
    assert front.header["walking_poses"] == str(len(poses))
    assert front.header["processor"]
    rms = {}
    for point in (point for point in front.points if point.name in ("knee", "knee_two_stage")):
        surrogate = cc.load_surrogate(point.name)
        errors: dict[str, list[float]] = {"force": [], "torque": []}
        for load, error in load_errors(surrogate.load_names, surrogate(poses), loads).items():
            errors[quantity(load).kind.name].append(error["rms"])
        rms[point.name] = {kind: np.sqrt(np.mean(np.square(values))) for kind, values in errors.items()}
        said = f"measure the front of {point.name} again"
        assert point.force_rms_n == pytest.approx(rms[point.name]["force"], rel=0.05), said
    readme = (Path(__file__).parents[3] / "README.md").read_text("utf-8")
    (line,) = re.findall(r"RMS error of `knee` on (\d+) unseen poses of walking \| ([\d.]+) N, ([\d.]+) N·mm", readme)
    assert int(line[0]) == len(poses)
    for kind, stated in zip(("force", "torque"), line[1:], strict=True):
        assert float(stated) / 1.3 <= rms["knee"][kind] <= 1.3 * float(stated)


@pytest.mark.usefixtures("as_shipped")  # which model is the fastest is what users get told
def test_a_choice_names_a_model_that_comes_with_the_library_and_the_machine(project):
    choice = cc.choose("knee", force_tolerance_n=0.3, torque_tolerance_nmm=10.0, folder=project.folder)
    _, front = shipped_front(project.scene)
    assert choice.model.name.startswith("knee")
    assert front.header["processor"] in choice.measured
    function = eval(choice.python, {"cc": cc})
    pose = [0.5, 27.35, 0.1, 0.0, -0.05, -0.3]
    expected = cc.load_surrogate("knee")([pose])[0][: len(choice.loads)]
    np.testing.assert_allclose(function(pose).full().ravel(), expected, rtol=1e-9)


def test_the_shipped_surrogates_are_exported_and_their_example_pose_is_in_contact(project, motion, monkeypatch):
    monkeypatch.setattr(pipeline, "available_poses", lambda project: motion.poses[0])
    paths = pipeline.export(project)
    function = ca.Function.load(str(project.folder / "export" / "patch" / "knee.casadi"))
    pose = motion.poses[0, 25]
    np.testing.assert_allclose(function(pose).full().ravel(), cc.load_surrogate("knee")([pose])[0], rtol=1e-9)
    assert function(pose).full()[0] < -50.0
    assert {path.parent.name for path in paths} == {"patch", "two_stage"}


def test_a_folder_with_samples_speaks_for_itself_and_another_scene_has_nothing_shipped(tmp_path):
    assert shipped_front(cc.load_scene("knee", settle=(40, 20))) is None
    with pytest.raises(ValueError, match=r"scene socket .* has no geometry"):
        built_in_motion(SOCKET)
    project = Project.open("knee", "quick", tmp_path)
    assert set(available_surrogates(project)) == {"patch", "two_stage"}
    project.samples_path.write_bytes(b"begun")
    with pytest.raises(FileNotFoundError, match=r"run casadi-contact train knee --preset quick --out .* first"):
        available_surrogates(project)
    with pytest.raises(ValueError, match="damaged"):
        cc.choose("knee", force_tolerance_n=1.0, torque_tolerance_nmm=50.0, folder=tmp_path)
