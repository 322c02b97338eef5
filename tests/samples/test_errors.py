"""Errors of loads are what their names say, per load, domain and kind of quantity."""

import math

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.samples import TEST, TRAIN, Samples, domain_errors, load_errors, rms_by_kind


def test_errors_of_hand_worked_loads():
    errors = load_errors(("Fx", "Tx"), np.array([[1.0, 0.0], [4.0, 0.0]]), np.array([[0.0, 0.0], [0.0, -2.0]]))
    assert errors["Fx"] == {"rms": pytest.approx(np.sqrt(8.5)), "max": 4.0, "mean": 2.5}
    assert errors["Tx"]["max"] == 2.0
    with pytest.raises(ValueError, match=r"expected \(n, 2\) twice"):
        load_errors(("Fx", "Tx"), np.zeros((2, 2)), np.zeros((3, 2)))


def test_domain_errors_use_only_the_wanted_role_and_domain():
    scene = cc.load_scene("sphere_on_plane")
    model = cc.ElasticFoundation(scene, (40, 40))
    poses = np.zeros((4, 6))
    poses[:, 1] = [29.9, 29.8, 29.9, 29.8]
    wrenches = model.wrenches(poses)
    wrenches[3, 0, 1] += 7.0  # a wrong load in the one test sample of D3
    role = np.array([TRAIN, TRAIN, TEST, TEST], dtype=np.uint8)
    domain = np.array([1, 3, 1, 3], dtype=np.uint8)
    errors = domain_errors(model, Samples(scene, poses, wrenches, model.gaps(poses), domain, role))
    assert set(errors) == {"D1", "D3"}
    assert errors["D1"]["Fy"]["max"] == 0.0
    assert errors["D3"]["Fy"]["max"] == pytest.approx(7.0)


def test_the_rms_of_a_kind_pools_squares_over_all_its_loads():
    """As if all forces stood in one column, however much they differ in size."""
    names = ("Fy_med", "Tx", "Fz", "Tz")
    off = np.random.default_rng(7).normal(size=(50, 4)) * (1.0, 40.0, 10.0, 900.0)
    rms = rms_by_kind(load_errors(names, off, np.zeros_like(off)))
    assert rms["force"] == pytest.approx(math.sqrt(np.mean(off[:, [0, 2]] ** 2)))
    assert rms["torque"] == pytest.approx(math.sqrt(np.mean(off[:, [1, 3]] ** 2)))
