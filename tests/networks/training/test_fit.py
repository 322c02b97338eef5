"""Whole fits: what ends them, what is kept, and what bad data gets."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import (
    TrainingSettings,
    extrapolated_error,
    typical_error,
    validation_rising,
)
from casadi_contact.networks.training.weights import flatten, initial_network
from tests.support.smooth_samples import FIXED, GROWING, smooth


def sizes_in_order(result, settings):
    return [settings.sizes[k] for k in dict.fromkeys(result.history["size"])]


def test_the_error_reached_ends_a_fit():
    data = smooth(tolerance=2.0)
    result = fit(data, FIXED)
    assert result.stop_reason == "error reached"
    assert result.rms <= 2.0
    assert len(result.history["gflop"]) < 40
    weighted = data.weights * (result.network.value(data.inputs) - data.targets)
    assert result.rms == pytest.approx(np.sqrt(np.mean(weighted[~data.validation] ** 2)))
    assert np.mean(weighted[data.validation] ** 2) <= 2.0**2
    assert result.network.parameter_count == (4 * 6) + (7 * 5) + 6


def test_a_domain_of_few_rows_that_is_off_does_not_hide_behind_the_many_that_are_not():
    """One row in twenty errs four times as much as the tolerance: too few to be seen in the error of all rows."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (2000, 2))
    rare = np.arange(2000) % 20 == 7
    targets = np.where(rare, 0.4 * np.sin(4.0 * x[:, 1]) + 0.1, 0.0)
    validation = rng.random(2000) < 0.25
    inputs = np.column_stack([x, rare])
    pooled = Regression("rare", inputs, targets, np.ones(2000), validation, tolerance=0.1)
    by_domain = replace(pooled, domain=np.where(rare, 2, 1))

    def rare_rms(network):
        return np.sqrt(np.mean(pooled.squares(network)[rare & validation]))

    assert rare_rms(fit(pooled, FIXED).network) > 0.2
    result = fit(by_domain, FIXED)
    assert result.stop_reason == "error reached"
    assert rare_rms(result.network) <= 0.1


def test_a_budget_counts_operations_so_that_a_busy_machine_gives_the_same_weights():
    """Growth and restarts too go by work: nothing but the data, the settings and the budget shapes the result."""
    settings = replace(GROWING, max_gflop=0.15, max_iterations=None)
    quiet, busy = fit(smooth(), settings), fit(smooth(), settings, progress=lambda *_: smooth(5000))  # takes CPU time
    assert quiet.stop_reason == busy.stop_reason == "budget used"
    assert len(sizes_in_order(quiet, settings)) > 1
    np.testing.assert_array_equal(flatten(quiet.network), flatten(busy.network))
    assert quiet.gflop == busy.gflop >= 0.15
    assert not np.array_equal(flatten(quiet.network), flatten(fit(smooth(), replace(settings, seed=1)).network))


def test_a_clock_in_place_of_counted_work_ends_a_fit_and_makes_it_grow(monkeypatch):
    """A clock that ticks once for each iteration: growth goes by the pace so far."""
    ticks = iter(range(100_000))
    monkeypatch.setattr("casadi_contact.networks.training.trainer.time.thread_time", lambda: next(ticks))
    settings = replace(GROWING, max_gflop=np.inf, max_iterations=None, max_cpu_s=150.0)
    result = fit(smooth(), settings)
    assert (result.stop_reason, result.cpu_s, len(result.history["gflop"])) == ("budget used", 150.0, 150)
    assert len(sizes_in_order(result, settings)) > 1


def noise(rows=60):
    """Nothing to learn: a large network learns the training rows by heart, and validation must suffer."""
    rng = np.random.default_rng(2)
    validation = np.arange(rows) % 2 == 0
    return Regression("noise", rng.normal(size=(rows, 3)), rng.normal(size=rows), np.ones(rows), validation, 0.0)


def test_validation_rising_ends_a_fit_and_the_best_weights_are_kept():
    result = fit(noise(), TrainingSettings(sizes=((12, 12),), max_iterations=400, max_validation_rises=4))
    assert result.stop_reason == "validation error rising"
    errors, squares = result.history["validation_error"], noise().squares(result.network)[noise().validation]
    assert typical_error(squares, 0.0) == pytest.approx(errors.min(), rel=1e-9)
    assert errors.min() < errors[-1]


def test_a_lone_validation_row_does_not_choose_a_worse_network():
    """One row in 93 lies where no other does: larger networks err by newtons there, and by a hundredth elsewhere."""
    lone, plain = smooth(tolerance=1e-3), smooth(tolerance=1e-3)
    lone.inputs[np.argmax(lone.validation)] *= 6.0
    assert fit(lone, GROWING).rms == fit(plain, GROWING).rms


def test_validation_rows_do_not_steer_the_weights():
    data = smooth()
    settings = replace(FIXED, max_validation_rises=1000)
    kept = ~data.validation
    alone = Regression("alone", *(a[kept] for a in (data.inputs, data.targets, data.weights, data.validation)), 0.0)
    spoilt = replace(data, targets=np.where(data.validation, 55.0, data.targets), inputs=data.inputs.copy())
    spoilt.inputs[data.validation] *= 3.0
    courses = [fit(r, settings).history["training_rms"] for r in (data, alone, spoilt)]
    np.testing.assert_array_equal(courses[0], courses[1])
    np.testing.assert_array_equal(courses[0], courses[2])


def test_a_network_that_misses_grows_wider_then_deeper():
    result = fit(smooth(tolerance=1e-9), GROWING)
    assert sizes_in_order(result, GROWING) == list(GROWING.sizes)
    rms, starts = result.history["training_rms"], np.flatnonzero(np.diff(result.history["size"])) + 1
    assert rms[starts[0]] < 1.2 * rms[starts[0] - 1], "widening is warm: the error does not start again"
    assert rms[-1] < 0.1 * rms[starts[0]]


def test_the_smallest_network_that_meets_the_tolerance_is_kept():
    only_small = fit(smooth(), replace(GROWING, sizes=GROWING.sizes[:1]))
    result = fit(smooth(tolerance=0.3 * only_small.rms), GROWING)
    assert result.stop_reason == "error reached"
    assert result.network.hidden in GROWING.sizes[1:-1]


def test_a_stalled_fit_restarts_from_other_seeds_and_the_best_is_kept():
    """At most 20 iterations without halving the error: every seed stalls sooner or later."""
    stalling = replace(FIXED, max_iterations=400, stall_window=20, stall_improvement=0.5)
    alone, result = (fit(smooth(), replace(stalling, restarts=restarts)) for restarts in (0, 2))
    assert alone.stop_reason == result.stop_reason == "stalled"
    rms = result.history["training_rms"]
    np.testing.assert_array_equal(rms[: len(alone.history["size"])], alone.history["training_rms"])
    assert np.sum(rms[1:] > 3.0 * rms[:-1]) == 2, "two restarts, each with a larger error"
    validation = smooth().squares(result.network)[smooth().validation]
    assert typical_error(validation, 0.0) == pytest.approx(result.history["validation_error"].min(), rel=1e-9)
    growing = replace(stalling, restarts=0, sizes=((2,), (6, 5)))
    assert sizes_in_order(fit(smooth(), growing), growing) == [(2,), (6, 5)], "it grows while it can"


@pytest.mark.parametrize("value", [0.0, -3e-9, 1e9])
def test_a_constant_target_is_fitted_at_once(value):
    data = replace(smooth(), targets=np.full(400, value), tolerance=1e-9 * abs(value))
    result = fit(data, FIXED)
    assert result.stop_reason == "error reached"
    np.testing.assert_allclose(result.network.value(data.inputs), value, rtol=1e-9, atol=1e-30)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_gflop": np.nan}, "max_gflop"),
        ({"max_iterations": None, "max_gflop": np.inf}, "expected an end"),
        *(({"sizes": sizes}, "sizes") for sizes in ((), ((0,),), ((8,), (6,)), ((8, 8), (20,)), ((8,), (8,)))),
    ],
)
def test_bad_settings_are_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        replace(FIXED, **change)


def test_a_start_is_gone_on_from():
    """On shifted data a warm fit begins where the first one ended, with the first one's scales, and gets better."""
    data = smooth()
    first = fit(data, FIXED)
    moved = replace(data, inputs=data.inputs + 0.01, targets=1.01 * data.targets)
    short = replace(FIXED, max_iterations=5)
    warm, cold = fit(moved, short, start=first.network), fit(moved, short)
    assert warm.rms < 0.2 * cold.rms
    np.testing.assert_array_equal(warm.network.input_shift, first.network.input_shift)
    assert warm.network.output_scale == first.network.output_scale
    same = fit(data, replace(FIXED, max_iterations=1), start=first.network)
    assert same.rms <= first.rms * (1.0 + 1e-9)


def test_a_load_predicted_where_there_is_none_counts_as_the_load_that_it_is():
    """One lifted pose far from all others, whose gap weighs 13 N: 2,500 N are learned there, unless they count."""
    rng = np.random.default_rng(1)
    inputs = rng.uniform(-1.0, 1.0, (600, 2))
    inputs[0] = 3.0
    roots = 0.7 + 0.4 * inputs[:, 0] + 0.1 * np.sin(4.0 * inputs[:, 1])
    roots[0] = -4.7
    weights = np.where(roots > 0.0, 2000.0 * np.maximum(roots, 0.07), 2.8)
    lifted = Regression("root", inputs, roots, weights, np.zeros(600, bool), 0.0)
    settings = TrainingSettings(sizes=((4, 4),), max_iterations=60, restarts=0, seed=1)
    falsely, rightly = (
        fit(replace(lifted, false_load=false_load), settings).network.value(inputs)
        for false_load in (0.0, np.where(roots > 0.0, 0.0, 1000.0))
    )
    assert falsely[0] > 1.0, "√(N/N0) of a load of 1,000 N and more"
    assert rightly[0] < 0.0
    assert np.sqrt(np.mean((weights * (rightly - roots))[1:] ** 2)) < 2.0


def test_several_outputs_are_fitted_by_neurons_they_share():
    one = smooth()
    targets = np.column_stack([one.targets, one.targets**2, np.sin(one.inputs).sum(axis=1)])
    weights = np.random.default_rng(1).uniform(0.2, 1.0, targets.shape)
    three = replace(one, targets=targets, weights=weights)
    found = fit(three, TrainingSettings(sizes=((8, 8),), max_iterations=60, restarts=0))
    training = three.squares(found.network)[~one.validation]
    assert found.rms == pytest.approx(np.sqrt(training.mean()))
    spread = weights * (targets - targets.mean(axis=0))
    assert found.rms < 0.05 * np.sqrt((spread**2).sum(axis=1).mean())


# --- residuals that count more in some domains

DOMAIN = np.repeat(np.array([1, 3, 4], dtype=np.uint8), 200)
INPUTS = np.random.default_rng(5).uniform(-1.0, 1.0, (600, 2))
ROUGH = np.sin(3.0 * INPUTS[:, 0]) * np.cos(2.0 * INPUTS[:, 1])


@pytest.mark.parametrize("outputs", [1, 2])
def test_residuals_are_multiplied_and_their_mean_square_is_kept(outputs):
    before = Regression("root", INPUTS, ROUGH, np.ones(600), np.zeros(600, bool), 0.0, 0.5, domain=DOMAIN)
    if outputs == 2:
        before = replace(before, targets=np.stack([ROUGH, ROUGH], 1), weights=np.ones((600, 2)), false_load=0.0)
    network = initial_network(INPUTS, before.targets, (4,), "tanh", 0)
    squares = [r.squares(network).reshape(3, -1) for r in (before.weighted({1: 4.0, 3: 2.0}), before)]
    ratio = squares[0].sum(axis=1) / squares[1].sum(axis=1)
    with pytest.raises(ValueError, match="domain"):
        replace(before, domain=None).weighted({1: 2.0})
    np.testing.assert_allclose(ratio, 3.0 * np.array([16.0, 4.0, 1.0]) / 21.0)


# --- the third criterion of [EF15 §2.6] on hand-made histories, and the trend of an error

NAN = float("nan")


@pytest.mark.parametrize(
    ("validation", "rising"),
    [
        ([5.0, 4.0, 4.1, 4.2, 4.3], True),
        ([4.0, 4.1, 4.2, 4.1, 4.3, 4.4], False),  # not in a row
        ([4.0, 4.1, 4.1, 4.2, 4.2, 4.3], True),  # refused steps repeat a value
        ([NAN] * 9, False),
        ([], False),
    ],
)
def test_validation_rising_three_times_in_a_row(validation, rising):
    assert validation_rising(validation, 3) is rising


def test_an_error_falling_as_a_power_of_effort_is_extrapolated_and_a_rising_one_stands_still():
    effort = np.arange(1.0, 51.0)
    assert extrapolated_error(effort, 8.0 / effort**0.5, end=200.0) == pytest.approx(8.0 / 200.0**0.5)
    assert extrapolated_error(effort, 1.0 + 0.01 * effort, end=100.0) == pytest.approx(1.5)
