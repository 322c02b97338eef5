"""Independent fits through an executor give what they give alone."""

import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np

from casadi_contact.networks.training.fit import fit, fit_all
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
        assert 0.0 < used <= allotted
        assert allotted in (300.0, fits[name].gflop)
        assert re.fullmatch(r"Gflop, 6-5 RMS [\d.e-]+", remark)
    assert {line[0] for line in told} == set(fits)
