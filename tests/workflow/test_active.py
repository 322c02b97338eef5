"""Active samples are the worst of what is drawn, and a build goes on through its rounds."""

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, write_samples
from casadi_contact.workflow import stages as sampling
from casadi_contact.workflow.presets import PRESETS, ActiveRound, Effort, Preset
from casadi_contact.workflow.project import Project
from casadi_contact.workflow.stages import candidates, train, worst_samples
from tests.support.smooth_samples import smooth_samples


def test_the_worst_are_those_that_miss_most_tolerances_and_all_that_are_lifted():
    samples = smooth_samples(200)
    samples.wrenches[[17, 29]] = 0.0
    names = samples.scene.load_names

    def off(poses):
        loads = samples.loads(names)
        loads[3, 1] += 7.0 * samples.scene.tolerances[names[1]]
        loads[8, 0] -= 6.0 * samples.scene.tolerances[names[0]]
        loads[29, 0] = -0.1 * samples.scene.tolerances[names[0]]
        return loads

    off.load_names = names
    worst = worst_samples(off, samples, 0.01)
    np.testing.assert_array_equal(worst.poses, samples.poses[[3, 8, 17, 29]])
    assert (worst.role == TRAIN).all()


def test_preset_paper_has_the_grids_and_boxes_of_the_paper(tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr(sampling, "draw_samples", lambda *_, **given: drawn.update(given) or smooth_samples(20))
    monkeypatch.setattr(sampling, "reference_motion", lambda model, *_: (drawn.update(model=model), None))
    monkeypatch.setattr(sampling.KeptMotion, "write", lambda *_: None)
    sampling.sample(Project(cc.load_scene("knee"), "paper", tmp_path))
    assert drawn["model"].grid == drawn["settings"].settle_grid == (40, 30)
    assert drawn["settings"].teacher_grid == (80, 40)
    assert set(drawn["settings"].d3_minimum_widths.values()) == {0.0}
    assert {len(size) for size in PRESETS["paper"].efforts["two_stage"][""].sizes} == {1, 2, 3, 4}


def project_in(folder, *rounds):
    """A knee on coarse elements, networks of 6-6 neurons, then these rounds."""
    scene = cc.load_scene("knee", settle=(40, 20), teacher=(40, 20))
    return Project(scene, "quick", folder, own=Preset(0.005, {"patch": {"": Effort(((6, 6),), 0.1)}}, rounds))


def built(project):
    with ThreadPoolExecutor(2) as here:
        samples, _ = sampling.sample(project, executor=here)
        (path,) = train(project, executor=here)
    return samples, cc.load_surrogate(path)


@pytest.fixture(scope="module")
def begun(tmp_path_factory, quick_calibration):
    """Samples and the surrogate without any round, and their folder."""
    folder = tmp_path_factory.mktemp("begun")
    return *built(project_in(folder)), folder


@pytest.fixture
def folder(begun, tmp_path):
    """A copy of that folder, to go on from."""
    return shutil.copytree(begun[2], tmp_path / "out")


def test_a_build_goes_on_through_its_rounds_on_wider_networks_and_ends_alike_when_run_again(folder):
    project = project_in(folder, *(ActiveRound(2.0, 0.1, {"patch": {"": Effort(((8, 8),), 0.1)}}) for _ in range(2)))
    samples, surrogate = built(project)
    assert {net.hidden for net in surrogate.networks.values()} == {(8, 8)}
    command = f"casadi-contact build knee --preset quick --model elements --out {project.folder}"
    assert surrogate.record["command"] == command
    added = surrogate.record["active"]
    drawn = [candidates(project, samples, number, 2.0) for number in (1, 2)]
    for count, more in zip(added, drawn, strict=True):
        assert len(more) == pytest.approx(2.0 * len(samples), rel=0.05)
        lifted = (more.wrenches == 0.0).all(axis=(1, 2)).sum()
        assert 0 <= count - round(0.1 * len(more)) <= lifted
    assert not np.array_equal(drawn[0].poses[:100], drawn[1].poses[:100])
    fitted_rows = np.isin(samples.role, (TRAIN, VALIDATION)).sum()
    assert sum(surrogate.record["samples"].values()) == fitted_rows + sum(added)
    assert surrogate.record["dropped"] == samples.dropped_shares(), "of the plan, not of the few that a round keeps"
    tested = {d for d in np.unique(samples.domain) if ((samples.domain == d) & (samples.role == TEST)).any()}
    assert set(surrogate.record["test_errors"]) == {f"D{d}" for d in tested}
    _, again = built(project)
    poses = samples.poses[:20]
    np.testing.assert_array_equal(again(poses), surrogate(poses), "what was drawn and trained is gone on from")


def test_a_round_without_work_for_a_network_only_makes_it_wider(begun, folder):
    samples, before, _ = begun
    efforts = {"patch": {"root": Effort(((8, 8),), 0.0), "ratios": Effort(((8, 8),), 0.1)}}
    _, after = built(project_in(folder, ActiveRound(2.0, 0.1, efforts)))
    assert {network.hidden for network in after.networks.values()} == {(8, 8)}
    roots = [each.root_loads(samples.poses)[0] for each in (after, before)]
    np.testing.assert_allclose(*roots, rtol=1e-9, atol=1e-12)
    assert after.record["gflop"]["root_med"] == before.record["gflop"]["root_med"], "work of the rounds before counts"
    assert after.record["gflop"]["ratios_med"] > before.record["gflop"]["ratios_med"]


def test_samples_of_another_model_are_refused_before_training(tmp_path):
    project = project_in(tmp_path, ActiveRound(2.0, 0.1))
    columns = {"wrenches": np.zeros((50, 2, 6)), "gaps": np.zeros((50, 2))}
    write_samples(project.samples_path, replace(smooth_samples(50), scene=project.scene, **columns))
    with pytest.raises(ValueError, match="choose another"):
        train(project)
