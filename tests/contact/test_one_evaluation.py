"""Named loads and root loads of a contact model from one evaluation are those of two."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.model import NamedLoads

POSES = [[0.0, -0.1, 0.2, 0.01, 0.0, -0.3], [0.0, 5.0, 0.0, 0.02, 0.0, 0.0], [0.0, 0.2, 0.0, 0.03, 0.0, -0.6]]


MODELS = {
    "elements": lambda: cc.ElasticFoundation(cc.load_scene("knee"), (40, 20)),
    "polar quadrature": lambda: cc.PolarFoundation(cc.load_scene("knee")),
    "polar quadrature in NumPy": lambda: cc.PolarFoundation(cc.load_scene("knee"), compiled=False),
    "surrogate": lambda: cc.load_surrogate("knee"),
    "elements by other loads": lambda: NamedLoads(cc.ElasticFoundation(cc.load_scene("knee"), (40, 20)), ["Tx_lat"]),
}


@pytest.mark.parametrize("kind", MODELS)
def test_together_they_are_what_they_are_alone(kind):
    model, poses = MODELS[kind](), np.array(POSES)
    apart = (*model.jacobian(poses), *model.root_loads(poses))
    for one, two in zip(model.jacobian_and_roots(poses), apart, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12 * np.abs(two).max())


def test_a_pose_is_evaluated_once_for_both(monkeypatch):
    model, calls = cc.ElasticFoundation(cc.load_scene("knee"), (20, 15)), []
    found = model.wrench_jacobian
    monkeypatch.setattr(model, "wrench_jacobian", lambda poses: calls.append(1) or found(poses))
    model.jacobian_and_roots(np.array(POSES))
    assert len(calls) == 1


PRESSED_AND_APART = {
    "knee": (MODELS["polar quadrature"], [[0.0, 27.0, 0.2, 0.0, 0.0, -0.3], [0.0, 29.5, 0.2, 0.0, 0.0, -0.3]]),
    "knee on one side": (MODELS["polar quadrature"], [[0.0, 27.8, 0.2, 0.03, 0.0, -0.3]]),
    "hip": (
        lambda: cc.CupFoundation(cc.load_scene("hip")),
        [[69.7, -65.1, -84.2, 0.0, 0.0, 0.0], [70.0, -66.1, -84.0, 0.0, 0.0, 0.0]],
    ),
    "cells": (
        lambda: cc.CellFoundation(cc.load_scene("sphere_on_plane")),
        [[0.0, 29.7, 0.0, 0.1, 0.0, 0.0], [0.0, 31.0, 0.0, 0.1, 0.0, 0.0]],
    ),
}


@pytest.mark.parametrize("name", PRESSED_AND_APART)
def test_root_loads_are_those_of_the_gaps_out_of_contact_and_of_the_loads_in_contact(name):
    made, poses = PRESSED_AND_APART[name]
    model, poses, steps = made(), np.array(poses), 1e-5 * np.eye(6)
    s, slopes = model.root_loads(poses)
    apart = (model.wrenches(poses) == 0.0).all(axis=2)
    assert apart.any()
    assert not apart.all()
    np.testing.assert_allclose(s[apart], -model.scene.gap_slope * model.gaps(poses)[apart], rtol=1e-12)
    assert (s[~apart] > 0.0).all()
    differences = [(model.root_loads(poses + step)[0] - model.root_loads(poses - step)[0]) / 2e-5 for step in steps]
    np.testing.assert_allclose(slopes, np.stack(differences, axis=-1), atol=1e-4 * np.abs(slopes).max())
