"""What a CasADi user would write instead: every form is the same function, and IPOPT ends at the same poses."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from problems.studies import casadi_forms as study
from tests.support.ready_poses import KNEE


@pytest.mark.parametrize("name", ["knee", "knee_two_stage"])
@pytest.mark.parametrize("form", ["CasADi MX", "CasADi SX", "PyTorch callback"])
def test_every_form_has_the_values_and_derivatives_of_our_own(form, name):
    if form.startswith("PyTorch"):
        pytest.importorskip("torch")
    own = cc.load_surrogate(name)
    written = study.Written(own, form)
    functions = [model.load_and_root_function() for model in (written, own)]
    for output in (0, 1):
        np.testing.assert_allclose(*(function(KNEE)[output] for function in functions), rtol=1e-8, atol=1e-8)
    for derivative, given in ((ca.Function.jacobian, [0]), (study.hessian_function, [np.ones(7)])):
        got, want = (np.asarray(derivative(model.function())(KNEE, *given)) for model in (written, own))
        np.testing.assert_allclose(got, want, rtol=1e-6, atol=1e-6 * abs(want).max())


def test_ipopt_finds_the_same_poses_and_a_form_that_is_not_installed_says_so(monkeypatch):
    def absent(*_):
        raise ImportError("no such package")

    monkeypatch.setitem(study.FORMS, "absent", absent)
    forms = ("CasADi MX", "absent")
    found = study.measured(cc.load_surrogate("knee"), np.array([KNEE]), frames=3, few=3, forms=forms)
    assert found.pop("absent") == {"missing": "no such package"}
    assert {each["iterations"] for each in found.values()} == {found[study.OWN]["iterations"]}
    assert all(each["solved"] == 3 and each["Hessian_us"] > 0.0 for each in found.values())
