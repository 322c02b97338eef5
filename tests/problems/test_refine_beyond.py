"""The cycle beyond the learned region: what the shipped knee still holds, what it says of the rest, one line for a
mistake. Refinement itself is tested in tests/verification."""

import csv

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.samples import Samples, write_samples
from casadi_contact.scenes.walking import reference_cycle
from problems import pose_estimation
from problems.studies import refine_beyond
from tests.support.command import ran


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A folder with the shipped knee and a few samples, enough to verify."""
    folder = tmp_path_factory.mktemp("project")
    knee = cc.load_surrogate("knee")
    knee.save(folder / "patch.h5")
    poses = pose_estimation.solve(pose_estimation.build(knee, reference_cycle(11))).poses
    model = cc.ElasticFoundation(knee.scene)
    ones = np.ones(len(poses), dtype=np.uint8)
    write_samples(
        folder / "samples.h5", Samples(knee.scene, poses, model.wrenches(poses), model.gaps(poses), ones, ones)
    )
    return folder


def test_the_cycle_is_heavier_and_more_flexed():
    cycle = reference_cycle(11)
    more = refine_beyond.beyond(cycle, 1.5, 20.0)
    np.testing.assert_allclose(more.fy_med, 1.5 * cycle.fy_med)
    np.testing.assert_allclose(np.rad2deg(more.rz), np.rad2deg(cycle.rz) - 20.0)
    np.testing.assert_allclose(more.targets()["Tz"], 1.5 * cycle.targets()["Tz"])


def test_one_and_a_half_times_the_loads_and_20_degrees_need_no_refinement(project, tmp_path):
    done = ran(
        "problems.studies.refine_beyond",
        "--project",
        project,
        "--loads",
        1.5,
        "--flexion",
        20,
        "--frames",
        21,
        "--out",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "0 rounds, 0 samples" in done.stdout
    (row,) = csv.DictReader((tmp_path / "refine_beyond.csv").open(encoding="utf-8"))
    assert row["passed"] == "True"
    assert float(row["rms_Fy_med"]) < 1.0
    frames = list(csv.DictReader((tmp_path / "frames.csv").open(encoding="utf-8")))
    assert [frame["verdict"] for frame in frames] == ["solved and verified"] * 21
    assert "21 of 21 solved and verified on EF" in done.stdout


def test_twice_the_loads_and_40_degrees_are_seen_to_be_beyond(project, tmp_path):
    done = ran("problems.studies.refine_beyond", "--project", project, "--rounds", 0, "--frames", 21, "--out", tmp_path)
    assert done.returncode == 2
    assert "not within tolerance after 0 rounds" in done.stderr
    (row,) = csv.DictReader((tmp_path / "refine_beyond.csv").open(encoding="utf-8"))
    assert int(row["outside"]) > 0
    assert not (tmp_path / "refined.h5").exists()


def test_walking_alone_teaches_nothing_of_other_domains():
    scene = cc.load_scene("knee")
    walking = pose_estimation.solve(pose_estimation.build(cc.load_surrogate("knee"), reference_cycle())).poses
    rng = np.random.default_rng(0)
    poses = np.repeat(walking, 6, axis=0) + rng.normal(size=(606, 6)) * [0.3, 0.01, 0.1, 4e-4, 0.01, 0.05]
    model = cc.ElasticFoundation(scene, (40, 20))
    domain = np.where(np.arange(606) % 6 == 0, 3, 1).astype(np.uint8)
    role = np.where(rng.random(606) < 0.2, 1, 0).astype(np.uint8)
    samples = Samples(scene, poses, model.wrenches(poses), model.gaps(poses), domain, role)
    surrogate, narrow = refine_beyond.walking_only(samples, 3.0)
    assert set(narrow.domain) == {1}
    assert surrogate.record["samples"]["D3"] == 0
    assert (surrogate.validity(walking) > 0.5).mean() > 0.9


def test_a_missing_project_is_one_line(tmp_path):
    done = ran("problems.studies.refine_beyond", "--project", tmp_path / "none", "--out", tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("refine_beyond: samples file")
    assert done.stderr.count("\n") == 1
