"""Independent fits through an executor give what they give alone."""

import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from threading import Event

import numpy as np
import pytest

from casadi_contact.networks.training import parallel
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.parallel import fit_all
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.weights import flatten
from tests.support.smooth_samples import smooth

SETTINGS = TrainingSettings(sizes=((6, 5),), max_gflop=300.0, max_iterations=30)
DATA = [smooth(seed=k, name=name) for k, name in enumerate(("root_med", "Fx/lat", "root_lat"))]
EACH = {data.name: SETTINGS for data in DATA}


def test_processes_give_the_weights_of_single_fits(tmp_path):
    told = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        fits = fit_all(DATA, EACH, pool, tmp_path, lambda *line: told.append(line))
    assert list(fits) == ["root_med", "Fx/lat", "root_lat"]
    for data in DATA:
        np.testing.assert_array_equal(flatten(fits[data.name].network), flatten(fit(data, SETTINGS).network))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["Fx%2Flat.npz", "root_lat.npz", "root_med.npz"]
    again = fit_all(DATA, {data.name: replace(SETTINGS, max_iterations=32) for data in DATA}, None, tmp_path)
    for name, fitted in fits.items():
        np.testing.assert_array_equal(again[name].history["gflop"][:30], fitted.history["gflop"], "continued")
    for name, used, allotted, remark in told:
        assert name in fits
        assert used >= 0.0
        assert allotted in (300.0, used)
        assert re.fullmatch(r"Gflop, 6-5 RMS [\d.e-]+", remark)


def test_the_largest_budget_starts_first():
    budgets = {"root_med": 10.0, "Fx/lat": 300.0, "root_lat": 100.0}
    order = []

    def progress(name, *_):
        if name not in order:
            order.append(name)

    fit_all(DATA, {n: replace(SETTINGS, max_gflop=t, max_iterations=2) for n, t in budgets.items()}, progress=progress)
    assert order == ["Fx/lat", "root_lat", "root_med"]


def test_progress_of_a_worker_reaches_the_caller(tmp_path, monkeypatch):
    """The worker here goes on only when the caller has heard of its first iteration."""
    told, heard = [], Event()

    def patient_fit(regression, settings, checkpoint, tell, start):
        def tell_and_wait(*line):
            tell(*line)
            assert heard.wait(60.0), "the caller heard nothing"

        return fit(regression, settings, checkpoint, tell_and_wait, start)

    def progress(*line):
        told.append(line)
        heard.set()

    monkeypatch.setattr(parallel, "fit", patient_fit)
    with ThreadPoolExecutor(1) as pool:
        fit_all([smooth()], {"smooth": SETTINGS}, pool, tmp_path, progress)
    *before, end = told
    assert all(line[0] == "smooth" and line[2] == 300.0 and line[3].startswith("Gflop, 6-5 RMS ") for line in before)
    assert end[0] == "smooth"
    assert 0.0 < end[1] == end[2] < 300.0


def test_what_cannot_be_fitted_is_refused_before_any_fit():
    with pytest.raises(ValueError, match="Fx/lat: targets holds"):
        fit_all([DATA[0], replace(DATA[1], targets=np.full(400, np.nan))], EACH)
