"""The programs on the library's problems: what they print, write and return."""

import csv
import json

import pytest

from casadi_contact.scenes.cycle import write_cycle
from casadi_contact.scenes.walking import reference_cycle
from problems import muscle_contact, pose_estimation, static_equilibrium
from problems.walks import example_walk
from tests.support.muscle_files import write_walk


@pytest.fixture
def run(tmp_path, capsys):
    """A program's exit status, output and rows of its CSV file."""

    def run_in_folder(program, **options):
        with pytest.raises(SystemExit) as end:
            program.main(out=tmp_path / "results", **options)
        (table,) = (tmp_path / "results").glob("*.csv")
        assert table.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
        return end.value.code, capsys.readouterr().out, list(csv.DictReader(table.open(encoding="utf-8")))

    return run_in_folder


def test_pose_estimation_of_the_default_cycle(run, tmp_path):
    status, said, rows = run(pose_estimation)
    assert status == 0
    assert said.startswith("101 of 101 solved and verified")
    assert {row["outcome"] for row in rows} == {"solved"}
    assert float(rows[17]["Fy_med_target_N"]) == pytest.approx(float(rows[17]["Fy_med_found_N"]), abs=1e-6)
    summary = json.loads((tmp_path / "results/summary.json").read_text("utf-8"))
    assert summary["solved"] == 101
    assert summary["ipopt_iterations"] <= 4


def test_pose_estimation_reads_a_cycle_and_reports_a_frame_that_no_pose_carries(run, tmp_path):
    cycle = reference_cycle(frames=7)
    cycle.centres["cop_ml"][3] = 60.0
    for force in cycle.loads.values():
        force[5] = 0.0
    write_cycle(cycle, tmp_path / "walk.csv")
    status, said, rows = run(pose_estimation, cycle=tmp_path / "walk.csv")
    assert status == 3
    assert "5 of 6 solved" in said
    assert rows[5]["outcome"] == rows[5]["verdict"] == "no load"
    assert [row["outcome"] for row in rows].index("not solved") == 3


def test_static_equilibrium_at_two_flexions(run):
    status, said, rows = run(static_equilibrium, flexions="0,45")
    assert status == 0
    assert "2 of 2 in equilibrium" in said
    assert float(rows[1]["Fy_contact_N"]) == pytest.approx(-1500.0, abs=0.2)


def test_muscle_contact_of_a_walk_in_files_is_compared_with_measured_forces(run, tmp_path):
    write_cycle(reference_cycle(frames=21), tmp_path / "measured.csv")
    files = write_walk(tmp_path, example_walk(frames=21))
    status, said, rows = run(muscle_contact, **files, measured=tmp_path / "measured.csv")
    assert status == 0
    assert "predicted - measured" in said
    assert len(rows) == 21


def test_half_of_the_files_of_a_walk_are_refused(tmp_path):
    with pytest.raises(ValueError, match="all four"):
        muscle_contact.main(muscles=tmp_path / "muscles.csv")
