"""Every form of the two-stage networks gives the same loads and derivatives."""

import casadi as ca
import numpy as np
import pytest

from casadi_contact.scenes.loading import load_scene
from casadi_contact.workflow.benchmark.peers import casadi_forms
from casadi_contact.workflow.benchmark.peers.casadi_forms import CasadiModel, compiled_form, plain_form
from casadi_contact.workflow.benchmark.peers.two_stage_forms import two_stage_forms
from tests.support.random_surrogates import random_poses, random_surrogate

NAMES = ("Fy_med", "Tx", "Fz")


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(load_scene("knee"), "two_stage", "tanh", seed=4)


def agree(surrogate, form):
    multipliers = np.array([0.3, -1.0, 2.0])
    reference = surrogate.function(NAMES)
    pose = ca.MX.sym("pose", 6)
    hessian = ca.Function("h", [pose], [ca.hessian(ca.dot(ca.DM(multipliers), reference(pose)), pose)[0]])
    for x, jacobian in zip(random_poses(6), surrogate.jacobian(random_poses(6), NAMES)[1], strict=True):
        np.testing.assert_allclose(form.jacobian(x).full(), jacobian, rtol=1e-9, atol=1e-9 * np.abs(jacobian).max())
        want = hessian(x).full()
        np.testing.assert_allclose(form.hessian(x, multipliers).full(), want, atol=1e-9 * np.abs(want).max())
    poses = random_poses(30, seed=2)
    np.testing.assert_allclose(CasadiModel(form.loads, NAMES)(poses), surrogate(poses, NAMES), rtol=1e-10, atol=1e-8)


@pytest.mark.parametrize("symbols", [ca.MX, ca.SX])
def test_plain_graphs_agree_with_the_surrogate(surrogate, symbols):
    agree(surrogate, plain_form(surrogate, NAMES, symbols))


def test_generated_c_agrees_with_the_surrogate(surrogate):
    try:
        casadi_forms.compiler()
    except FileNotFoundError:
        pytest.skip("no C compiler")
    agree(surrogate, compiled_form(plain_form(surrogate, NAMES, ca.MX)))


def test_torch_agrees_with_the_surrogate(surrogate):
    pytest.importorskip("torch", reason="torch is not installed", exc_type=ImportError)
    from casadi_contact.workflow.benchmark.peers.torch_form import TorchForm

    form, poses = TorchForm(surrogate, NAMES), random_poses(5, seed=6)
    values, jacobians = surrogate.jacobian(poses, NAMES)
    np.testing.assert_allclose(form(poses), values, rtol=1e-10, atol=1e-8)
    plain = plain_form(surrogate, NAMES, ca.MX)
    with form.inference():
        for pose, value, jacobian in zip(poses, values, jacobians, strict=True):
            np.testing.assert_allclose(form.one(pose), value, rtol=1e-10, atol=1e-8)
            np.testing.assert_allclose(form.jacobian_one(pose), jacobian, atol=1e-9 * np.abs(jacobian).max())
            want = plain.hessian(pose, np.ones(len(NAMES))).full()
            np.testing.assert_allclose(form.hessian_one(pose), want, atol=1e-9 * np.abs(want).max())


def test_a_form_that_cannot_be_built_stays_with_its_reason(surrogate, monkeypatch):
    monkeypatch.setattr(casadi_forms.shutil, "which", lambda name: None)
    made = {c.name: c for c in two_stage_forms(surrogate, NAMES)}
    assert made["two-stage, CasADi C"].model is None
    assert "no C compiler" in made["two-stage, CasADi C"].failure
    assert made["two-stage, CasADi MX"].model is not None
    assert made["two-stage, CasADi MX"].parameters == sum(n.parameter_count for n in surrogate.networks.values())


def test_another_structure_is_refused_in_words():
    patch = random_surrogate(load_scene("knee"), "patch")
    with pytest.raises(ValueError, match="need a two_stage surrogate, got a patch surrogate"):
        list(two_stage_forms(patch, NAMES))
