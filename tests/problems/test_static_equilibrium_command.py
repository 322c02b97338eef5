"""The command of static equilibrium: what it writes, its exit status, one line for a mistake."""

import csv
import json

import casadi as ca
import numpy as np
import pytest

from casadi_contact.core.conventions import POSE_NAMES, angular_velocity_map
from problems.static_equilibrium import __main__
from tests.support.command import ended
from tests.support.compiler import needs_compiler


def test_the_command_writes_table_csv_summary_and_picture(tmp_path, monkeypatch, capsys):
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--starts", 1, "--flexions", "10,40") == 0
    assert "2 of 2 in equilibrium" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "static_equilibrium.csv").open(encoding="utf-8")))
    assert [round(float(row["Fy_contact_N"])) for row in rows] == [-1500, -1500]
    # Along what is free the contact carries the wanted torques, about the same origin; rz is held.
    for row in rows:
        left = [float(row[f"T{axis}_contact_Nmm"]) - float(row[f"T{axis}_wanted_Nmm"]) for axis in "xyz"]
        turned = angular_velocity_map(np.array([float(row[f"{name}_rad"]) for name in POSE_NAMES[3:]])).T @ left
        np.testing.assert_allclose(turned[:2], 0.0, atol=1.0)
        assert abs(float(row["Tx_ef_Nmm"]) - float(row["Tx_contact_Nmm"])) < 100.0
    summary = json.loads((tmp_path / "static_equilibrium.json").read_text("utf-8"))
    assert summary["random_starts"]
    assert summary["converged"] == 2
    assert set(summary["ef_rows_with_equilibrium"].values()) == {2}
    assert all(off["ty"] > 0.0 for off in summary["ef_pose_off_max"].values())
    assert (tmp_path / "static_equilibrium.png").read_bytes().startswith(b"\x89PNG")


@needs_compiler
def test_a_patella_under_a_knee_s_loads_ends_without_a_search(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(ca, "nlpsol", lambda *_: pytest.fail("asked IPOPT for what contact never carries"))
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--scene", "patellofemoral", "--flexions", "10,40") == 2
    assert "scene patellofemoral is pressed along +Fx alone" in capsys.readouterr().out


def test_loads_without_equilibrium_end_with_status_2(tmp_path, monkeypatch, capsys):
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--starts", 0, "--flexions", "20", "--fy", "300") == 2
    assert "static_equilibrium: not solved: rows 0" in capsys.readouterr().err
    summary = json.loads((tmp_path / "static_equilibrium.json").read_text("utf-8"))
    # No equilibrium of the elements is no agreement with them, which would be 0.
    assert set(summary["ef_rows_with_equilibrium"].values()) == {0}
    for off in summary["ef_pose_off_max"].values():
        assert off == dict.fromkeys(POSE_NAMES)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--flexions", "ten"), "--flexions is 'ten', expected finite numbers"),
        (("--flexions", "10,nan"), "--flexions is '10,nan', expected finite numbers"),
        (("--surrogate", "hip"), "unknown surrogate 'hip'"),
        (("--out", "/proc/nowhere"), "cannot write in folder /proc/nowhere"),
    ],
)
def test_a_mistake_is_one_line(arguments, said, tmp_path, monkeypatch):
    code = ended(monkeypatch, __main__.main, "--out", tmp_path, *arguments)
    assert code.startswith("static_equilibrium: ")
    assert said in code
    assert "\n" not in code
