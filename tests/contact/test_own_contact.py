"""A user's own contact model, as a Python callable or as a table, becomes a surrogate with no elastic foundation."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.cli import pipeline
from casadi_contact.cli.tables import evaluation_tables
from casadi_contact.workflow.benchmark.front_file import read_front
from casadi_contact.workflow.benchmark.measure import measure_project
from casadi_contact.workflow.presets import PRESETS, Effort, Preset
from casadi_contact.workflow.project import read_motion
from tests.support import own_contact
from tests.support.own_contact import table_rows, write_csv

SMALL = Preset(0.1, {"patch": {"root": Effort(((10, 10),), 10.0), "ratio": Effort(((6, 6),), 2.0)}})


@pytest.fixture
def scene_file(tmp_path, monkeypatch, quick_calibration):
    monkeypatch.setitem(PRESETS, "small", SMALL)
    path = tmp_path / "socket.toml"
    path.write_text(own_contact.SCENE.to_toml())
    return path


def check_surrogate(project):
    """The surrogate and its CasADi function say what the user's own model says, and nothing out of contact."""
    surrogate = cc.load_surrogate(project.surrogate_path("patch"))
    rng = np.random.default_rng(5)
    directions = np.array([0.1, 0.9, 0.1]) + rng.uniform(-0.05, 0.05, (50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    poses = np.hstack([own_contact.CENTRE_MM + 0.44 * directions, np.zeros((50, 3))])
    want = own_contact.wrenches(poses)[:, 0]
    np.testing.assert_allclose(surrogate(poses), want, atol=0.05 * np.abs(want).max(axis=0).max())
    function = ca.Function.load(str(project.folder / "export" / "patch" / "socket.casadi"))
    np.testing.assert_allclose(function(poses[0]).full().ravel(), surrogate(poses[:1])[0], rtol=1e-10, atol=1e-9)
    inside = np.hstack([own_contact.CENTRE_MM + 0.38 * directions, np.zeros((50, 3))])
    assert not surrogate(inside).any()
    errors = pipeline.evaluate(project)
    assert errors["patch"]["D1"]["Fy"]["rms"] < 15.0
    assert len(evaluation_tables(errors, project.samples())) == 2
    assert "no picture: " in (project.folder / "report.html").read_text("utf-8"), "there is no geometry to draw"


def test_a_callable_is_sampled_trained_evaluated_and_transcribed(scene_file, tmp_path):
    model = cc.CallableModel(cc.load_scene(scene_file), own_contact.wrenches, own_contact.gaps)
    (surrogate,) = cc.build(scene_file, "small", model=model, folder=tmp_path / "out").values()
    project = pipeline.Project.open(scene_file, "small", tmp_path / "out")
    samples = project.samples()
    assert samples.provenance["models"] == "casadi_contact.contact.callable_model.CallableModel"
    assert (samples.select("D5").wrenches == 0.0).all()
    command = surrogate.record["command"]
    assert command.startswith(f"cc.build({str(scene_file)!r}, 'small', model=...)"), "no command line can"
    np.testing.assert_allclose(np.linalg.norm(samples.select("D7").wrenches[:, 0, :3], axis=1), 5.0, atol=0.01)
    check_surrogate(project)
    with pytest.raises(ValueError, match="not here: build again"):
        pipeline.calibrate(project)
    scene_file.write_text(scene_file.read_text().replace("reference_load = ", "reference_load = 2"))
    with pytest.raises(ValueError, match="trained for another scene than socket"):
        pipeline.export(pipeline.Project.open(scene_file, "small", tmp_path / "out"))


def test_a_table_is_trained_evaluated_and_transcribed(scene_file, tmp_path):
    table = write_csv(tmp_path / "samples.csv", table_rows())
    cc.build(scene_file, "small", table=table, folder=tmp_path / "out")
    project = pipeline.Project.open(scene_file, "small", tmp_path / "out")
    samples = project.samples()
    assert samples.counts()["D1"] == {"train": 972, "validation": 108, "test": 120}
    check_surrogate(project)
    assert read_front(measure_project(project)).models[0].value.low_us > 0.0, "on poses of the table"
    with pytest.raises(ValueError, match="no geometry"):
        pipeline.chart(project)
    with pytest.raises(ValueError, match="made from a table, which has no motion"):
        read_motion(project)
    assert pipeline.take_table(project, table).provenance["table"] == str(table)
    command = cc.load_surrogate(project.surrogate_path("patch")).record["command"]
    assert command == f"casadi-contact build {scene_file} --preset small --table {table} --out {project.folder}"
    with pytest.raises(ValueError, match="is of others: choose another --out"):
        pipeline.take_table(project, write_csv(tmp_path / "other.csv", table_rows(50)))
    with pytest.raises(ValueError, match=f"was made from {table} as it was before"):
        pipeline.take_table(project, write_csv(table, table_rows(50)))


def test_a_gap_is_never_beyond_the_reach():
    scene = cc.load_scene("sphere_on_plane")
    model = cc.CallableModel(scene, lambda poses: np.zeros((len(poses), 1, 6)), approach_mm=0.4, reach_mm=1.0)
    np.testing.assert_allclose(model.gaps(scene.start_pose), 1.0)
