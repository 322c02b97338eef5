"""The drop by CasADi against formulas, and by OpenSim against CasADi."""

from importlib.util import find_spec
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import WRENCH_NAMES, rotation
from problems.opensim_drop import Drop, by_casadi, by_opensim
from tests.support.compiler import needs_compiler

START = np.array([3.0, 27.0, -8.0, 0.5, -0.6, 0.7])


@needs_compiler
@pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")
def test_opensim_and_casadi_agree(knee):
    drop = Drop(tuple(knee.example_pose() + 0.3 * np.eye(6)[1]), duration_s=0.02, points=5)
    casadi, (opensim, _) = by_casadi(knee, drop), by_opensim(knee, drop)
    assert np.ptp(casadi[:, 1]) > 0.2
    np.testing.assert_allclose(opensim, casadi, atol=1e-6)


def test_a_braked_body_comes_to_rest_where_the_contact_carries_the_push(knee):
    drop = Drop(tuple(knee.example_pose()), push_n=-300.0, damping_ns_per_m=600.0, damping_nms_per_rad=5.0)
    pose = by_casadi(knee, Drop(**{**vars(drop), "duration_s": 0.5, "points": 3}))[-1]
    loads = dict(zip(knee.load_names, knee(pose), strict=True))
    assert loads["Fy_med"] + loads["Fy_lat"] == pytest.approx(-300.0, rel=1e-2)


@pytest.mark.parametrize("point", [START[:3], np.array([40.0, 10.0, 25.0])], ids=["through its origin", "beside it"])
def test_a_steady_force_moves_and_turns_a_damped_body_as_formulas_say(point):
    """v = F/c·(1 - exp(-c·t/m)), and ω likewise: the body moves along the force, which keeps its lever."""
    force = np.array([30.0, -80.0, 20.0])
    function = ca.Function("steady", [ca.MX.sym("pose", 6)], [ca.DM([*-force, *np.cross(point, -force)])])
    steady = SimpleNamespace(load_names=WRENCH_NAMES, patch_names=("all",), function=lambda **_: function)
    drop = Drop(tuple(START), 2.0, 3e-3, 0.0, 40.0, 0.1, points=5)

    def travel(inertia, damping):
        slowed_s = inertia / damping
        return (drop.times_s - slowed_s * (1.0 - np.exp(-drop.times_s / slowed_s)))[:, None] / damping

    turned = travel(3e-3, 0.1) * 1e-3 * np.cross(point - START[:3], force)
    poses = by_casadi(steady, drop)
    np.testing.assert_allclose(poses[:, :3], START[:3] + 1e3 * travel(2.0, 40.0) * force, atol=1e-6)
    expected = Rotation.from_rotvec(turned).as_matrix() @ rotation(START[3:])
    np.testing.assert_allclose([rotation(angles) for angles in poses[:, 3:]], expected, atol=1e-7)
