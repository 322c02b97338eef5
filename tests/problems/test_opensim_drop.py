"""The same drop by OpenSim and by CasADi, on one exported kernel."""

import csv
import json
import subprocess
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from casadi_contact.core.conventions import WRENCH_NAMES, rotation
from casadi_contact.optimisation.verification.verdict import judge
from casadi_contact.scenes.pose_space import PoseSpace
from problems.opensim_drop import by_casadi
from problems.opensim_drop import compare as comparing
from problems.opensim_drop.compare import Comparison, compare
from problems.opensim_drop.problem import Drop
from problems.opensim_drop.report import report
from tests.support.compiler import needs_compiler


@needs_compiler
@pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")
def test_opensim_and_casadi_agree(knee):
    drop = Drop(knee, duration_s=0.02, points=5)
    compared = compare(drop)
    assert np.ptp(compared.casadi[:, 1]) > 0.2
    assert (compared.difference[:3] < 1e-6).all()
    assert (compared.difference[3:] < 1e-8).all()


def test_a_braked_body_comes_to_rest_where_the_contact_carries_the_push(knee):
    drop = Drop(knee, push_n=(0.0, -300.0, 0.0), damping_ns_per_m=600.0, damping_nms_per_rad=5.0, duration_s=0.5)
    pose = by_casadi.simulate(drop)[-1]
    loads = dict(zip(knee.load_names, knee(pose), strict=True))
    assert loads["Fy_med"] + loads["Fy_lat"] == pytest.approx(-300.0, rel=1e-2)


def test_a_body_out_of_contact_falls_freely(knee):
    drop = Drop(knee, lift_mm=5.0, damping_ns_per_m=0.0, duration_s=0.002, points=3)
    fallen = drop.start_pose[1] - by_casadi.simulate(drop)[-1, 1]
    assert fallen == pytest.approx(1e3 * 400.0 / 1.0 * 0.002**2 / 2.0, rel=1e-6)


START = np.array([3.0, 27.0, -8.0, 0.5, -0.6, 0.7])


def pressed_steadily(wrench):
    """A surrogate whose wrench on the fixed body is the same in every pose."""
    function = ca.Function("steady", [ca.MX.sym("pose", 6)], [ca.DM(wrench)])
    return SimpleNamespace(
        scene=SimpleNamespace(pose_space=PoseSpace()),
        load_names=WRENCH_NAMES,
        patch_names=("all",),
        learned_pose=lambda: START,
        function=lambda **_: function,
    )


@pytest.mark.parametrize("point", [START[:3], np.array([40.0, 10.0, 25.0])], ids=["through its origin", "beside it"])
def test_a_steady_force_moves_and_turns_a_braked_body_as_formulas_say(point):
    """v = F/c·(1 - exp(-c·t/m)), and ω likewise about an axis that stays: the body moves along the force, so that the
    force keeps its lever."""
    force, lever = np.array([30.0, -80.0, 20.0]), point - START[:3]
    drop = Drop(
        pressed_steadily([*-force, *np.cross(point, -force)]),
        lift_mm=0.0,
        push_n=(0.0, 0.0, 0.0),
        mass_kg=2.0,
        inertia_kgm2=3e-3,
        damping_ns_per_m=40.0,
        damping_nms_per_rad=0.1,
        points=5,
    )

    def travel(inertia, damping):
        """Of a unit force, from rest."""
        slowed_s = inertia / damping
        return (drop.times_s - slowed_s * (1.0 - np.exp(-drop.times_s / slowed_s)))[:, None] / damping

    moved = 1e3 * travel(2.0, 40.0) * force
    turned = travel(3e-3, 0.1) * 1e-3 * np.cross(lever, force)
    poses = by_casadi.simulate(drop)
    np.testing.assert_allclose(poses[:, :3], START[:3] + moved, atol=1e-6)
    expected = Rotation.from_rotvec(turned).as_matrix() @ rotation(START[3:])
    np.testing.assert_allclose([rotation(angles) for angles in poses[:, 3:]], expected, atol=1e-7)
    assert moved[-1, 1] < -20.0
    assert not lever.any() or np.abs(turned[-1]).max() > 0.5


def test_files_and_terminal_say_the_verdict_and_why_a_frame_is_not_verified(knee, tmp_path, capsys):
    drop = Drop(knee, duration_s=0.01, points=3)
    poses = by_casadi.simulate(drop)
    verdict = judge(knee, poses, np.ones(3, dtype=bool), cc.foundation(cc.load_scene("knee", thickness=9.0)))
    report(drop, Comparison(poses, poses, "4.6"), verdict, tmp_path)
    said = capsys.readouterr().out
    assert said.startswith(str(verdict))
    rows = list(csv.DictReader((tmp_path / "opensim_drop.csv").open(encoding="utf-8")))
    assert [row["frame"] for row in rows] == ["0", "1", "2"]
    assert [row["verdict"] for row in rows] == verdict.words
    assert "differ" in rows[-1]["reason"]
    assert rows[-1]["reason"] in said
    assert json.loads((tmp_path / "opensim_drop.json").read_text("utf-8"))["verdict"] == str(verdict)


def test_a_simulation_that_opensim_does_not_end_in_time_says_what_to_do(knee, monkeypatch):
    def never_ends(command, *, timeout, **_):
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(comparing, "find_spec", lambda _: True)
    monkeypatch.setattr(comparing, "shared_library", lambda _: Path("library.so"))
    monkeypatch.setattr(comparing.subprocess, "run", never_ends)
    with pytest.raises(RuntimeError, match=r"OpenSim has not simulated 30 s in 600 s: shorten --duration-s"):
        compare(Drop(knee, duration_s=30.0))


def test_a_body_without_mass_or_a_place_to_fall_from_is_refused(knee):
    with pytest.raises(ValueError, match="expected positive numbers"):
        Drop(knee, mass_kg=0.0)
    with pytest.raises(ValueError, match="lift is nan mm"):
        Drop(knee, lift_mm=np.nan)
