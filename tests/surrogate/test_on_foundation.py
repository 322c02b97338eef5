"""What the foundation misses, learned from few samples: accuracy, derivatives, expected error, validity, its file."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.samples import TEST, TRAIN, Samples
from casadi_contact.surrogate.on_foundation import OnFoundation


def softer(found, poses):
    """Twice as soft where the femur is flexed as where it is straight, and with a force along z that springs lack."""
    wrench = found * (0.8 + 0.4 * poses[:, None, None, 5])
    wrench[..., 2] += 0.02 * poses[:, None, 0] * found[..., 1]
    return wrench


def drawn(count, seed):
    """Samples of `softer` at poses in contact of walking; a quarter is held back."""
    scene, rng = cc.load_scene("knee"), np.random.default_rng(seed)
    foundation = cc.foundation(scene)
    starts = rng.uniform([-3.0, 27.2, -1.0, 0.0, -0.1, -1.0], [3.0, 27.2, 1.0, 0.0, 0.1, 0.0], (count, 6))
    loads = dict(zip(("Fy_med", "Fy_lat"), -rng.uniform(20.0, 1500.0, (2, count)), strict=True))
    poses, report = cc.settle(foundation, starts, ("ty", "rx"), loads)
    assert report.converged.all()
    role = np.where(np.arange(count) % 4 == 0, TEST, TRAIN).astype(np.uint8)
    wrenches, gaps = softer(foundation.wrenches(poses), poses), foundation.gaps(poses)
    return Samples(scene, poses=poses, wrenches=wrenches, gaps=gaps, domain=np.ones(count, dtype=np.uint8), role=role)


@pytest.fixture(scope="module")
def samples():
    return drawn(150, 0)


@pytest.fixture(scope="module")
def model(samples):
    return OnFoundation.fit(samples)


def test_a_hundred_samples_teach_what_the_foundation_misses(model, samples):
    held = samples.select(role=TEST)
    loads, errors = held.loads(model.load_names), np.abs(model(held.poses) - held.loads(model.load_names))
    missed = np.abs(model.foundation(held.poses) - loads)
    assert (np.sqrt((errors**2).mean(axis=0)) < 0.1 * np.sqrt((missed**2).mean(axis=0)))[:2].all()
    assert (errors <= model.expected_error(held.poses)).mean() > 0.9
    assert (model.validity(held.poses) > 0.5).mean() > 0.8
    assert model.validity(held.poses + np.array([0.0, 0.0, 8.0, 0.0, 0.0, 0.5])).max() < 0.1


def test_derivatives_of_every_order_are_those_of_differences(model, samples):
    pose, h = samples.poses[0], 1e-5
    moved = pose + h * np.vstack([np.eye(6), -np.eye(6)])
    for values, jacobian in ((model, model.jacobian), (lambda q: model.root_loads(q)[0], model.root_loads)):
        differences = np.transpose(values(moved[:6]) - values(moved[6:])) / (2.0 * h)
        np.testing.assert_allclose(jacobian(pose)[1], differences, atol=1e-4 * np.abs(differences).max())
    x = ca.MX.sym("x", 6)
    hessian = ca.Function("hessian", [x], [ca.hessian(ca.sum1(model.function()(x)), x)[0]])(pose).full()
    slopes = model.jacobian(moved)[1].sum(axis=1)
    np.testing.assert_allclose(hessian, (slopes[:6] - slopes[6:]) / (2.0 * h), atol=1e-3 * np.abs(hessian).max())


def test_nothing_is_borne_out_of_contact_and_the_way_back_is_known(model, samples):
    lifted = samples.poses[:5] + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    assert not model(lifted).any()
    assert (model.root_loads(lifted)[0] < 0.0).all()
    assert (model.root_loads(lifted)[1][:, :, 1] < 0.0).all()


def test_its_file_gives_the_same_model_and_a_foreign_file_is_refused(model, samples, tmp_path):
    model.save(tmp_path / "on.h5")
    again = OnFoundation.load(tmp_path / "on.h5")
    np.testing.assert_array_equal(again(samples.poses[:3]), model(samples.poses[:3]))
    assert again.record == model.record
    samples_only = tmp_path / "other.h5"
    cc.load_surrogate("knee").save(samples_only)
    with pytest.raises(ValueError, match="expected what build --on foundation writes"):
        OnFoundation.load(samples_only)


def test_too_few_samples_in_contact_are_refused(samples):
    with pytest.raises(ValueError, match="at least 10"):
        OnFoundation.fit(samples.rows(np.arange(6)))
