"""Stability of scenes other than the knee: the rows that they have, on a hip."""

import sys

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.workflow.project import built_in_motion
from problems.studies.stability import __main__, methods, out_of_range, settling_starts
from problems.studies.stability.methods import EF_ANALYTIC, FOUNDATION
from problems.studies.stability.normals import normal_of
from problems.studies.stability.peers import PeerModel


@pytest.fixture(scope="module")
def hip():
    """A joint without a single direction of pressing, without networks."""
    scene = cc.load_scene("hip")
    fine = ElasticFoundation(scene, scene.grids["coarse"])
    poses = built_in_motion(scene).poses.reshape(-1, 6)[::20]
    return methods.Bench({FOUNDATION: cc.foundation(scene), EF_ANALYTIC: fine}, {}, scene, fine, poses)


def test_other_joints_settle_back_from_starts_that_are_lifted_off_or_pressed_in(hip):
    model = hip.models[EF_ANALYTIC]
    out, into = (settling_starts.lifted(model, hip.poses, lift, np.random.default_rng(0)) for lift in (5.0, -5.0))
    assert (model.gaps(out) - model.gaps(into) > 2.0).all()
    lines, row = settling_starts.measure(hip, 6, (2.0, -1.0))
    assert row["shares"][FOUNDATION] == [1.0, 1.0]
    solved = {line.quantity: line.values[FOUNDATION] for line in lines if line.case == "moved 2 mm out"}
    assert solved["of 6 solved [%]"] == 100.0


def test_contact_without_a_direction_cannot_pull(hip):
    loads = np.array([[3.0, 4.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 6])
    np.testing.assert_allclose(normal_of(hip.models[FOUNDATION], loads), [[5.0], [0.0]])
    counted = out_of_range.count_failures(hip.models[FOUNDATION], hip.poses, hip.models[EF_ANALYTIC])
    assert counted == (0, 0, 0, None)


def test_a_peer_s_root_load_is_that_of_its_force_s_size(hip):
    model = hip.models[FOUNDATION]

    class Linear:
        def __call__(self, poses):
            return 1e3 * poses

        def jacobian_one(self, pose):
            return 1e3 * np.eye(6)

    peer = PeerModel(Linear(), model.scene)
    poses = np.array([[0.3, 0.0, -0.4, 0.0, 0.1, 0.0]])
    roots, slopes = peer.root_loads(poses)
    assert hip.scene.reference_load * roots[0, 0] ** 2 == pytest.approx(500.0)
    ahead = peer.root_loads(poses + 1e-6 * np.eye(6)[0])[0]
    assert slopes[0, 0, 0] == pytest.approx((ahead - roots)[0, 0] / 1e-6, rel=1e-4)


def test_only_rows_that_another_scene_has_are_measured(monkeypatch, tmp_path):
    arguments = ["hip", "--rows", "6", "--folder", str(tmp_path / "hip"), "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", ["stability", *arguments])
    with pytest.raises(SystemExit, match="rows is '6', expected some of 1, 3, 4, 9 separated by commas"):
        __main__.main()
