"""The whole chain at small scale: sample, train, calibrate, evaluate, export, report."""

import csv
import html
import logging
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.cli import pipeline
from casadi_contact.workflow import stages as sampling
from casadi_contact.workflow.benchmark.front_file import read_front
from casadi_contact.workflow.presets import PRESETS, Effort, Preset
from casadi_contact.workflow.project import project_surrogates

SMALL = Preset(
    sampling_scale=0.012,
    efforts={
        "patch": {"root": Effort(((12, 12),), 4.0), "ratio": Effort(((6, 6),), 0.5)},
        "two_stage": {"": Effort(((8,),), 0.5, "tanh", max_rows=500)},
    },
)


@pytest.fixture(scope="module")
def warned():
    """What training logs as warnings, one line for each structure."""
    return []


@pytest.fixture(scope="module")
def project(tmp_path_factory, warned, quick_calibration):
    """A project with everything built in it, its scene with coarser grids than the real one."""
    folder = tmp_path_factory.mktemp("small")
    text = cc.load_scene("knee", settle=(40, 20), teacher=(80, 40)).to_toml()
    (folder / "knee.toml").write_text(text)
    PRESETS["small"] = SMALL
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(1) as here:
        patch.setitem(PRESETS, "small", SMALL)
        patch.setattr("casadi_contact.workflow.benchmark.candidates.foundation_ladder", lambda scene: ())
        made = pipeline.Project.open(folder / "knee.toml", "small", folder / "out")
        sampling.sample(made, executor=here)
        log, handler = logging.getLogger("casadi_contact.workflow.fitting"), logging.Handler(logging.WARNING)
        handler.emit = lambda record: warned.append(record.getMessage())
        log.addHandler(handler)
        pipeline.train(made, executor=here)
        log.removeHandler(handler)
        pipeline.evaluate(made)
        pipeline.export(made)
        pipeline.report(made)
        yield made


def test_the_report_gives_every_surrogate_s_verdict_on_one_page(project):
    text = (project.folder / "report.html").read_text("utf-8")
    for structure, surrogate in project_surrogates(project).items():
        assert html.escape(f"{structure}: {surrogate.info().fitness}") in text
    assert "data:image/png" in text


def test_the_surrogate_learned_its_elastic_foundation(project):
    with (project.folder / "evaluation.csv").open(encoding="utf-8") as file:
        rows = {(row["model"], row["domain"], row["load"]): row for row in csv.DictReader(file)}
    assert float(rows["patch", "D1", "Fy_med"]["rms"]) < 30.0
    assert float(rows["patch", "D5", "Fy_med"]["max"]) == float(rows["patch", "D5", "Tz"]["max"]) == 0.0
    assert ("EF 80×40", "D1", "Tz") in rows
    front = read_front(project.folder / "speed_accuracy.csv")
    assert {"EF 40×30", "EF 80×40", "own patch", "own two_stage"} <= {point.name for point in front.models}
    assert front.header["processor"]


def test_fits_that_used_up_their_budget_say_so_in_one_warning_and_in_info(project, warned):
    assert [line.partition(":")[0] for line in warned] == ["patch", "two_stage"]
    with pytest.warns(UserWarning, match="not fit for use: D1"):
        info = cc.load_surrogate(project.surrogate_path("two_stage")).info()
    assert info.samples["D1"] > 100
    assert info.test_errors["D1"]["Fy_med"]["rms"] > 0.0
    assert f"casadi-contact build {project.given} --preset small" in str(info)
    reasons, used = info.record["stop_reasons"], info.record["gflop"]
    ended = [name for name, reason in reasons.items() if reason == "budget used"]
    assert ended
    line = f"budget used up in {len(ended)} of {len(reasons)} fits, more may fit better: {', '.join(ended)}"
    assert warned[1] == f"two_stage: {line}"
    assert str(info).count(line) == 1
    assert all(used[name] >= 0.5 for name in ended)
    assert all(seconds >= 0.0 for seconds in info.record["seconds"].values())


def test_it_says_where_it_is_out_of_its_depth_and_a_rerun_calibrates_to_the_same(project):
    samples = project.samples()
    low, high = samples.poses.min(axis=0), samples.poses.max(axis=0)
    for structure in ("patch", "two_stage"):
        surrogate = cc.load_surrogate(project.surrogate_path(structure))
        far = surrogate.validity([high + (high - low)])[0]  # networks this small are wrong at most poses, and say so
        assert far < 0.5 * surrogate.validity(samples.poses).max()
        assert 0.8 < surrogate.info().coverage["D1"]["Fy_med"] <= 1.0
    before, content = cc.load_surrogate(project.surrogate_path("patch")), project.samples_path.read_bytes()
    sampling.sample(project)
    with ThreadPoolExecutor(1) as here:
        pipeline.train(project, executor=here, structure="patch")
    after, poses = cc.load_surrogate(project.surrogate_path("patch")), samples.poses[:50]
    assert project.samples_path.read_bytes() == content
    np.testing.assert_array_equal(after(poses), before(poses))
    np.testing.assert_array_equal(after.expected_error(poses), before.expected_error(poses))


def test_samples_of_another_scene_are_refused(project, tmp_path):
    shutil.copytree(project.folder, tmp_path / "out")
    other = pipeline.Project.open("knee", "quick", tmp_path / "out")
    with pytest.raises(ValueError, match="holds samples of another scene"):
        pipeline.train(other)
    with pytest.raises(FileNotFoundError, match=r"run casadi-contact build knee --preset quick --out .* first"):
        project_surrogates(pipeline.Project.open("knee", "quick", tmp_path / "empty"))
