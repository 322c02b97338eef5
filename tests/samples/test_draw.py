from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.contact.model import ContactModel
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, partial_folder, read_samples
from casadi_contact.samples.settings import SamplingSettings
from tests.support.two_spheres import SETTINGS, TwoSpheres, draw, knee, sphere_motion


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("drawn") / "samples.h5"
    draw(path)
    return path


@pytest.fixture(scope="module")
def samples(file):
    return read_samples(file)


def test_every_planned_sample_is_there_with_what_the_model_says_at_its_pose(samples):
    """0.3 % of 24000, 24000, 24000, 30000, 300, 20000, 100, and never less than 10 rows."""
    counts = {name: sum(roles.values()) for name, roles in samples.counts().items()}
    assert counts == {"D1": 72, "D2": 72, "D3": 72, "D4": 90, "D5": 30, "D6": 60, "D7": 10}
    assert not samples.provenance["dropped"]
    for domain in counts:
        assert set(samples.select(domain).role.tolist()) == {TRAIN, VALIDATION, TEST}
    model = TwoSpheres(knee())
    np.testing.assert_array_equal(samples.wrenches, model.wrenches(samples.poses))
    np.testing.assert_array_equal(samples.gaps, model.gaps(samples.poses))


def test_loads_of_each_domain(samples):
    loads = {d: samples.select(f"D{d}").loads(["Fy_med", "Fy_lat"]) for d in range(1, 8)}
    for d in (1, 2, 3):
        assert (loads[d] < -5.0 + 2e-3).all()
    assert ((loads[4] == 0.0).sum(axis=1) == 1).all()
    assert (loads[4][:45, 0] == 0.0).all()
    assert (loads[4][45:, 1] == 0.0).all()
    assert (samples.select("D5").wrenches == 0.0).all()
    np.testing.assert_allclose(loads[6][:30, 0], -5.0, atol=2e-3)
    np.testing.assert_allclose(loads[6][30:, 1], -5.0, atol=2e-3)
    np.testing.assert_allclose(loads[7], -5.0, atol=2e-3)


def test_the_executor_does_not_matter(file, tmp_path):
    seen = []
    with ThreadPoolExecutor(4) as executor:
        draw(tmp_path / "samples.h5", executor, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(k, seen[0][1]) for k in range(seen[0][1] + 1)]
    assert (tmp_path / "samples.h5").read_bytes() == file.read_bytes()
    assert not partial_folder(tmp_path / "samples.h5").exists()


def test_what_does_not_settle_is_dropped_and_counted(tmp_path):
    """A motion 3 m off: within 60 steps of at most 5 mm none of its start poses finds contact."""
    lost = sphere_motion().poses.copy()
    lost[..., 1] += 3000.0
    motion = ReferenceMotion(sphere_motion().point, sphere_motion().curves, lost)
    settings = SamplingSettings(counts={"D1": 30, "D4": 30}, frames=21)
    samples = draw(tmp_path / "s.h5", settings=settings, motion=motion)
    assert len(samples) == 0
    (reason,) = samples.provenance["dropped"]["D1"]
    assert reason.startswith("not settled: ")
    assert samples.provenance["dropped"] == {"D1": {reason: 30}, "D4": {reason: 10}}


class Sticky(TwoSpheres):
    """A faulty model: pulls with 1 N wherever it should carry nothing."""

    def wrenches(self, poses):
        wrenches = super().wrenches(poses)
        wrenches[..., 1] += np.where(self.gaps(poses) > 0.0, 1.0, 0.0)
        return wrenches


def test_a_model_that_pulls_has_those_samples_dropped(tmp_path):
    settings = SamplingSettings(counts={"D1": 20, "D5": 30}, frames=21)
    samples = draw(tmp_path / "s.h5", settings=settings, models=lambda scene, _: (TwoSpheres(scene), Sticky(scene)))
    assert samples.provenance["dropped"] == {"D5": {"pulls": 30}}
    assert len(samples) == 20


class Rimmed(TwoSpheres):
    """Elements that end at z = 0.2 mm off the middle of each patch: contact reaches their edge beyond."""

    def wrenches(self, poses):
        assert not self.at_edge(poses).any()
        return super().wrenches(poses)

    def at_edge(self, poses):
        centres, _ = self._centres(poses)
        return (centres[..., 2] - self.scene.anchors_mm[:, 2] > 0.2) & (self.gaps(poses) < 0.0)


def test_samples_whose_contact_reaches_the_edge_are_dropped_and_no_others(samples, tmp_path):
    settings = replace(SETTINGS, most_dropped=1.0)
    kept = draw(tmp_path / "s.h5", settings=settings, models=lambda scene, _: (TwoSpheres(scene), Rimmed(scene)))
    edge = Rimmed(knee()).at_edge(samples.poses).any(axis=1)
    assert 0.1 < edge.mean() < 0.9
    np.testing.assert_array_equal(kept.poses, samples.poses[~edge])
    np.testing.assert_array_equal(kept.wrenches, samples.wrenches[~edge])
    np.testing.assert_array_equal(kept.dropped.poses, samples.poses[edge])
    counts = {f"D{k}": int((edge & (samples.domain == k)).sum()) for k in range(1, 8)}
    assert kept.provenance["dropped"] == {
        domain: {"load at the edge of the elements": count} for domain, count in counts.items() if count
    }


class Gapless(TwoSpheres):
    """The spheres without gaps, which a contact model may lack."""

    has_gaps, gaps = False, ContactModel.gaps


def test_a_model_without_gaps_goes_the_same_way(tmp_path):
    settings = SamplingSettings(counts={"D1": 20, "D3": 20, "D4": 30, "D5": 30}, frames=21)
    samples = draw(tmp_path / "s.h5", settings=settings, models=lambda scene, _: (Gapless(scene), Gapless(scene)))
    assert len(samples) == 100
    assert np.isnan(samples.gaps).all()
    lifted = TwoSpheres(knee()).gaps(samples.select("D4").poses).max(axis=1).reshape(-1, 3)
    np.testing.assert_allclose(lifted[:, 2], 2.0, atol=0.1)
