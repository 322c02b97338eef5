"""The largest stable step of fixed-step schemes is the one that the linearised motion allows."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from problems import knee_simulator
from problems.knee_simulator import constant, start_state
from problems.studies import stable_step
from tests.support.command import ended


@pytest.fixture(scope="module")
def loaded():
    simulator = knee_simulator.build(cc.load_surrogate("knee"), constant(20.0, 800.0))
    return simulator, start_state(simulator)


def linear_limit(simulator, rest, amplification):
    """Largest h with |amplification(h·λ)| <= 1 for all eigenvalues of the linearised motion, by a fine scan."""
    x = ca.MX.sym("x", 10)
    values = np.linalg.eigvals(np.asarray(ca.Function("j", [x], [ca.jacobian(simulator.rate(x, 0.0), x)])(rest)))
    assert (values.real < 0.0).all()
    steps = np.geomspace(1e-6, 1e-2, 4001)
    stable = (np.abs(amplification(steps[:, None] * values)) <= 1.0).all(axis=1)
    return steps[np.argmin(stable) - 1]


@pytest.mark.parametrize(
    ("scheme", "amplification"),
    [("explicit_euler", lambda z: 1.0 + z), ("rk4", lambda z: 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0)],
)
def test_explicit_schemes_reach_the_limit_of_the_linearised_motion(loaded, scheme, amplification):
    measured = stable_step.largest_stable_step(loaded[0], scheme, loaded[1])
    assert measured == pytest.approx(linear_limit(*loaded, amplification), rel=0.03)


@pytest.mark.parametrize("scheme", ["implicit_euler", "implicit_midpoint"])
def test_implicit_schemes_have_no_limit_below_a_tenth_of_a_second(loaded, scheme):
    assert stable_step.largest_stable_step(loaded[0], scheme, loaded[1], steps=200) == stable_step.LONGEST_STEP_S


@pytest.mark.parametrize(
    ("scheme", "amplification"),
    [
        ("explicit_euler", lambda z: 1.0 + z),
        ("rk4", lambda z: 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0),
        ("implicit_euler", lambda z: 1.0 / (1.0 - z)),
        ("implicit_midpoint", lambda z: (1.0 + 0.5 * z) / (1.0 - 0.5 * z)),
    ],
)
def test_a_step_multiplies_what_decays_by_the_amplification_of_its_scheme(scheme, amplification):
    rates, begun, h = -np.linspace(0.1, 30.0, 10), np.linspace(1.0, 2.0, 10), 0.02
    x, t = ca.MX.sym("x", 10), ca.MX.sym("t")
    decaying = SimpleNamespace(rate=ca.Function("rate", [x, t], [ca.DM(rates) * x]))
    step = stable_step.step_function(decaying, scheme)
    np.testing.assert_allclose(np.asarray(step(begun, h)).ravel(), amplification(h * rates) * begun, rtol=1e-9)


def test_stiffer_contact_allows_shorter_explicit_steps(loaded):
    light = knee_simulator.build(loaded[0].model, constant(20.0, 50.0))
    rest = start_state(light)
    assert stable_step.contact_stiffness(light, rest) < 0.5 * stable_step.contact_stiffness(*loaded)
    assert stable_step.fastest_rate(light, rest) < stable_step.fastest_rate(*loaded)
    assert stable_step.largest_stable_step(light, "rk4", rest) > stable_step.largest_stable_step(
        loaded[0], "rk4", loaded[1]
    )


def test_an_unknown_scheme_is_refused(loaded):
    with pytest.raises(ValueError, match="scheme is 'leapfrog', expected one of explicit_euler"):
        stable_step.step_function(loaded[0], "leapfrog")


def test_a_mistake_is_one_line(monkeypatch):
    said = ended(monkeypatch, stable_step.main, "--axial", "much")
    assert said == "stable_step: --axial is 'much', expected finite numbers separated by commas"
