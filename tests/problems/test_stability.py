"""Every row of the stability table, at a tiny scale: it measures what its name says."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import pose_index
from casadi_contact.workflow.project import built_in_motion
from problems.studies.stability import __main__ as command
from problems.studies.stability import methods, poses
from problems.studies.stability.methods import EF_ANALYTIC, FOUNDATION, Bench, PeerModel


@pytest.fixture(scope="module")
def bench():
    scene = cc.load_scene("knee")
    fine = ElasticFoundation(scene, scene.grids["coarse"])
    knee, paper = cc.load_surrogate("knee"), cc.load_surrogate("knee_two_stage")
    motion = built_in_motion(scene).poses.reshape(-1, 6)[::25]
    models = {"knee": knee, "knee_two_stage": paper, EF_ANALYTIC: fine}
    return Bench(scene, models, ("knee", "knee_two_stage"), fine, motion)


@pytest.fixture(scope="module")
def hip():
    """A joint without a single direction of pressing."""
    scene = cc.load_scene("hip")
    coarse = ElasticFoundation(scene, scene.grids["coarse"])
    motion = built_in_motion(scene).poses.reshape(-1, 6)[::20]
    return Bench(scene, {FOUNDATION: cc.foundation(scene), EF_ANALYTIC: coarse}, (), coarse, motion)


def only(bench, *chosen):
    return replace(bench, models={m: bench.models[m] for m in chosen})


@pytest.mark.parametrize(("joint", "method"), [("bench", "knee"), ("bench", EF_ANALYTIC), ("hip", FOUNDATION)])
def test_methods_with_root_loads_settle_back_from_bad_starts(joint, method, request):
    bench = request.getfixturevalue(joint)
    lines = poses.starts(only(bench, method), 4, (2.0, -1.0))
    assert [line.cell(method).split(" / ")[0] for line in lines] == ["100", "100"]


def test_at_lift_off_the_patch_surrogate_bends_where_two_stages_have_a_kink(bench):
    knee, paper, pose = bench.models["knee"], bench.models["knee_two_stage"], bench.poses[0]
    height = poses.lift_off_height(knee, pose, 1)
    edge = poses.one_sided(knee, pose, height, "Fy_lat")
    slope = knee.root_loads((pose + height * np.eye(6)[1])[None])[1][0, 1, 1]
    bend = 2.0 * bench.scene.reference_load * slope**2  # d²/dty² of N0·s², where s = 0
    assert edge["N"][0] < 1e-3
    assert abs(edge["dN"][0]) < 1e-3 * bend
    assert edge["ddN"][0] == pytest.approx(bend, rel=0.02)
    assert edge["N"][1] == edge["dN"][1] == edge["ddN"][1] == 0.0
    kink = poses.one_sided(paper, pose, poses.lift_off_height(paper, pose, 1), "Fy_lat")
    assert kink["dN"][0] < -100.0, "N/mm, from one side to the other"
    assert kink["dN"][1] == 0.0


def test_failures_out_of_range_are_counted(bench, hip):
    class Wrong:
        scene, load_names = bench.scene, bench.scene.load_names

        def __call__(self, poses):
            loads = np.zeros((len(poses), len(self.load_names)))
            loads[0, 0], loads[1, 1], loads[2, 4] = -1.0, 1.0, np.nan
            return loads

    apart = np.tile(bench.poses[0] + 10.0 * np.eye(6)[1], (4, 1))
    assert poses.count_failures(Wrong(), apart, bench.truth) == (1, 1, 1)
    assert poses.count_failures(hip.models[FOUNDATION], hip.poses, hip.truth) == (0, 0, 0)


def test_a_peer_s_root_load_is_that_of_its_force_s_size(hip):
    peer = PeerModel(lambda poses: 1e3 * poses, hip.scene)
    at = np.array([[0.3, 0.0, -0.4, 0.0, 0.1, 0.0]])
    roots, slopes = peer.root_loads(at)
    assert hip.scene.reference_load * roots[0, 0] ** 2 == pytest.approx(500.0)
    ahead = peer.root_loads(at + 1e-6 * np.eye(6)[pose_index("tx")])[0]
    assert slopes[0, 0, 0] == pytest.approx((ahead - roots)[0, 0] / 1e-6, rel=1e-4)


def test_the_command_measures_the_rows_that_it_is_told_to(monkeypatch, tmp_path, bench, capsys):
    monkeypatch.setattr(methods.Bench, "of", lambda scene, surrogates: only(bench, "knee"))
    command.run("knee", None, tmp_path, "1", quick=True)
    assert "starts" in capsys.readouterr().err
    assert "too deep" in (tmp_path / "stability.json").read_text("utf-8")
    with pytest.raises(ValueError, match="rows"):
        command.run("knee", None, tmp_path, "1,x")
