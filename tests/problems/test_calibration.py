"""Calibration recovers a known truth, scatters as its standard deviations say, and sees what the data leave open."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.columns import write_columns
from problems import calibration
from problems.calibration import TRUTH

NAMES = ("youngs_modulus", "fixed_tx", "fixed_ty", "fixed_tz", "fixed_rx", "fixed_ry")


@pytest.fixture(scope="module")
def knee():
    return cc.foundation("knee")


def estimated(knee, names=NAMES, **options):
    truth = {name: TRUTH[name] for name in names}
    measured = calibration.made_up(knee, truth, frames=12, **options)
    return calibration.calibrate(knee, measured, names), np.array(list(truth.values()))


def test_without_noise_the_truth_is_recovered(knee):
    found, truth = estimated(knee, noise=0.0)
    np.testing.assert_allclose(found.values, truth, rtol=1e-6)
    assert np.abs(found.load_error).max() < 1e-3


def test_estimates_scatter_about_the_truth_as_their_standard_deviations_say(knee):
    """Six noises, six parameters: the root mean square of 36 normal numbers lies within 0.65 and 1.35."""
    scores, misfits = [], []
    for seed in range(6):
        found, truth = estimated(knee, seed=seed)
        scores.append((found.values - truth) / found.deviations)
        misfits.append(found.misfit)
    assert 0.65 < np.sqrt(np.mean(np.square(scores))) < 1.35
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.25)


def test_the_reduced_hessian_is_that_of_the_profile_cost(knee):
    """Cost at the best poses for given z: moved by Δz from its minimum it grows by ½ Δzᵀ H Δz."""
    found, _ = estimated(knee, ("fixed_ty", "fixed_rx"), noise=0.0)
    off = np.array([0.002, 1e-5])
    data = calibration.made_up(knee, {"fixed_ty": TRUTH["fixed_ty"], "fixed_rx": TRUTH["fixed_rx"]}, 12, 0.0)
    cost = 0.0
    function = knee.function(parameters=("fixed_ty", "fixed_rx"))
    values = np.array([TRUTH["fixed_ty"], TRUTH["fixed_rx"]]) + off
    for pose, load in zip(data.poses, data.loads, strict=True):
        r = (np.asarray(function(pose, values))[:, 0] - load) / data.load_deviation
        J = np.asarray(function.jacobian()(pose, values, 0)[0]) * data.pose_deviation / data.load_deviation[:, None]
        cost += 0.5 * r @ np.linalg.solve(np.eye(len(r)) + J @ J.T, r)
    z = off * [1.0, 25.0]
    assert cost == pytest.approx(0.5 * z @ found.hessian @ z, rel=0.05)


def test_stiffness_and_thickness_are_not_told_apart_but_their_ratio_is_found(knee):
    found, truth = estimated(knee, ("youngs_modulus", "thickness"), noise=0.0)
    assert np.isinf(found.deviations).all()
    assert found.values[0] / found.values[1] == pytest.approx(truth[0] / truth[1], rel=1e-6)


def test_the_program_reads_a_measurement_and_draws(knee, tmp_path, capsys):
    calibration.main(frames=8, parameters="youngs_modulus,fixed_ty", out=tmp_path)
    first = capsys.readouterr().out.splitlines()
    calibration.main(measured=tmp_path / "made_up.csv", parameters="youngs_modulus,fixed_ty", out=tmp_path)
    again = capsys.readouterr().out.splitlines()
    assert again[1].split()[:3] == first[1].split()[:3]
    assert (tmp_path / "calibration.png").stat().st_size > 1000
    data = calibration.read_measurement(tmp_path / "made_up.csv", knee.load_names)
    metres = {**data.columns(), "ty_mm": 1000.0 * data.columns()["ty_mm"]}
    write_columns(tmp_path / "wrong.csv", metres)
    calibration.main(measured=tmp_path / "wrong.csv", out=tmp_path)
    assert "do not explain" in capsys.readouterr().out
