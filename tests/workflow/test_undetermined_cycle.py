"""A cycle file that measures too little to tell the pose is asked about before samples are drawn around it."""

import logging

import numpy as np
import pytest

from casadi_contact.workflow import samples as drawn_samples
from casadi_contact.workflow.project import Project

COLUMNS = {"rx_rad": 0.0, "ry_rad": 0.0, "rz_rad": -0.2, "Fx_N": -100.0, "Fy_N": 1200.0, "Fz_N": 300.0}


@pytest.mark.parametrize(
    ("lost", "said"),
    [(None, ""), ("rx_rad", "cycle own: 3 loads (Fx, Fy, Fz) cannot tell 4 pose parameters (tx, ty, tz, rx)")],
)
def test_pose_parameters_that_nothing_tells_are_named(lost, said, tmp_path, monkeypatch, caplog):
    curves = {name: value * np.array([1.0, 1.1, 1.2]) for name, value in COLUMNS.items() if name != lost}
    table = np.column_stack([[0.0, 0.5, 1.0], *curves.values()])
    np.savetxt(tmp_path / "own.csv", table, delimiter=",", header=",".join(["time_s", *curves]), comments="")

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(drawn_samples, "reference_motion", stop)
    with caplog.at_level(logging.WARNING), pytest.raises(KeyboardInterrupt):
        drawn_samples.sample(Project.open("hip", "quick", tmp_path / "out"), [tmp_path / "own.csv"])
    assert [record.getMessage().partition(": samples")[0] for record in caplog.records] == ([said] if said else [])
