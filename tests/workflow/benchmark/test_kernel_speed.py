"""What is measured, and that the table shows it; never how fast."""

import json

import casadi as ca
import numpy as np
import pytest

from casadi_contact.cli.tables import kernel_speed_tables, read_result
from casadi_contact.scenes.loading import load_scene
from casadi_contact.workflow.benchmark import kernel_speed as speed
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import random_poses, random_surrogate


@needs_compiler
def test_each_form_is_timed_as_what_it_is_called(monkeypatch):
    surrogate = random_surrogate(load_scene("sphere_on_plane"), "patch")
    forms = {False: surrogate.function(compiled=False), True: surrogate.function(compiled=True)}
    monkeypatch.setattr(type(surrogate), "function", lambda _, *, compiled, batch=None: forms[compiled])
    monkeypatch.setattr(speed, "compare", lambda measurements, repeats: measurements)
    timed = speed.kernel_speed(surrogate, random_poses(5), repeats=1)
    assert {"call alone", "value, kernel, batch of 1000", "EF 80×40"} <= set(timed)
    for name, compiled in (("graph", False), ("kernel", True)):
        assert timed[f"value, {name}"].args[0].is_a("External") == compiled
        for what in ("Jacobian", "Hessian"):
            calls = timed[f"{what}, {name}"].args[0].find_functions()
            assert any(inner.is_a("External") for inner in calls) == compiled, f"{what}, {name}"


@needs_compiler
def test_the_call_alone_reads_a_pose_and_computes_nothing():
    alone = speed.copy_of_one_number()
    assert alone.is_a("External")
    pose = np.arange(1.0, 7.0)
    assert float(alone(pose)) == 1.0


def test_what_is_timed_as_jacobian_and_hessian_is_that():
    """Of loads (sin tx + ty·tz, rx²) with weights 2 and 3."""
    pose = ca.MX.sym("pose", 6)
    loads = ca.Function("loads", [pose], [ca.vertcat(ca.sin(pose[0]) + pose[1] * pose[2], pose[3] ** 2)])
    at = np.array([0.4, 2.0, 3.0, 5.0, 0.0, 0.0])
    slopes = np.zeros((2, 6))
    slopes[0, :3], slopes[1, 3] = (np.cos(0.4), 3.0, 2.0), 10.0
    np.testing.assert_allclose(speed.jacobian_of(loads)(at), slopes)
    bends = np.zeros((6, 6))
    bends[0, 0], bends[1, 2], bends[2, 1], bends[3, 3] = -2.0 * np.sin(0.4), 2.0, 2.0, 6.0
    np.testing.assert_allclose(speed.lagrangian_hessian(loads)(at, [2.0, 3.0]), bends)


def test_the_table_is_drawn_from_the_file_alone(tmp_path):
    timing = {"median_us": 2.0, "low_us": 1.0, "high_us": 3.0}
    times = {"value, graph": {**timing, "median_us": 9.0}, "value, kernel": timing, "EF 40×30": timing}
    path = tmp_path / "kernel_speed.json"
    path.write_text(
        json.dumps({"format": "casadi_contact kernel speed", "surrogates": {"patch": {"microseconds": times}}})
    )
    (table,) = kernel_speed_tables(read_result(path, "kernel speed"))
    cells = [list(column.cells) for column in table.columns]
    assert cells[0] == list(times)
    assert cells[3] == ["4.50", "1.00", "1.00"]
    path.write_text("{}")
    with pytest.raises(ValueError, match="not a file of kernel speed"):
        read_result(path, "kernel speed")
