"""An activation is one record: value and derivatives are the same in NumPy, training, CasADi, C and autograd."""

import math

import casadi as ca
import numpy as np
import pytest

from casadi_contact.networks.activations import ACTIVATIONS, Activation, activation_of
from casadi_contact.networks.functions import hessian_function
from casadi_contact.networks.network import Network
from casadi_contact.scenes.loading import load_scene
from tests.support.agreement import close
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import random_poses, random_surrogate

torch = pytest.importorskip("torch", reason="its autograd is the oracle")


def _arctan(xp, z, order):
    slope = 1.0 / (1.0 + (0.5 * math.pi) ** 2 * z * z)
    value = (2.0 / math.pi) * (xp.atan if hasattr(xp, "atan") else xp.arctan)(0.5 * math.pi * z)
    return (value, slope)[: order + 1]


ARCTAN = Activation(
    _arctan,
    lambda xp, a: xp.cos(0.5 * math.pi * a) ** 2,
    f"""\
const double t = {0.5 * math.pi!r} * z;
value = {2.0 / math.pi!r} * atan(t);
slope = 1.0 / (1.0 + t * t);
curvature = {-2.0 * (0.5 * math.pi) ** 2!r} * z * slope * slope;""",
)


@pytest.fixture(params=[*ACTIVATIONS, "arctan"])
def name(request, monkeypatch):
    """The library's own activations, and (2/π)·arctan(πz/2), which is only this record."""
    if request.param == "arctan":
        monkeypatch.setitem(ACTIVATIONS, "arctan", ARCTAN)
    return request.param


def autograd(function, z):
    """Value and derivative of an elementwise function in torch."""
    z = torch.tensor(z, dtype=torch.float64, requires_grad=True)
    value = function(z)
    (slope,) = torch.autograd.grad(value.sum(), z)
    return value.detach().numpy(), slope.numpy()


def test_the_record_s_formulas_are_each_other_s_derivatives(name):
    z = np.linspace(-6.0, 6.0, 241)
    record = activation_of(name)
    want = autograd(lambda x: record.derivatives(torch, x, 0)[0], z)
    symbol = ca.MX.sym("z", len(z))
    in_casadi = ca.Function("sigma", [symbol], list(record.derivatives(ca, symbol, 1)))(z)
    for got, also, oracle in zip(record.derivatives(np, z, 1), in_casadi, want, strict=True):
        np.testing.assert_allclose(got, oracle, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(also.full().ravel(), oracle, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(record.slope_from_value(np, want[0]), want[1], rtol=1e-9, atol=1e-12)
    textbook = {"algebraic": z / np.hypot(1.0, z), "tanh": np.tanh(z)}
    if name in textbook:
        np.testing.assert_allclose(want[0], textbook[name], rtol=1e-14, atol=1e-15)


@needs_compiler
def test_numpy_graph_and_kernel_agree_on_a_surrogate(name):
    surrogate = random_surrogate(load_scene("sphere_on_plane"), "two_stage", name, seed=2)
    graph, kernel = surrogate.function(compiled=False), surrogate.function()
    assert kernel.class_name() == "External"
    poses, weights = random_poses(6), np.arange(1.0, 1.0 + graph.numel_out(0))
    assert np.abs(surrogate(poses)).max() > 0.0
    pairs = [(f, f.jacobian(), hessian_function(f)) for f in (graph, kernel)]
    for x in poses:
        value, slopes = surrogate.jacobian(x)
        for f, jacobian, _ in pairs:
            close(f(x).full().ravel(), value, 10)
            close(jacobian(x, 0).full(), slopes, 9)
        close(pairs[0][2](x, weights).full(), pairs[1][2](x, weights).full(), 9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"activation": "relu"}, "relu"),
        ({"input_scale": np.array([1.0, 0.0])}, "scale"),
        ({"weights": (), "biases": ()}, "layer"),
        ({"weights": (np.ones((1, 3)),)}, "weights"),
        ({"weights": (np.array([[np.nan, 1.0]]),)}, "NaN or infinity"),
        ({"biases": (np.array([np.inf]),)}, "NaN or infinity"),
        ({"output_scale": np.inf}, "NaN or infinity"),
    ],
)
def test_a_network_that_cannot_be_is_refused(change, said):
    sound = {"weights": (np.ones((1, 2)),), "biases": (np.zeros(1),)}
    with pytest.raises(ValueError, match=said):
        Network(**{"input_shift": np.zeros(2), "input_scale": np.ones(2), **sound, **change})
