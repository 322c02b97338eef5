"""Checkpoints of a fit: what a kill costs, and which files are gone on from."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.trainer import Trainer
from casadi_contact.networks.training.weights import flatten
from tests.support.smooth_samples import FIXED, GROWING, smooth


def kill_after(iterations):
    count = 0

    def progress(*_):
        nonlocal count
        count += 1
        if count == iterations:
            raise ZeroDivisionError

    return progress


@pytest.mark.parametrize(
    "limit", [{"checkpoint_every_s": 0.0}, {"checkpoint_every_s": 1000.0, "max_iterations": None, "max_gflop": 0.15}]
)
def test_kill_and_resume_is_as_if_nothing_happened(tmp_path, limit):
    settings = replace(GROWING, **limit)
    whole, path = fit(smooth(), settings), tmp_path / "a.npz"
    for iterations in (1, 50):
        with pytest.raises(ZeroDivisionError):
            fit(smooth(), settings, path, progress=kill_after(iterations))
    resumed = fit(smooth(), settings, path)
    np.testing.assert_array_equal(flatten(resumed.network), flatten(whole.network))
    for column in ("training_rms", "validation_error", "size", "gflop"):
        np.testing.assert_array_equal(resumed.history[column], whole.history[column])
    assert list(tmp_path.iterdir()) == [path]


def test_a_finished_fit_comes_from_its_checkpoint(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    first = fit(smooth(), FIXED, path)
    monkeypatch.setattr(Trainer, "iterate", None)
    again = fit(smooth(), FIXED, path)
    np.testing.assert_array_equal(flatten(first.network), flatten(again.network))
    assert again.stop_reason == first.stop_reason
    assert (again.gflop, again.cpu_s) == (first.gflop, first.cpu_s)


def test_a_damaged_checkpoint_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    fit(smooth(), FIXED, path)
    path.write_bytes(path.read_bytes()[:-3000])
    with pytest.raises(ValueError, match=r"is damaged .*delete it"):
        fit(smooth(), FIXED, path)


@pytest.mark.parametrize("other", ["settings", "start", "file"])
def test_a_checkpoint_of_other_settings_is_refused_and_kept(tmp_path, other):
    path, short = tmp_path / "a.npz", replace(FIXED, max_iterations=2)
    network = fit(smooth(), short, path).network
    if other == "file":
        np.savez(path, something=np.ones(3))
    content = path.read_bytes()
    changed = replace(short, seed=1) if other == "settings" else short
    with pytest.raises(ValueError, match="other data"):
        fit(smooth(), changed, path, start=network if other == "start" else None)
    assert path.read_bytes() == content


def test_a_fit_goes_on_on_a_machine_that_rounds_its_data_otherwise_and_not_with_hardly_other_data(tmp_path):
    path, rng, data = tmp_path / "a.npz", np.random.default_rng(0), smooth()
    first = fit(data, FIXED, path)
    ulps = {name: np.spacing(getattr(data, name)) for name in ("inputs", "targets", "weights")}
    moved = {name: getattr(data, name) + 2.0 * ulp * rng.integers(-1, 2, ulp.shape) for name, ulp in ulps.items()}
    again = fit(replace(data, **moved), FIXED, path)
    np.testing.assert_array_equal(flatten(first.network), flatten(again.network))

    for name, change in (("inputs", "a row"), ("targets", "their order"), ("weights", "a row")):
        values = getattr(smooth(), name).copy()
        values[[7, 8]] = values[[8, 7]] if change == "their order" else 1.001 * values[[7, 8]]
        with pytest.raises(ValueError, match="belongs to other data or settings"):
            fit(replace(smooth(), **{name: values}), FIXED, path)
