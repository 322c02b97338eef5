"""A new structure is one class (`tests/surrogate/direct`) and one line in the registry: its file and functions work."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.surrogate.load import STRUCTURES
from tests.support.agreement import agree, evaluated
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import random_poses, random_surrogate
from tests.surrogate.direct.surrogate import DirectSurrogate


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_compiler)], ids=["graph", "kernel"])
def test_its_functions_and_their_derivatives_are_those_of_its_networks(compiled, tmp_path, monkeypatch):
    monkeypatch.setitem(STRUCTURES, "direct", DirectSurrogate)
    random_surrogate(cc.load_scene("knee"), "direct", seed=3).save(tmp_path / "direct.h5")
    surrogate, poses, pose = cc.load_surrogate(tmp_path / "direct.h5"), random_poses(19), ca.MX.sym("pose", 6)
    function = surrogate.load_and_root_function(compiled=compiled)
    assert (function.class_name() == "External") is compiled
    agree(surrogate.function(compiled=compiled, batch=19)(poses.T).full().T, surrogate(poses))
    stacked = ca.Function("stacked", [pose], [ca.vertcat(*function(pose))])
    wanted = [np.hstack(pair) for pair in zip(surrogate.jacobian(poses), surrogate.root_loads(poses), strict=True)]
    weights, step = np.random.default_rng(0).normal(size=wanted[0].shape), 1e-5

    def gradient(x):
        slopes = np.hstack([surrogate.jacobian(x)[1], surrogate.root_loads(x)[1]])
        return np.einsum("nm,nmj->nj", weights, slopes)

    moves = step * np.eye(6)
    bends = np.stack([gradient(poses + move) - gradient(poses - move) for move in moves], axis=1) / (2.0 * step)
    values, slopes, hessians = evaluated(stacked, poses, weights)
    agree(values, wanted[0])
    agree(slopes, wanted[1], 1)
    np.testing.assert_allclose(hessians[:, 0], bends, atol=1e-5 * np.abs(bends).max())
    assert np.isnan(stacked(np.where(np.arange(6) == 2, np.inf, poses[0])).full()).all()
