"""Radial basis functions interpolate, globally and on neighbours."""

import numpy as np
import pytest

from casadi_contact.workflow.benchmark.peers.radial_basis import RadialBasis, best_kernel, radial_basis
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from tests.support.smooth_samples import NAMES, smooth_poses, smooth_samples, smooth_wrenches


@pytest.fixture(scope="module")
def data():
    return TrainingSet.of(smooth_samples(800), NAMES)


@pytest.mark.parametrize("neighbours", [None, 60])
def test_it_interpolates_its_points(data, neighbours):
    model = RadialBasis(data, 300, "cubic", neighbours)
    np.testing.assert_allclose(model(data.poses[:50]), data.loads[:50], atol=1e-6 * data.load_scale[1].max())
    poses = smooth_poses(5, seed=2)
    np.testing.assert_allclose([model.one(pose) for pose in poses], model(poses), rtol=1e-9)


def test_held_out_points_are_predicted(data):
    made = {c.name: c for c in radial_basis(data, gflop=20.0)}
    poses = smooth_poses(100, seed=6)
    want = smooth_wrenches(poses)[:, 0, [1, 0, 3]]
    for name, share in (("radial basis 640", 0.05), ("radial basis, local 100", 0.1)):
        off = made[name].model(poses) - want
        assert (np.sqrt((off**2).mean(axis=0)) < share * data.load_scale[1]).all(), name


def test_the_smoothest_kernel_is_chosen_for_a_smooth_function(data):
    assert best_kernel(data) == "quintic"


@pytest.mark.parametrize("neighbours", [None, 60])
def test_pose_parameters_that_never_vary_are_left_out(neighbours):
    """As a scene locks them."""
    samples = smooth_samples(800)
    samples.poses[:, [2, 4]] = [0.3, -0.1]
    data = TrainingSet.of(samples, NAMES)
    model = RadialBasis(data, 300, best_kernel(data), neighbours)
    np.testing.assert_allclose(model(data.poses[:50]), data.loads[:50], atol=1e-6 * data.load_scale[1].max())
    np.testing.assert_allclose(model.one(data.poses[3]), model(data.poses[3:4])[0], rtol=1e-9)


def test_too_few_samples_are_refused_in_words():
    with pytest.raises(ValueError, match="too few for radial basis functions"):
        best_kernel(TrainingSet.of(smooth_samples(8), NAMES))
