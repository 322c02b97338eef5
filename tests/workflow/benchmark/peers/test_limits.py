"""Peers never pull, whichever way a scene presses."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.workflow.benchmark.peers.training_set import Limits

LOADS = [[-7.0, 7.0], [7.0, -7.0]]


@pytest.mark.parametrize(
    ("scene", "names", "held"),
    [
        ("knee", ("Fy_med", "Tx"), [[-7.0, 7.0], [0.0, -7.0]]),  # presses downwards
        ("patellofemoral", ("Fx_lat", "Tz"), [[0.0, 7.0], [7.0, -7.0]]),  # presses forwards
        ("hip", ("Fx", "Fy"), LOADS),  # presses anywhere
    ],
)
def test_a_load_that_would_pull_is_clamped_to_zero(scene, names, held):
    limits = Limits.of(cc.load_scene(scene), names)
    loads = np.array(LOADS)
    np.testing.assert_array_equal(limits.beyond(loads), loads != held)
    assert limits.remark == ("" if held == LOADS else ", pulling forces clamped to zero")
    assert limits.hold(loads) is loads
    np.testing.assert_array_equal(loads, held)
