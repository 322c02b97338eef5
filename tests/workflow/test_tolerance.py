"""Training to a tolerance: it ends where every domain's validation rows meet it, and says what misses."""

import shlex
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, write_samples
from casadi_contact.workflow import tolerance
from casadi_contact.workflow.presets import Effort, Preset
from casadi_contact.workflow.project import Project, project_surrogates
from casadi_contact.workflow.stages import train
from casadi_contact.workflow.tolerance import misses, scene_to_tolerance
from tests.support.smooth_samples import SPHERE, smooth_samples


class Off:
    """The samples' own loads, off by so much [N, N·mm] of each."""

    def __init__(self, samples, **off):
        self.load_names, self._samples, self._off = samples.scene.load_names, samples, off

    def __call__(self, poses):
        rows = [np.flatnonzero((self._samples.poses == pose).all(axis=1))[0] for pose in poses]
        return self._samples.loads()[rows] + [self._off.get(name, 0.0) for name in self.load_names]


def test_one_tolerance_for_all_forces_and_one_for_all_torques():
    scene = scene_to_tolerance(cc.load_scene("knee"), 2.0, None)
    assert {scene.tolerances[name] for name in ("Fy_med", "Fy_lat", "Fx", "Fz")} == {2.0}
    assert {scene.tolerances[name] for name in ("Tx", "Ty", "Tz")} == {25.0}
    with pytest.raises(ValueError, match="expected N above 0"):
        scene_to_tolerance(scene, -1.0, None)
    with pytest.raises(ValueError, match="torque tolerance"):
        scene_to_tolerance(cc.load_scene("planar_knee"), None, 5.0)


def test_misses_are_judged_on_held_back_rows_by_domain_and_load():
    samples = smooth_samples(120)
    tolerances = samples.scene.tolerances
    first, second = samples.scene.load_names[:2]
    assert misses(Off(samples, **{first: 0.9 * tolerances[first]}), samples) == ""
    found = misses(Off(samples, **{first: 1.5 * tolerances[first], second: 3.0 * tolerances[second]}), samples)
    assert f"D1: {second}" in found, "the worst load of each domain"
    assert misses(Off(samples, **{first: np.nan}), samples), "no number meets nothing"
    for role in (VALIDATION, TEST):
        assert misses(Off(samples, **{first: 1e6}), samples.select(role=[TRAIN, role])), "each is judged alone"
    assert misses(Off(samples, **{first: 1e6}), samples.select(role=TRAIN)) == ""


@pytest.fixture
def asked(monkeypatch):
    """Scales that rounds asked samples for: drawn are those of a smooth function; all that is trained is real."""
    scales = []

    def drawn(project, *_):
        scales.append(project.preset.sampling_scale)
        samples = replace(smooth_samples(int(2400 * project.preset.sampling_scale)), scene=project.scene)
        write_samples(project.samples_path, samples)
        project.motion_path.touch()
        return samples, None

    monkeypatch.setattr(tolerance, "sample", drawn)
    return scales


def rounds(*sizes):
    """Rounds of so many neurons, each with twice the samples of the one before."""
    return [Preset(0.1 * 2**k, {"patch": {"": Effort((size,), 1.0)}}) for k, size in enumerate(sizes)]


def trained(folder, force_n, torque_nmm, *sizes):
    project = Project(scene_to_tolerance(SPHERE, force_n, torque_nmm), "quick", folder)
    with ThreadPoolExecutor(1) as here:
        return tolerance.train_to_tolerance(project, executor=here, rounds=rounds(*sizes))


def test_the_first_round_that_meets_the_tolerance_is_the_last(tmp_path, asked, monkeypatch):
    monkeypatch.setattr("casadi_contact.workflow.stages.model_name_of", lambda samples: "foundation")
    sizes = ((4,), (12, 12), (40, 40))
    small = trained(tmp_path, 100.12345678, 3000.0, *sizes)
    assert asked == [0.1]
    said = f"build {SPHERE.name} --model foundation --force-tol 100.12345678 --torque-tol 3000 --out {tmp_path}"
    assert small.record["command"] == f"casadi-contact {said}"
    large = trained(tmp_path, 20.0, 600.0, *sizes)
    assert asked[1:] == [0.1, 0.2]
    assert {network.hidden for network in large.networks.values()} == {(12, 12)}
    assert misses(large, replace(smooth_samples(480), scene=large.scene)) == ""
    assert cc.load_surrogate(tmp_path / "patch.h5").scene.tolerances["Fy"] == 20.0


def test_a_tolerance_out_of_reach_says_what_misses_and_keeps_what_there_is(tmp_path, asked):
    with pytest.raises(ValueError, match=r"after 1 rounds, 240 samples, the tolerance is missed: .*D1: .*0.001"):
        trained(tmp_path / "far", 1e-3, 1e-3, (4,))
    assert cc.load_surrogate(tmp_path / "far" / "patch.h5").scene.tolerances["Fy"] == 1e-3


def test_what_another_build_made_is_not_replaced(tmp_path, asked):
    samples, surrogate = tmp_path / "samples", tmp_path / "surrogate"
    (samples / "within-100-3000" / "samples-0.1").mkdir(parents=True)  # of a build that was killed
    write_samples(samples / "samples.h5", smooth_samples(120))
    surrogate.mkdir()
    cc.load_surrogate("knee").save(surrogate / "patch.h5")
    for folder, said in ((samples, "of another build"), (surrogate, "was trained for another scene")):
        before = {path: path.read_bytes() for path in folder.glob("*.h5")}
        with pytest.raises(ValueError, match=said):
            trained(folder, 100.0, 3000.0, (4,))
        assert asked == []
        assert {path: path.read_bytes() for path in folder.glob("*.h5")} == before


def test_samples_drawn_for_one_tolerance_are_learned_to_another(tmp_path):
    """The tolerances of now decide when a fit ends, and stand in the surrogate that comes of it."""
    efforts = {"patch": {"": Effort(((6, 6),), 2.0)}}
    fits = {}
    for factor in (1.0, 1000.0):
        loose = SPHERE.with_tolerances(**{name: factor * value for name, value in SPHERE.tolerances.items()})
        project = Project(loose, "quick", tmp_path / "out", own=Preset(1.0, efforts))
        project.folder.mkdir(exist_ok=True)
        drawn = replace(smooth_samples(240), provenance={"table": "smooth.csv", "table_digest": "0"})
        write_samples(project.samples_path, drawn)
        assert project.samples().scene.tolerances == SPHERE.tolerances
        with ThreadPoolExecutor(1) as here:
            train(project, executor=here)
        fits[factor] = project_surrogates(project)["patch"]
        assert fits[factor].scene == loose
        assert shlex.split(fits[factor].record["command"])[2:5] == [SPHERE.name, "--preset", "quick"]
    assert sum(fits[1000.0].record["gflop"].values()) < sum(fits[1.0].record["gflop"].values())
