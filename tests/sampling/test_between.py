"""Poses between samples: where they lie, what becomes of them, and what a surrogate learns from the worst."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.dataset import TEST, TRAIN
from casadi_contact.sampling.between import ALONG, BEYOND, poses_between, worst_between
from tests.support import two_spheres
from tests.support.drawn_spheres import SETTINGS, draw
from tests.support.two_spheres import TwoSpheres, knee


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    with ThreadPoolExecutor(1) as here:
        return draw(tmp_path_factory.mktemp("between") / "samples.h5", here, replace(SETTINGS, scale=0.03))


class WrongAbove(TwoSpheres):
    """Two spheres, and a false load of 1 kN for each millimetre of tx above 2 mm where nothing touches."""

    def __call__(self, poses):
        loads = super().__call__(poses)
        free = (self.gaps(poses) > 0.0).all(axis=1)
        loads[:, 0] -= np.where(free, 1000.0 * np.maximum(poses[:, 0] - 2.0, 0.0), 0.0)
        return loads


def test_each_pose_lies_on_a_line_through_two_learned_samples_of_its_domain(samples):
    known = samples.rows(samples.role != TEST)
    few = known.rows(np.concatenate([np.flatnonzero(known.domain == d)[:2] for d in (1, 4)]))
    poses, domain = poses_between(few, 400, seed=1)
    for number in (1, 4):
        p, q = few.select(domain=number).poses
        share = (poses[domain == number] - p) @ (q - p) / ((q - p) @ (q - p))
        np.testing.assert_allclose(poses[domain == number], p + share[:, None] * (q - p), atol=1e-9)
        near = np.minimum(share, 1.0 - share)  # of p, or of q towards p
        assert near.min() >= -BEYOND
        assert near.max() <= ALONG
        assert len(np.unique(share)) > 50
    again, _ = poses_between(few, 400, seed=1)
    np.testing.assert_array_equal(again, poses)
    assert not np.array_equal(poses_between(few, 400, seed=2)[0], poses)


def test_the_worst_are_where_the_model_bears_falsely_and_are_the_contact_model_s_samples(samples):
    truth, told = TwoSpheres(knee()), []
    with ThreadPoolExecutor(2) as here:
        worst = worst_between(
            WrongAbove(knee()),
            samples,
            two_spheres.models,
            4000,
            30,
            executor=here,
            progress=lambda *done: told.append(done),
        )
    assert len(worst) == 30
    assert (worst.role == TRAIN).all()
    assert (truth.gaps(worst.poses) > 0.0).all()
    assert worst.poses[:, 0].min() > 2.0
    assert worst.poses[0, 0] == worst.poses[:, 0].max(), "the worst comes first"
    np.testing.assert_array_equal(worst.wrenches, truth.wrenches(worst.poses))
    np.testing.assert_array_equal(worst.gaps, truth.gaps(worst.poses))
    assert told[-1] == (4000, 4000)


def test_nothing_presses_harder_there_than_in_the_samples(samples):
    def never_right(poses):
        return np.zeros((len(poses), len(never_right.load_names)))

    never_right.load_names = knee().load_names
    with ThreadPoolExecutor(2) as here:
        worst = worst_between(never_right, samples, two_spheres.models, 4000, 50, executor=here)
    assert len(worst) == 50
    hardest = np.abs(samples.loads(["Fy_med", "Fy_lat"])).max(axis=0)
    assert (np.abs(worst.loads(["Fy_med", "Fy_lat"])) <= hardest).all()


def test_of_no_poses_there_are_no_worst(samples):
    for count, most in ((0, 5), (5, 0)):
        assert len(worst_between(WrongAbove(knee()), samples, two_spheres.models, count, most)) == 0
    held_back = samples.select(role=TEST)
    assert len(worst_between(WrongAbove(knee()), held_back, two_spheres.models, 5, 5)) == 0
