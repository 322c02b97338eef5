"""A draw that is resumed goes on around the motion it began with, and with the contact model it began with."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.presets import Preset
from casadi_contact.workflow.project import Project, read_motion
from casadi_contact.workflow.stages import sample, take_table
from tests.support import own_contact

COUNTS = {"D1": 60, "D2": 0, "D3": 60, "D4": 0, "D5": 15, "D6": 0, "D7": 10}


@pytest.fixture
def project(tmp_path):
    text = own_contact.SCENE.with_overrides(counts=COUNTS).to_toml()
    scene = Scene.from_toml(text.replace("liftoff_mm", "chunk_size = 20\nframes = 11\nliftoff_mm"))
    return Project(scene, "own", tmp_path, own=Preset(1.0, {}))


def model(project, factor=1.0, wrenches=own_contact.wrenches, gaps=own_contact.gaps):
    return cc.CallableModel(project.scene, lambda poses: factor * wrenches(poses), gaps)


def drawn(project, model, stop_at=None):
    def update(what, done, total, remark):
        if what == "samples" and done == stop_at:
            raise ZeroDivisionError

    sample(project, [], update, None, model)
    return project.samples()


def stopped(project, model, chunks=4):
    with pytest.raises(ZeroDivisionError):
        drawn(project, model, chunks)


def test_a_model_that_no_two_runs_give_alike_goes_on_around_the_motion_it_began_with(project):
    stopped(project, model(project, 1.0005))
    before = read_motion(project).motion
    samples = drawn(project, model(project, 0.9995))
    np.testing.assert_array_equal(read_motion(project).motion.poses, before.poses)
    assert len(samples) == sum(COUNTS.values())
    np.testing.assert_array_equal(drawn(project, model(project, 1.0)).poses, samples.poses)


def test_samples_are_kept_where_more_may_be_dropped(project):
    """The cure that the refusal names costs no evaluation but the few that ask whether the model is still the same."""
    asked = []

    def fails_turned(poses):
        asked.append(len(poses))
        return np.where(poses[:, 5, None, None] > 0.2, np.nan, own_contact.wrenches(poses))

    def allowing(most_dropped):
        text = project.scene.to_toml().replace("liftoff_mm", f"most_dropped = {most_dropped}\nliftoff_mm")
        allowed = replace(project, scene=Scene.from_toml(text))
        return drawn(allowed, model(allowed, wrenches=fails_turned))

    with pytest.raises(ValueError, match="most_dropped"):
        allowing(0.0)
    kept = project.samples_path.read_bytes()
    asked.clear()
    assert 0 < len(allowing(1.0)) < sum(COUNTS.values())
    assert project.samples_path.read_bytes() == kept
    assert sum(asked) <= 10


def test_a_model_that_fails_now_and_then_costs_samples_and_ends_nothing(project):
    """A hundredth of its evaluations gives no numbers, while bodies are lifted off, too."""
    rng = np.random.default_rng(0)

    def fails(poses):
        loads = own_contact.wrenches(poses)
        loads[rng.random(len(poses)) < 0.01] = np.nan
        return loads

    scene = project.scene.with_overrides(counts=COUNTS | {"D5": 300})
    many = Project(scene, "own", project.folder, own=Preset(1.0, {}))
    samples = drawn(many, model(many, wrenches=fails))
    assert np.isfinite(samples.wrenches).all()
    dropped = samples.provenance["dropped"]["D5"]
    assert dropped["not lifted off"] > 0
    assert len(samples.select("D5")) > 150


def twisted(poses):
    """The same forces, and so the same motion, but 50 N·mm more of a torque in contact."""
    loads = own_contact.wrenches(poses)
    loads[..., 4] += np.where(loads[..., 1] != 0.0, 50.0, 0.0)
    return loads


NOTHING = {"wrenches": lambda poses: np.full((len(poses), 1, 6), np.nan)}


@pytest.mark.parametrize(
    ("changed", "said", "whole"),
    [({"factor": 1.1}, "F", True), ({"wrenches": twisted}, "Ty", False), (NOTHING, "nan", False)],
)
def test_samples_of_a_model_that_has_changed_since_are_refused(project, changed, said, whole):
    if whole:
        drawn(project, model(project))
    else:
        stopped(project, model(project), chunks=7)  # of 8, those without load among them
    before = {path: path.read_bytes() for path in project.folder.rglob("*") if path.is_file()}
    with pytest.raises(ValueError, match=rf"another contact model: .*{said}") as error:
        drawn(project, model(project, **changed))
    assert "\n" not in str(error.value)
    assert {path: path.read_bytes() for path in before} == before


def test_a_damaged_motion_is_refused_and_a_table_leaves_none_behind(project, tmp_path):
    stopped(project, model(project))
    project.motion_path.write_bytes(project.motion_path.read_bytes()[:300])
    with pytest.raises(ValueError, match=r"motion\.npz is damaged"):
        drawn(project, model(project))
    take_table(project, own_contact.write_csv(tmp_path / "table.csv", own_contact.table_rows(60)))
    assert not project.motion_path.exists()
