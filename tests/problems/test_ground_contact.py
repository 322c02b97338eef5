"""A foot on the ground: a step that the model made itself is fitted, and measured ones are read."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.core.quantities import quantity
from casadi_contact.scenes.columns import write_columns
from problems import ground_contact
from problems.ground_contact import PARAMETERS, Step, fit, ground_wrench, misfits, pressure_centre, read_step
from tests.support.compiler import needs_compiler
from tests.support.made_up_step import made_up
from tests.support.shared_data import shared_file

pytestmark = needs_compiler
STEPS = "data/jam_knee/steps"


@pytest.fixture(scope="module")
def foot():
    return cc.CellFoundation(cc.load_scene("foot_on_ground"), Cells(14.0, 12.0, 4, 4))


def test_the_wrench_on_the_foot_presses_it_up_and_drags_it_back_where_it_slides_forwards(foot):
    step, truth = made_up(foot)
    x, z, _ = pressure_centre(step.wrench).T
    assert (step.wrench[:, 1] > 100.0).all()
    assert x[0] < 60.0 < x[-1]
    assert (np.abs(z) < 60.0).all()
    sliding = np.asarray(ground_wrench(foot)(step.poses[4], [200.0, 0.0, 0.0, 0.0, 0.0, 0.0], truth))[:, 0]
    assert sliding[0] == pytest.approx(-0.6 * sliding[1], rel=0.15)  # the sole is not flat: some normals lean


def test_a_made_up_step_with_wrong_markers_is_fitted_and_its_sole_fits_another(foot):
    step, truth = made_up(foot)
    rng = np.random.default_rng(0)
    errors = rng.normal(size=6) * np.repeat([1.5, 0.01], 3) + rng.normal(size=step.poses.shape) * np.repeat(
        [0.2, 1e-3], 3
    )
    wrong = Step(step.time_s, step.poses + errors, step.wrench)
    found = fit(foot, wrong)
    off = misfits(wrong, found)
    assert off["vertical_N"] < 15.0
    assert off["fore_aft_N"] < 10.0
    assert off["cop_mm"] < 5.0
    assert off["moved_mm"] < 5.0
    again = misfits(step, fit(foot, step, known=dict(zip(PARAMETERS, truth, strict=True))))
    assert again["moved_mm"] < 0.5
    assert again["vertical_N"] < 15.0


def test_a_left_step_is_mirrored_into_a_right_one():
    right, left = (
        read_step(shared_file(f"{STEPS}/{name}"), left=bool(k))
        for k, name in enumerate(("right_step.csv", "left_step_1.csv"))
    )
    for step in (right, left):
        x, z, free = pressure_centre(step.wrench).T
        on = step.wrench[:, 1] > 100.0
        assert (np.diff(x[on]) > -5.0).all()  # along the foot, forwards
        assert np.abs(z[on]).max() < 60.0
        assert np.abs(free[on]).max() < 1e4


def test_the_program_fits_one_step_and_then_the_poses_of_a_left_one(tmp_path, capsys, monkeypatch, foot):
    step, _ = made_up(foot)
    for name, side in (("right", 1.0), ("left", -1.0)):
        poses, wrench = step.poses * [1.0, 1.0, side, side, side, 1.0], step.wrench * [1.0, 1.0, side, side, side, 1.0]
        x, z, free = pressure_centre(wrench).T
        columns = {f"foot_{quantity(key).column}": poses[:, k] for k, key in enumerate(POSE_NAMES)}
        columns |= dict(zip(("Fx_N", "Fy_N", "Fz_N"), wrench.T[:3], strict=True))
        columns |= {"time_s": step.time_s, "cop_x_mm": x, "cop_z_mm": z, "free_Ty_Nmm": free}
        write_columns(tmp_path / f"{name}.csv", columns, digits=9)
    monkeypatch.setattr(ground_contact.cc, "foundation", lambda scene: foot)
    ground_contact.main(tmp_path / "right.csv", tmp_path / "left.csv", every=1, swap=True, out=tmp_path)
    rows = {line.split()[0]: line.split()[-2:] for line in capsys.readouterr().out.splitlines() if "_" in line}
    assert max(map(float, rows["vertical_N"])) < 15.0
    assert (tmp_path / "ground_contact.png").stat().st_size > 1000
    write_columns(tmp_path / "none.csv", columns | {"Fy_N": 0.0 * x}, digits=9)
    with pytest.raises(ValueError, match="above 40 N"):
        read_step(tmp_path / "none.csv")
