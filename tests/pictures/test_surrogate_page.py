"""The report page: one offline file, and a verdict that `verify` would give on the same samples."""

import re
from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.cli.pipeline import write_report
from casadi_contact.pictures.surrogate_page import surrogate_page
from casadi_contact.samples.samples import Dropped, domain_errors, samples_record, write_samples
from casadi_contact.surrogate.info import Fitness
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.random_surrogates import random_confidence, random_network
from tests.support.smooth_samples import CENTRE, SPHERE, SPREAD, smooth_samples

SAMPLES = smooth_samples(300)


@pytest.fixture(scope="module")
def surrogate():
    """An untrained surrogate with the record of its errors on the samples, and a confidence of random numbers."""
    rng = np.random.default_rng(0)
    networks = {
        name: random_network(rng, CENTRE, SPREAD, (5,), "algebraic", 0.05 if outputs == 1 else np.full(outputs, 0.05))
        for name, outputs in PatchSurrogate.network_outputs(SPHERE).items()
    }
    made = PatchSurrogate(SPHERE, networks)
    record = {
        "test_errors": domain_errors(made, SAMPLES),
        "pose_range": {name: [-1.0, 1.0] for name in ("tx", "ty", "tz", "rx", "ry", "rz")},
        "command": "<script>alert('got you')</script>",
        "coverage": {"D1": {"valid": 0.5, "Fy": 0.25}},
    }
    return PatchSurrogate(SPHERE, networks, record, random_confidence(1, len(made.load_names)))


TOLERANCES, WITHIN, OFF = {"Fy": 1.0, "Tz": 25.0}, {"Fy": 0.5, "Tz": 20.0}, {"Fy": 0.9, "Tz": 50.0}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (({"D1": WITHIN},), "fit for use within 0.5 N and 20 N·mm (RMS of held-back samples) in D1"),
        (({"D1": WITHIN, "D4": OFF},), "in D1; not in D4: Tz is off by 50 N·mm, tolerance 25"),
        (({"D4": OFF},), "not fit for use: D4: Tz"),
        (({"D4": {**WITHIN, "Fy": 1.0004}},), "Fy is off by 1.0004 N, tolerance 1"),
        (({},), "not judged"),
        (({"D1": WITHIN}, {"D1": 0.1, "D2": 0.93, "D3": 1.0}), "dropped and not judged: of D2 93 %, of D3 100 %"),
        (({"D1": OFF, "D5": {"Fy": 0.0}},), "not fit for use: D1: Tz is off by 50"),  # D5: no contact
        (
            ({"D1": WITHIN, "D2": WITHIN, "D3": OFF}, {}, {"D1": 300, "D2": 9, "D3": 9}),
            "judged by few samples: 9 of D2",
        ),
    ],
)
def test_the_verdict_names_what_is_within_off_dropped_and_hardly_known(given, said):
    errors, *more = given
    assert said in str(Fitness(errors, TOLERANCES, *more))


def test_a_surrogate_says_how_few_samples_it_was_judged_by_and_how_much_of_its_plan_it_does_not_know(surrogate):
    """Errors on held-back samples tell nothing of the poses that became none."""
    of_d2 = int((SAMPLES.domain == 2).sum())
    drawn = replace(SAMPLES, dropped=Dropped(np.zeros((3 * of_d2, 6)), np.full(3 * of_d2, 2)))
    partial = PatchSurrogate(SPHERE, surrogate.networks, {**surrogate.record, **samples_record(drawn)})
    generous = str(replace(partial.info().fitness, tolerances=dict.fromkeys(partial.load_names, 1e9)))
    assert f"{SAMPLES.counts()['D1']['test']} of D1" in generous.partition("; judged by few samples: ")[2]
    assert "dropped and not judged: of D2 75 %" in generous
    assert "dropped, of the plan: D2 75.0 %" in str(partial.info())
    assert "dropped" not in str(surrogate.info())


def test_the_page_is_one_file_that_loads_nothing_and_runs_nothing(surrogate, tmp_path):
    write_samples(tmp_path / "samples.h5", SAMPLES)
    path = write_report({"patch": surrogate}, tmp_path, tmp_path / "report.html")
    text = path.read_text("utf-8")
    assert not re.search(r"<(script|link|iframe|object)|https?://", text)
    (picture,) = re.findall(r' src="([^"]*)', text)
    assert picture.startswith("data:image/png;base64,")
    assert "&lt;script&gt;alert" in text
    assert str(surrogate.info().fitness) in text
    bare = surrogate_page({"patch": PatchSurrogate(SPHERE, surrogate.networks)})
    assert text.count('class="verdict unfit"') == bare.count('class="verdict unfit"') == 1
    for said in ("not judged", "reach: not recorded", "not calibrated", "No samples of this scene"):
        assert said in bare
