"""Rows that contradict all others of a table are named; noise, and loads that grow steeply, are not."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.approach import advance_to_contact
from casadi_contact.dataset import Samples
from casadi_contact.dataset.odd_rows import odd_rows, odd_rows_text
from casadi_contact.scenes import Scene
from tests.support.own_contact import CLEARANCE_MM, SCENE, gaps, wrenches

PRESSED = Scene.from_toml(SCENE.to_toml().replace('"F"', '"+Fy"').replace('"tx", "ty", "tz"', '"ty"'))


def noisy_samples(scene, noise=0.005):
    """600 samples of a ball pressed into its socket, over a cone of directions."""
    rng = np.random.default_rng(1)
    directions = np.array([0.1, 0.9, 0.2]) + rng.uniform(-0.2, 0.2, (600, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    size = CLEARANCE_MM + rng.uniform(-0.02, 0.08, (600, 1))
    poses = np.hstack([[5.0, -3.0, 2.0] + size * directions, rng.uniform(-0.3, 0.3, (600, 3))])
    loads = wrenches(poses) * (1.0 + noise * rng.standard_normal((600, 1, 6)))
    return Samples(scene, poses, loads, gaps(poses), np.ones(600, np.uint8), np.zeros(600, np.uint8))


def changed(samples, rows, times, columns=slice(None)):
    loads = samples.wrenches.copy()
    loads[rows, 0, columns] *= times
    return replace(samples, wrenches=loads)


def test_neither_noise_nor_exact_loads_have_odd_rows():
    for scene in (SCENE, PRESSED):
        for noise in (0.0, 0.005, 0.05):
            assert odd_rows(noisy_samples(scene, noise)) == []
    assert odd_rows_text([]) == ""


@pytest.mark.parametrize("seed", range(6))
def test_exact_loads_that_a_polynomial_fits_badly_have_no_odd_rows(seed):
    """Of a knee under up to 10,000 N a side, from few rows over a wide range."""
    count = 300
    model, rng = cc.ElasticFoundation(cc.load_scene("knee"), (30, 20)), np.random.default_rng(seed)
    low, high = [-3.0, 0.0, -1.5, -0.03, -0.1, -1.2], [6.0, 0.0, 1.5, 0.03, 0.1, 0.0]
    pressed = {name: np.full(count, -300.0) for name in ("Fy_med", "Fy_lat")}
    poses = advance_to_contact(model, rng.uniform(low, high, (count, 6)), pressed)
    poses[:, 1] -= rng.uniform(-0.1, 0.3, count)
    ones = np.ones(count, np.uint8)
    assert odd_rows(Samples(model.scene, poses, model.wrenches(poses), model.gaps(poses), ones, 0 * ones)) == []


def test_decimal_slips_are_named_with_what_the_other_rows_say():
    for scene in (SCENE, PRESSED):
        samples = noisy_samples(scene)
        slips = np.argsort(-samples.wrenches[:, 0, 1])[[0, 50, 100, 150, 200, 250, 300]]
        rows = odd_rows(changed(samples, slips, 10.0))
        assert {row.row for row in rows} == set(slips + 1)
        assert {row.load for row in rows} == {"normal load"}
        np.testing.assert_allclose([row.expected for row in rows], [row.value / 10.0 for row in rows], rtol=0.1)
        assert odd_rows_text(rows).endswith(" and 2 more")


def test_one_load_of_a_row_with_the_wrong_sign_is_named():
    samples = noisy_samples(PRESSED)
    row = int(samples.wrenches[:, 0, 1].argmax())
    (odd,) = odd_rows(changed(samples, row, -1.0, columns=5))
    assert (odd.row, odd.load, odd.unit) == (row + 1, "Tz", "N·mm")


@pytest.mark.parametrize("times", [10.0, 2.0, 0.5, 0.1])
def test_of_a_row_whose_pressing_force_alone_is_wrong_no_other_load_is_named(times):
    """Its other loads are right: they are what the rows around it say, and not what its own force says."""
    for scene in (SCENE, PRESSED):
        samples = noisy_samples(scene)
        for row in np.argsort(-samples.wrenches[:, 0, 1])[[0, 80, 160]]:
            (odd,) = odd_rows(changed(samples, row, times, columns=1))
            pressing = samples.scene.parts[0].normal.of(samples.wrenches[row, 0])
            right = {"normal load": pressing, "Fy": samples.wrenches[row, 0, 1]}
            assert odd.row == row + 1
            assert np.isclose(odd.expected, right[odd.load], rtol=0.1)


def test_rows_that_differ_from_the_fit_by_less_than_a_fifth_of_themselves_are_not_odd():
    samples = noisy_samples(PRESSED, noise=0.0)
    row = int(samples.wrenches[:, 0, 1].argmax())
    assert odd_rows(changed(samples, row, 1.15, columns=5)) == []
    assert [odd.row for odd in odd_rows(changed(samples, row, 1.6, columns=5))] == [row + 1]


def test_of_too_few_rows_none_is_called_odd():
    assert odd_rows(changed(noisy_samples(SCENE), 0, 10.0).rows(np.arange(20))) == []
