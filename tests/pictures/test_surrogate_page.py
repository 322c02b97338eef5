"""The report page: one offline file, and a verdict that `verify` would give on the same samples."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from casadi_contact.cli.pipeline import write_report
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.surrogate_page import surrogate_page
from casadi_contact.samples.samples import DOMAINS, TEST, Dropped, domain_errors, write_samples
from casadi_contact.surrogate.fitness import Fitness, fitness
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.sample_rows import samples_record
from tests.support.random_surrogates import random_confidence, random_network
from tests.support.smooth_samples import CENTRE, SPHERE, SPREAD, smooth_samples

SAMPLES = smooth_samples(300)


class Tags(HTMLParser):
    """Names and attributes of all elements."""

    def __init__(self, text):
        super().__init__()
        self.elements = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))


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
        "convergence": {"root": {"gflop": [0.1, 1.0, 10.0], "rms": [50.0, 5.0, 0.5]}},
    }
    return PatchSurrogate(SPHERE, networks, record, random_confidence(1, len(made.load_names)))


def on_the_samples(poses, load_names):
    """A model that knows the samples' own loads."""

    class Known:
        def __init__(self):
            self.load_names, self.patch_names, self.scene = load_names, SPHERE.patch_names, SPHERE

        def __call__(self, asked):
            rows = [int(np.argmin(np.abs(poses - pose).sum(axis=1))) for pose in asked]
            return SAMPLES.select(role=TEST).loads(load_names)[rows]

    return Known()


def test_the_verdict_on_a_domain_is_that_of_verify_on_its_held_back_samples(surrogate):
    verdict, test = fitness(surrogate), SAMPLES.select(role=TEST)
    model = on_the_samples(test.poses, surrogate.load_names)
    checked = {}
    for domain in verdict.errors:
        verified = verify(surrogate, SAMPLES.select(domain, TEST).poses, model)
        np.testing.assert_allclose(list(verdict.errors[domain].values()), verified.rms, rtol=1e-12)
        checked[domain] = bool((verified.rms <= verified.tolerance.allowed).all())
    assert set(verdict.fit) == {domain for domain, passed in checked.items() if passed}
    assert len(checked) == 2
    generous = Fitness(verdict.errors, dict.fromkeys(verdict.tolerances, 1e9))
    assert generous.fit == list(checked)


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
        (
            ({"D1": OFF, "D5": {"Fy": 0.0}},),
            "not fit for use: D1: Tz is off by 50 N·mm, tolerance 25",
        ),  # D5: no contact
        (
            ({"D1": WITHIN, "D2": WITHIN, "D3": OFF}, {}, {"D1": 300, "D2": 9, "D3": 9}),
            "judged by few samples: 9 of D2",
        ),
    ],
)
def test_the_verdict_names_what_is_within_off_dropped_and_hardly_known(given, said):
    errors, *more = given
    assert said in str(Fitness(errors, TOLERANCES, *more))


@pytest.mark.parametrize(("off_n", "kind"), [(9.0, "verdict unfit"), (0.5, "verdict")])
def test_the_page_marks_a_verdict_by_what_it_says(surrogate, off_n, kind):
    errors = {domain: {"Fy": {"rms": rms, "max": rms}} for domain, rms in (("D1", off_n), ("D5", 0.0))}
    scene = replace(SPHERE, tolerances={**SPHERE.tolerances, "Fy": 1.0})
    made = PatchSurrogate(scene, surrogate.networks, {"test_errors": errors}, surrogate.confidence)
    text = surrogate_page({"patch": made})
    ((found, said),) = re.findall(r'<p class="(verdict[^"]*)">([^<]*)', text)
    assert found == kind
    assert ("not fit for use" in said) == (off_n > 1.0)


def test_a_surrogate_says_how_few_samples_it_was_judged_by_and_how_much_of_its_plan_it_does_not_know(surrogate):
    """Errors on held-back samples tell nothing of the poses that became none."""
    of_d2 = int((SAMPLES.domain == 2).sum())
    drawn = replace(SAMPLES, dropped=Dropped(np.zeros((3 * of_d2, 6)), np.full(3 * of_d2, 2)))
    partial = PatchSurrogate(SPHERE, surrogate.networks, {**surrogate.record, **samples_record(drawn)})
    generous = str(replace(fitness(partial), tolerances=dict.fromkeys(partial.load_names, 1e9)))
    assert f"{SAMPLES.counts()['D1']['test']} of D1" in generous.partition("; judged by few samples: ")[2]
    assert "dropped and not judged: of D2 75 %" in generous
    assert "dropped, of the plan: D2 75.0 %" in str(partial.info())
    assert "dropped" not in str(surrogate.info())


def test_the_page_is_one_file_that_loads_nothing_and_runs_nothing(surrogate, tmp_path):
    write_samples(tmp_path / "samples.h5", SAMPLES)
    path = write_report({"patch": surrogate}, tmp_path, tmp_path / "report.html")
    text = path.read_text("utf-8")
    elements = Tags(text).elements
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in elements}
    sources = [attributes["src"] for _, attributes in elements if "src" in attributes]
    assert len(sources) == 2, "the scene and the convergence of the fits"
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert not re.search(r"https?://", text)
    assert "&lt;script&gt;alert" in text
    assert str(fitness(surrogate)) in text
    assert [path.name for path in tmp_path.glob("report*")] == ["report.html"]


def test_what_a_file_does_not_record_is_said(surrogate):
    bare = PatchSurrogate(SPHERE, surrogate.networks)
    text = surrogate_page({"patch": bare})
    for said in (
        "not judged",
        "does not record the sampled poses",
        "never calibrated",
        "No samples of this scene lie beside",
        "how the fits converged",
    ):
        assert said in text
    with pytest.raises(ValueError, match="no surrogate to report"):
        surrogate_page({})


def test_rows_of_the_coverage_that_are_no_domains_are_explained(surrogate):
    shares = load_surrogate("knee_reach").info().coverage
    known = PatchSurrogate(SPHERE, surrogate.networks, surrogate.record | {"coverage": shares}, surrogate.confidence)
    others = set(shares) - set(DOMAINS)
    assert others == {"around", "range", "settled", "edge"}
    for text in (str(known.info()), surrogate_page({"patch": known})):
        assert all(f"{name}: " in text for name in others)


def test_the_errors_that_stand_out_are_those_above_their_tolerance(surrogate):
    """Neither those below it, nor the tolerances themselves, nor a load without error."""
    errors = {
        "D1": {"Fy": (9.0, 30.0), "Tx": (2.0, 60.0), "Tz": (8.0, 9.0)},
        "D2": {"Fy": (0.5, 3.0), "Tx": (50.0, 70.0)},
    }
    record = {d: {load: {"rms": r, "max": m} for load, (r, m) in row.items()} for d, row in errors.items()}
    scene = replace(SPHERE, tolerances={**SPHERE.tolerances, "Fy": 1.0, "Tx": 25.0, "Tz": 25.0})
    text = surrogate_page({"patch": PatchSurrogate(scene, surrogate.networks, {"test_errors": record})})
    assert re.findall(r'<td class="high">([^<]*)', text) == ["9 (30)", "50 (70)"]
