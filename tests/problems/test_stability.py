"""Every row of the stability table, at a tiny scale: it measures what its name says."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.workflow.project import built_in_motion
from problems.studies import stability
from problems.studies.stability import ELEMENTS, FOUNDATION, Bench


@pytest.fixture(scope="module")
def bench():
    scene = cc.load_scene("knee")
    fine = ElasticFoundation(scene, scene.grids["coarse"])
    knee, paper = cc.load_surrogate("knee"), cc.load_surrogate("knee_two_stage")
    motion = built_in_motion(scene).poses.reshape(-1, 6)[::25]
    models = {"knee": knee, "knee_two_stage": paper, ELEMENTS: fine}
    return Bench(scene, models, ("knee", "knee_two_stage"), fine, motion)


@pytest.fixture(scope="module")
def hip():
    """A joint without a single direction of pressing."""
    scene = cc.load_scene("hip")
    coarse = ElasticFoundation(scene, scene.grids["coarse"])
    motion = built_in_motion(scene).poses.reshape(-1, 6)[::20]
    return Bench(scene, {FOUNDATION: cc.foundation(scene), ELEMENTS: coarse}, (), coarse, motion)


def only(bench, *chosen):
    return replace(bench, models={m: bench.models[m] for m in chosen})


@pytest.mark.parametrize(("joint", "method"), [("bench", "knee"), ("bench", ELEMENTS), ("hip", FOUNDATION)])
def test_methods_with_root_loads_settle_back_from_bad_starts(joint, method, request):
    bench = request.getfixturevalue(joint)
    lines = stability.starts(only(bench, method), 4, (2.0, -1.0))
    assert [line.cell(method).split(" / ")[0] for line in lines] == ["100", "100"]


def test_at_lift_off_the_patch_surrogate_bends_where_two_stages_have_a_kink(bench):
    knee, paper, pose = bench.models["knee"], bench.models["knee_two_stage"], bench.poses[0]
    height = stability.lift_off_height(knee, pose, 1)
    edge = stability.one_sided(knee, pose, height, "Fy_lat")
    slope = knee.root_loads((pose + height * np.eye(6)[1])[None])[1][0, 1, 1]
    bend = 2.0 * bench.scene.reference_load * slope**2  # d²/dty² of N0·s², where s = 0
    assert edge["N"][0] < 1e-3
    assert abs(edge["dN"][0]) < 1e-3 * bend
    assert edge["ddN"][0] == pytest.approx(bend, rel=0.02)
    assert edge["N"][1] == edge["dN"][1] == edge["ddN"][1] == 0.0
    kink = stability.one_sided(paper, pose, stability.lift_off_height(paper, pose, 1), "Fy_lat")
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
    assert stability.count_failures(Wrong(), apart, bench.truth) == (1, 1, 1)
    assert stability.count_failures(hip.models[FOUNDATION], hip.poses, hip.truth) == (0, 0, 0)


def test_the_command_writes_every_row(monkeypatch, tmp_path, bench):
    small = replace(only(bench, "knee"), surrogates=("knee",), poses=bench.poses[:3])
    monkeypatch.setattr(stability.Bench, "of", lambda scene, surrogates: small)
    stability.run("knee", None, tmp_path, quick=True)
    written = (tmp_path / "stability.json").read_text("utf-8")
    assert all(words in written for words in ("too deep", "in contact", "all at random"))
