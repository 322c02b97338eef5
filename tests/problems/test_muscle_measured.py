"""Muscle and contact on measured cycles of walking: signs, and forces predicted blind."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from casadi_contact.optimisation.knee import COORDINATES, contact_on_femur, in_newtons, shear_free_poses
from casadi_contact.optimisation.muscle_walk import read_walk
from casadi_contact.scenes.load_cycle import read_cycle
from problems import muscle_contact
from problems.muscle_contact.problem import BALANCED, LEAST_SQUARES
from tests.support.shared_data import shared_file


def measured_walk(name):
    files = (f"{name}_loads", f"{name}_inverse_dynamics", f"{name}_muscles", "muscle_parameters")
    return read_walk(*(shared_file(f"data/jw/{file}.csv") for file in files))


def test_measured_contact_loads_balance_with_these_signs_and_not_with_the_opposite(knee):
    walk = measured_walk("og2")
    rows = list(csv.DictReader(shared_file("data/jw/og2_loads.csv").open()))
    columns = ("Fy_med_N", "Fy_lat_N", "Fx_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm")
    time_s = [float(row["time_s"]) for row in rows]
    loads = np.column_stack([np.interp(walk.time_s, time_s, [float(row[name]) for row in rows]) for name in columns])
    contact = contact_on_femur(shear_free_poses(knee, walk.ry, walk.rz), loads)

    def left_n(turn_sign):
        names = BALANCED
        sign = {name: 1.0 if COORDINATES[name].startswith("t") else turn_sign for name in names}
        worst = []
        for k in range(0, len(walk), 5):
            arms = np.array([in_newtons(n) * walk.arms[n][k] * walk.muscles.max_isometric_force_n for n in names])
            wanted = np.array([in_newtons(n) * (walk.loads[n][k] - sign[n] * contact[n][k]) for n in names])
            worst.append(np.abs(arms @ lsq_linear(arms, wanted, (0.0, 1.0)).x - wanted).max())
        return np.sqrt(np.mean(np.square(worst)))

    assert left_n(1.0) < 1.0
    assert left_n(-1.0) > 50.0


def errors(problem, result, name):
    measured = read_cycle(shared_file(f"data/jw/{name}_loads.csv"))
    wanted = [np.interp(problem.walk.time_s, measured.time_s, -curve) for curve in (measured.fy_med, measured.fy_lat)]
    return np.sqrt(np.mean((-result.loads[:, :2] - np.column_stack(wanted)) ** 2, axis=0))


@pytest.mark.parametrize("name", ["og1", "og2", "og3", "og4"])
def test_measured_cycles_are_predicted_without_their_contact_forces(knee, name):
    """Winners of the knee Grand Challenges: 229 to 312 N medial, 238 to 326 N lateral."""
    problem = muscle_contact.build(knee, measured_walk(name))
    result = muscle_contact.solve(problem)
    assert result.converged.all(), result.reason
    assert not result.overloaded.any()
    medial, lateral = errors(problem, result, name)
    assert medial < 90.0
    assert lateral < 200.0


def test_the_least_squared_activation_alone_unloads_the_lateral_side(knee):
    problem = muscle_contact.build(knee, measured_walk("og1"), **LEAST_SQUARES)
    result = muscle_contact.solve(problem)
    assert (-result.loads[20:40, 1]).min() < 1.0
    np.testing.assert_allclose(errors(problem, result, "og1"), [88.6, 300.1], atol=1.0)


@pytest.mark.filterwarnings("ignore:muscle semimem gives no force in 1 frame")
def test_a_measured_cycle_with_a_muscle_shorter_than_its_scaled_tendon_is_solved(knee):
    """One muscle 4 mm shorter in one frame, which the longest lengths alone turn into a slack tendon."""
    walk = measured_walk("og1")
    muscle = walk.muscles.names.index("semimem")
    frame = int(walk.lengths_m[:, muscle].argmin())
    lengths = walk.lengths_m.copy()
    lengths[frame, muscle] -= 0.004
    shortened = replace(walk, lengths_m=lengths)
    for given, slack in ((shortened.lengths_m, 0), (walk.lengths_m, 1)):  # fitted to its own lengths, or to og1's
        fitted = replace(shortened, muscles=walk.muscles.fitted_to(given))
        problem = muscle_contact.build(knee, fitted, fit_lengths=False)
        assert problem.capacity.slack.sum() == slack
        assert problem.capacity.active_n[frame, muscle] == pytest.approx(0.0, abs=1e-9)
        result = muscle_contact.solve(problem)
        assert result.converged.all(), result.reason
