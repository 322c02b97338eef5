"""What a convergence test records of a model, and what decides its choice: poses at the rim stand by themselves."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.convergence import Errors
from casadi_contact.scenes.tolerance import Tolerance


def errors(of_tolerance, at_rim, forces_n=100.0):
    """Errors of the load Fy in n poses, in tolerances; all other loads are exact."""
    scene = cc.load_scene("sphere_on_plane")
    loads = np.zeros((len(of_tolerance), len(scene.load_names)))
    loads[:, scene.load_names.index("Fy")] = scene.tolerances["Fy"] * np.array(of_tolerance)
    return Errors(scene, loads, np.full(len(loads), forces_n), np.array(at_rim))


def test_poses_at_the_rim_decide_nothing_and_the_record_says_which_share_exceeds():
    found = errors([0.5, 0.1, 0.3, 0.5, 9.0, 0.2, 5.0, 1.0], [False] * 4 + [True] * 4)
    assert found.ratio == pytest.approx(np.sqrt((0.5**2 + 0.1**2 + 0.3**2 + 0.5**2) / 4.0))
    assert found.ratio_at_rim == pytest.approx(np.sqrt((81.0 + 0.04 + 25.0 + 1.0) / 4.0))
    record, tolerance = found.record(model="cells"), found.scene.tolerances["Fy"]
    assert record["model"] == "cells"
    assert record["poses"] == 8
    assert record["exceeding_at_rim"] == 0.5
    assert record["largest"]["Fy"] == pytest.approx(0.5 * tolerance)
    assert record["largest_at_rim"]["Fy"] == pytest.approx(9.0 * tolerance)
    assert record["rms_at_rim"]["Fy"] == pytest.approx(tolerance * np.sqrt((81.0 + 0.04 + 25.0 + 1.0) / 4.0))


def test_a_single_error_may_be_larger_where_the_force_is():
    reference = cc.load_scene("sphere_on_plane").reference_load
    light, heavy = (errors([Tolerance.single, *[0.0] * 15], [False] * 16, n * reference) for n in (1.0, 2.0))
    assert light.ratio == pytest.approx(1.0)
    assert heavy.ratio == pytest.approx(Tolerance.single / 4.0)  # the RMS of sixteen
