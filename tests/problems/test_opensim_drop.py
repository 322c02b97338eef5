"""The same drop by OpenSim and by CasADi, on one exported kernel."""

from importlib.util import find_spec

import numpy as np
import pytest

from problems.opensim_drop import by_casadi
from problems.opensim_drop.compare import compare
from problems.opensim_drop.problem import Drop
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


def test_a_body_without_mass_or_a_place_to_fall_from_is_refused(knee):
    with pytest.raises(ValueError, match="expected positive numbers"):
        Drop(knee, mass_kg=0.0)
    with pytest.raises(ValueError, match="lift is nan mm"):
        Drop(knee, lift_mm=np.nan)
