"""The study of a surrogate's whole reach: errors by domain, over valid poses, and coverage."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.samples.samples import TEST, Samples, write_samples
from problems.studies import whole_reach
from problems.studies.whole_reach import app, reach_record


@pytest.fixture(scope="module")
def samples():
    """Of the foundation, around poses of walking, each ten times: two valid ones in D1, and in D3 a valid one and one
    metres away. Of fewer than ten no share is given."""
    model = cc.foundation("knee")
    poses = np.array([[0.5, 27.23, 0.1, 0.0, -0.05, -0.3], [0.3, 27.3, 0.0, 0.01, -0.04, -0.4]])
    poses = np.vstack([poses, [0.4, 27.25, 0.0, 0.0, -0.05, -0.35], [0.5, 3000.0, 0.1, 0.0, -0.05, -0.3]])
    poses, domain = np.tile(poses, (10, 1)), np.tile(np.array([1, 1, 3, 3], dtype=np.uint8), 10)
    role = np.full(len(poses), TEST, dtype=np.uint8)
    return Samples(model.scene, poses, model.wrenches(poses), model.gaps(poses), domain, role)


def test_errors_and_coverage_are_those_of_the_valid_poses_of_a_domain(samples):
    knee = cc.load_surrogate("knee")
    record = reach_record(knee, samples)
    assert {name: (of["poses"], of["valid"]) for name, of in record.items()} == {
        "D1": (20, 1.0),
        "D3": (20, 0.5),
        "all": (40, 0.75),
    }
    off = np.abs(knee(samples.poses) - samples.loads(knee.load_names))
    near = samples.poses[:, 1] < 1000.0
    for domain, rows in (("D1", samples.domain == 1), ("D3", near & (samples.domain == 3))):
        for k, name in enumerate(knee.load_names):
            of = record[domain]["loads"][name]
            assert of["rms"] == pytest.approx(np.sqrt(np.mean(off[rows, k] ** 2)))
            assert of["max"] == pytest.approx(off[rows, k].max())
            assert of["coverage"] == np.mean((off <= knee.expected_error(samples.poses))[rows, k])
    for k, name in enumerate(knee.load_names):
        assert record["all"]["loads"][name]["rms"] == pytest.approx(np.sqrt(np.mean(off[near, k] ** 2)))


def test_wrong_are_valid_poses_with_an_error_beyond_ten_tolerances(samples):
    knee = cc.load_surrogate("knee")
    wrenches = samples.wrenches.copy()
    for row, times in ((0, 9.0), (1, 11.0), (3, 11.0)):  # the last is not valid
        wrenches[row, 0, 1] += times * knee.scene.tolerances["Fy_med"]
    record = reach_record(knee, replace(samples, wrenches=wrenches))
    assert [record[domain]["wrong"] for domain in ("D1", "D3", "all")] == [1, 0, 1]


def test_the_command_prints_a_row_for_each_domain_and_writes_the_record(samples, tmp_path, monkeypatch):
    monkeypatch.setattr(whole_reach, "_OTHERS", 2000)
    write_samples(tmp_path / "samples.h5", samples)
    done = CliRunner().invoke(app, ["knee", str(tmp_path / "samples.h5"), "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "foundation" in done.output
    domains = json.loads((tmp_path / "whole_reach.json").read_text())["domains"]
    assert domains["evenly"]["poses"] > 100  # drawn between these few, with the foundation's loads
    assert domains["evenly"]["loads"]["Fy_med"]["max"] < 100.0
    assert domains["led to"]["poses"] > 10
