"""Named loads and root loads of a contact model from one evaluation are those of two."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.model import jacobian_and_roots
from casadi_contact.contact.named_loads import NamedLoads

POSES = [[0.0, -0.1, 0.2, 0.01, 0.0, -0.3], [0.0, 5.0, 0.0, 0.02, 0.0, 0.0], [0.0, 0.2, 0.0, 0.03, 0.0, -0.6]]


MODELS = {
    "elements": lambda: cc.ElasticFoundation(cc.load_scene("knee"), (40, 20)),
    "polar quadrature": lambda: cc.foundation("knee"),
    "polar quadrature in NumPy": lambda: cc.foundation("knee", compiled=False),
    "surrogate": lambda: cc.load_surrogate("knee"),
    "elements by other loads": lambda: NamedLoads(cc.ElasticFoundation(cc.load_scene("knee"), (40, 20)), ["Tx_lat"]),
}


@pytest.mark.parametrize("kind", MODELS)
def test_together_they_are_what_they_are_alone(kind):
    model, poses = MODELS[kind](), np.array(POSES)
    apart = (*model.jacobian(poses), *model.root_loads(poses))
    for one, two in zip(jacobian_and_roots(model, poses), apart, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12 * np.abs(two).max())


def test_a_pose_is_evaluated_once_for_both(monkeypatch):
    model, calls = cc.ElasticFoundation(cc.load_scene("knee"), (20, 15)), []
    found = model.wrench_jacobian
    monkeypatch.setattr(model, "wrench_jacobian", lambda poses: calls.append(1) or found(poses))
    jacobian_and_roots(model, np.array(POSES))
    assert len(calls) == 1
