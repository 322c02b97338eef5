"""The command of pose estimation: what it writes, a verdict first of all, one line for a mistake."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.load_cycle import write_cycle
from casadi_contact.scenes.opensim.table import read_opensim_table
from casadi_contact.scenes.walking import reference_cycle
from problems import pose_estimation
from problems.pose_estimation import __main__
from problems.pose_estimation.on_foundation import OnFoundation
from problems.pose_estimation.starts import start_from_file
from tests.support.command import ended, ran


def check_pressures(rows, table):
    """Mean pressure over the area is nearly the vertical force; the .sto has the CSV's numbers in OpenSim's units."""
    for side in ("med", "lat"):
        area, mean, peak, depth = (
            np.array([float(row[f"{name}_{side}_{unit}"]) for row in rows])
            for name, unit in (
                ("contact_area", "mm2"),
                ("mean_pressure", "MPa"),
                ("peak_pressure", "MPa"),
                ("penetration", "mm"),
            )
        )
        force = np.array([-float(row[f"Fy_{side}_ef_N"]) for row in rows])
        loaded = force > 50.0
        assert loaded.sum() > 50
        np.testing.assert_allclose((area * mean)[loaded], force[loaded], rtol=0.03)
        assert ((peak > 1.5 * mean) & (peak < 2.5 * mean) & (depth > 0.0))[loaded].all()
        np.testing.assert_allclose(table.column(f"peak_pressure_{side}"), 1e6 * peak, rtol=1e-6)
        np.testing.assert_allclose(table.column(f"contact_area_{side}"), 1e-6 * area, rtol=1e-6)


def test_the_command_writes_files_and_its_poses_serve_as_a_start(tmp_path):
    done = ran("problems.pose_estimation", "--out", tmp_path / "results")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("101 of 101 solved and verified on EF 320×160\n")
    assert "101 of 101 frames converged" in done.stdout
    rows = list(csv.DictReader((tmp_path / "results" / "pose_estimation.csv").open()))
    assert len(rows) == 101
    assert abs(float(rows[30]["Fy_med_got_N"]) - float(rows[30]["Fy_med_wanted_N"])) < 1.0
    check_pressures(rows, read_opensim_table(tmp_path / "results" / "pressures.sto"))
    summary = json.loads((tmp_path / "results" / "summary.json").read_text())
    assert summary["converged"] == 101
    assert summary["machine"]["casadi"]
    assert (tmp_path / "results" / "pose_estimation.png").read_bytes().startswith(b"\x89PNG")
    start = start_from_file(tmp_path / "results" / "poses.sto", 101)
    again = pose_estimation.solve(pose_estimation.build(cc.load_surrogate("knee"), reference_cycle()), start)
    assert again.iterations <= 12, "it begins at the solution"


def test_a_solution_that_the_contact_model_denies_is_called_so_first_of_all(tmp_path, monkeypatch, capsys):
    """A surrogate whose medial force is 4 % off: IPOPT solves every frame, and none of the loaded ones is right."""
    knee = cc.load_surrogate("knee")
    networks = dict(knee.networks)
    name = next(name for name in networks if "root" in name and "med" in name)
    networks[name] = replace(networks[name], output_scale=1.02 * networks[name].output_scale)
    type(knee)(knee.scene, networks, knee.record, knee.trust).save(tmp_path / "wrong.h5")
    write_cycle(reference_cycle(frames=11), tmp_path / "walk.csv")
    arguments = ("--surrogate", tmp_path / "wrong.h5", "--cycle", tmp_path / "walk.csv", "--out", tmp_path)
    assert ended(monkeypatch, __main__.main, *arguments) == 3
    said = capsys.readouterr()
    assert "solved but differ, at most by" in said.out.splitlines()[0]
    assert "pose_estimation: solved, but the contact model differs: frames 0 to " in said.err
    rows = list(csv.DictReader((tmp_path / "pose_estimation.csv").open(encoding="utf-8")))
    assert rows[0]["verdict"].startswith("solved, differs by ")
    assert rows[0]["converged"] == "1"
    summary = json.loads((tmp_path / "summary.json").read_text("utf-8"))
    assert next(iter(summary)) == "verdict"
    assert summary["verified"] < summary["converged"] == 11


def test_what_is_written_is_of_these_poses_even_if_their_random_starts_are_interrupted(tmp_path, monkeypatch):
    """Pressures of an earlier cycle do not stay beside poses of a later one, on a model without elements."""
    write_cycle(reference_cycle(frames=11), tmp_path / "walk.csv")
    arguments = ("--cycle", tmp_path / "walk.csv", "--out", tmp_path)
    assert ended(monkeypatch, __main__.main, *arguments) == 0
    assert (tmp_path / "pressures.sto").exists()
    monkeypatch.setattr(OnFoundation, "of", lambda *_: None)

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(__main__, "solve_from_random_starts", interrupted)
    (tmp_path / "summary.json").unlink()
    assert ended(monkeypatch, __main__.main, *arguments, "--starts", 5) == 130
    assert json.loads((tmp_path / "summary.json").read_text("utf-8"))["converged"] == 11
    assert not (tmp_path / "pressures.sto").exists()


def test_frames_that_are_not_solved_are_called_so_first_of_all(tmp_path, monkeypatch, capsys):
    cycle = reference_cycle(frames=11)
    outside = cycle.cop_ml_mm.copy()
    outside[4] = 60.0  # outside the insert
    write_cycle(replace(cycle, cop_ml_mm=outside), tmp_path / "walk.csv")
    assert ended(monkeypatch, __main__.main, "--cycle", tmp_path / "walk.csv", "--out", tmp_path) == 2
    said = capsys.readouterr()
    assert said.out.splitlines()[0] == "10 of 11 solved and verified on EF 320×160; 1 not solved"
    assert "pose_estimation: not solved: frames 4; see" in said.err
    said_of_it = r"frame 4: infeasible: [\d.]+ mm beyond any centre of pressure that contact can have"
    assert re.search(said_of_it, " ".join(said.out.split()))


def test_a_verified_frame_that_presses_too_lightly_to_place_its_centre_of_pressure_is_told(
    tmp_path, monkeypatch, capsys
):
    """An error of half a newton at the condyles' 22 mm is nothing in walking, and millimetres under a few newtons."""
    cycle = reference_cycle(frames=11)
    share = np.where(np.arange(11) == 2, 0.01, 1.0)
    write_cycle(replace(cycle, fy_med=share * cycle.fy_med, fy_lat=share * cycle.fy_lat), tmp_path / "walk.csv")
    assert ended(monkeypatch, __main__.main, "--cycle", tmp_path / "walk.csv", "--out", tmp_path) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(r"so light a load that on the EF .* lies up to [\d.]+ mm from the wanted one: frames 2 ", said)


def test_one_frame_without_load_leaves_a_cycle_its_errors(tmp_path, monkeypatch, capsys):
    """It has no centre of pressure: all others have, and a JSON file has no NaN."""
    cycle = reference_cycle(frames=11)
    pressed = np.arange(11) != 4
    write_cycle(replace(cycle, fy_med=pressed * cycle.fy_med, fy_lat=pressed * cycle.fy_lat), tmp_path / "walk.csv")
    assert ended(monkeypatch, __main__.main, "--cycle", tmp_path / "walk.csv", "--out", tmp_path) == 0
    assert "frame 4: no load: any pose out of contact carries it" in " ".join(capsys.readouterr().out.split())
    text = (tmp_path / "summary.json").read_text("utf-8")
    assert "NaN" not in text
    assert json.loads(text)["without_load"] == 1
    errors = json.loads(text)["errors"]
    assert errors["cop_ap"]["tracking"]["values"] == 10
    assert errors["cop_ap"]["tracking"]["rms"] < 0.1
    assert "values" not in errors["Fy_med"]["tracking"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--surrogate", "hip"), "unknown surrogate 'hip'"),
        (("--cycle", "none.csv"), "cycle file none.csv does not exist"),
        (("--start", "none.csv"), "pose file none.csv does not exist"),
        (("--start", "none.csv", "--warm", "knee"), "got both --start and --warm"),
        (("--scene", "hip", "--warm", "knee"), "--warm knee is of scene knee with patches med, lat, expected a surr"),
        (("--out", "/proc/nowhere"), "cannot write in folder /proc/nowhere"),
    ],
)
def test_a_mistake_is_one_line_and_a_nonzero_exit(arguments, said, tmp_path):
    done = ran("problems.pose_estimation", *arguments)
    assert done.returncode != 0
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "Traceback" not in done.stderr
