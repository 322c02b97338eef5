"""A tiny real front: sizes trained and kept, everything measured, a size chosen for fewer loads."""

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli import main as cli
from casadi_contact.cli import pipeline
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.polar.foundation import RayChoice
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.samples.samples import TEST, write_samples
from casadi_contact.workflow import stages as sampling
from casadi_contact.workflow.benchmark.candidates import Candidate, chart_sizes, sized_path, train_sizes
from casadi_contact.workflow.benchmark.choose import python_line
from casadi_contact.workflow.benchmark.front_file import Point, read_front
from casadi_contact.workflow.benchmark.measure import measure, measure_project, unseen_walking
from casadi_contact.workflow.presets import PRESETS, Effort, Preset
from casadi_contact.workflow.project import Project, read_motion

PATCH = {"patch": (Effort(((4, 4),), 0.2),)}
TINY = Preset(
    sampling_scale=0.005,
    efforts={"patch": {"": Effort(((5, 5),), 0.3)}},
    charted={**PATCH, "two_stage": (Effort(((4,),), 0.05, "tanh", max_rows=300),)},
)


@pytest.fixture(scope="module")
def project(tmp_path_factory, quick_calibration):
    folder = tmp_path_factory.mktemp("front")
    (folder / "knee.toml").write_text(cc.load_scene("knee", settle=(40, 20), teacher=(80, 40)).to_toml())
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(1) as here:
        patch.setitem(PRESETS, "tiny", TINY)
        patch.setattr("casadi_contact.workflow.benchmark.measure._MEASUREMENT_S", 0.0)  # a few calls each
        patch.setattr("casadi_contact.contact.choice.POLAR_LADDER", (Rays(8, 2),))  # coarser than the chosen
        few = partial(RayChoice, poses=64, elements=(160, 80), poses_on_elements=16)
        patch.setattr("casadi_contact.contact.polar.foundation.RayChoice", few)
        made = pipeline.Project.open(folder / "knee.toml", "tiny", folder / "out")
        sampling.sample(made, executor=here)
        pipeline.train(made, executor=here)
        train_sizes(made, executor=here)
        measure_project(made)
        yield made


def test_sizes_that_are_damaged_or_of_other_tolerances_or_samples_are_trained_anew_and_kept_after_that(
    project, tmp_path
):
    shutil.copytree(project.folder, tmp_path / "out")
    half = project.scene.with_tolerances(**{name: 0.5 * most for name, most in project.scene.tolerances.items()})
    other = replace(project, scene=half, folder=tmp_path / "out", own=replace(TINY, charted=PATCH))
    path = sized_path(other, "patch 4-4")
    with ThreadPoolExecutor(1) as here:
        train_sizes(other, executor=here)
        made = path.stat().st_mtime_ns
        train_sizes(other, executor=here)
        assert cc.load_surrogate(path).scene.tolerances == half.tolerances
        assert made == path.stat().st_mtime_ns
        path.write_bytes(b"damaged")
        train_sizes(other, executor=here)  # from its checkpoints
        assert cc.load_surrogate(path).scene.tolerances == half.tolerances
        samples = other.samples()
        write_samples(other.samples_path, samples.rows(np.arange(len(samples)) % 7 > 0))
        shutil.rmtree(other.training_folder("sizes", path.stem), ignore_errors=True)
        train_sizes(other, executor=here)
    trained = sum(cc.load_surrogate(path).record["samples"].values())
    assert trained == (other.samples().role != TEST).sum() < (samples.role != TEST).sum()


@pytest.fixture(scope="module")
def walking(project):
    """The unseen walking poses and the converged EF's loads there, made anew."""
    poses = unseen_walking(ElasticFoundation(project.scene, (40, 20)), read_motion(project).motion)
    return poses, ElasticFoundation(project.scene, (160, 80))(poses)


@pytest.fixture(scope="module")
def measured(project):
    return read_front(project.folder / "speed_accuracy.csv")


def test_everything_planned_is_measured(project, measured):
    names = [point.name for point in measured.points]
    assert names[-4:] == ["own patch", "own patch (CasADi MX)", "patch 4-4", "two_stage 4"]
    assert {"EF 20×15", "EF 15×20", "EF 40×30", "EF 80×40"} <= set(names)
    for point in measured.points:
        assert not point.failure
        assert 0.0 < point.value.low_us <= point.value.median_us <= point.value.high_us
        assert (point.hessian is None) == (point.family == "EF")
        assert set(point.load_rms) == set(measured.loads)


def test_the_foundation_stands_beside_networks_coarser_and_finer(project, measured, walking):
    poses, converged = walking
    points = [point for point in measured.points if point.family == "foundation"]
    assert cc.foundation(project.scene).resolution in " ".join(point.name for point in points)
    errors = [point.force_rms_n for point in points]
    assert len(errors) == 2
    assert errors == sorted(errors, reverse=True)
    for point in points:
        line = python_line(str(project.folder.parent / "knee.toml"), point.name, measured.loads, None)
        model = eval(line, {"cc": cc})
        assert model.resolution in point.name
        rms = np.sqrt(np.mean((model(poses) - converged) ** 2, axis=0))
        np.testing.assert_allclose([point.load_rms[load] for load in model.load_names], rms, rtol=1e-4)


def test_a_candidate_that_fails_stays_in_the_table(project):
    def broken(poses):
        raise RuntimeError("out of\nluck")

    broken.load_names = ("Fy_med",)
    candidates = [Candidate(Point("none", "A", failure="did not fit")), Candidate(Point("broken", "B"), broken)]
    poses = read_motion(project).motion.poses[0][:10]
    assert [p.failure for p in measure(candidates, project.scene, poses).points] == ["did not fit", "out of luck"]


def test_command_line_names_the_choice(project):
    """Which one it is, the fastest on this machine, is not the test's to say."""
    scene = str(project.folder.parent / "knee.toml")
    for options, said in (
        (("--force-tol", "1000", "--torque-tol", "50000"), "in Python: "),
        (("--force-tol", "1000", "--loads", "Fy_med,Fy_lat"), "Cheapest model for Fy_med, Fy_lat within tolerance"),
    ):
        arguments = ["choose", scene, "--preset", "tiny", "--out", str(project.folder), *options]
        done = CliRunner().invoke(cli.app, arguments, env={"COLUMNS": "200"})
        assert done.exit_code == 0, done.output
        assert said in done.output


def test_the_chart_leaves_out_structures_that_do_not_fit_the_scene():
    """The shoulder's head presses along +z, which two_stage clamps: it was tried, and failed after minutes."""
    for scene, wanted in (("knee", {"patch", "two_stage"}), ("glenohumeral", {"patch"})):
        project = Project(cc.load_scene(scene), "quick", Path("none"))
        assert {structure for structure, _ in chart_sizes(project).values()} == wanted
