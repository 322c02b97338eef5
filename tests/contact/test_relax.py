"""Damped motion to rest: it ends where the loads are met, and says so where it was cut short."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.relax import _conjugate_motion
from casadi_contact.contact.settle import NOT_FINITE
from casadi_contact.core.conventions import rotation
from tests.support import two_spheres
from tests.support.ready_poses import at, walking
from tests.support.two_spheres import TwoSpheres

PRESSED = ("ty",), {"Fy_med": -400.0}


def test_damped_dynamics_finds_the_same_equilibrium():
    knee, (poses, targets) = TwoSpheres(two_spheres.knee()), walking(1)
    newton, _ = cc.settle(knee, poses, ("ty", "rx"), targets)
    rest, report = cc.relax(knee, poses, ("ty", "rx"), targets)
    assert report.converged.all(), report.reason
    assert np.abs(knee(rest) - knee(newton))[:, :2].max() < 1e-3


@pytest.mark.parametrize("method", ["BDF", "Radau"])
def test_damped_dynamics_falls_into_contact(method):
    model = cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (50, 50))
    rest, report = cc.relax(model, at(33.0), ("ty",), {"Fy": -400.0}, method=method)
    assert report.converged[0]
    assert model(rest)[0, 1] == pytest.approx(-400.0, abs=1e-3)


def test_each_load_works_on_the_motion_of_where_it_acts():
    """Central differences: of a patch's anchor for its force, of the rotation for a torque, of the origin else."""
    knee, pose, step = TwoSpheres(two_spheres.knee()), np.array([1.0, 27.0, 2.0, 0.3, -0.4, -0.7]), 1e-6
    motion = _conjugate_motion(knee, ("Fy_med", "Fy_lat", "Fx", "Fz", "Tx", "Ty", "Tz"), pose)

    def places(q):
        return np.vstack([q[:3] + (rotation(q[3:]) @ anchor) for anchor in (*knee.scene.anchors_mm, np.zeros(3))])

    for k in range(6):
        ahead, behind = pose + step * np.eye(6)[k], pose - step * np.eye(6)[k]
        med, lat, origin = (places(ahead) - places(behind)) / (2.0 * step)
        spin = (rotation(ahead[3:]) - rotation(behind[3:])) / (2.0 * step) @ rotation(pose[3:]).T
        wanted = [med[1], lat[1], origin[0], origin[2], spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(motion[:, k], wanted, atol=1e-6)


@pytest.mark.parametrize("tolerance_n", [1e-3, 1.0, 30.0])
def test_damped_motion_ends_as_soon_as_the_loads_are_met_within_tolerance(tolerance_n):
    """It creeps towards rest, so that it stops on the bound itself: neither short of it nor well inside."""
    _, report = cc.relax(TwoSpheres(two_spheres.knee()), at(27.0), *PRESSED, damping=100.0, tolerance=tolerance_n)
    assert 0.9 * tolerance_n < report.residual[0] < 1.02 * tolerance_n


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("method", ["BDF", "Radau"])
def test_a_pose_that_moves_to_where_loads_are_not_finite_ends_at_the_border_and_costs_no_other(method):
    scene = cc.load_scene("sphere_on_plane")
    elements = cc.ElasticFoundation(scene, (40, 40))

    def fails_deep(poses):
        loads = elements.wrenches(poses)
        loads[poses[:, 1] < 29.95] = np.nan
        return loads

    model = cc.CallableModel(scene, fails_deep, elements.gaps)
    starts = np.vstack([at(height) for height in (30.0, 29.97, 29.9)])
    rest, report = cc.relax(model, starts, ("ty",), {"Fy": [-1000.0, -50.0, -50.0]}, method=method)
    assert list(report.converged) == [False, True, False]
    assert list(report.reason) == [NOT_FINITE, "", NOT_FINITE]
    np.testing.assert_allclose(rest[0, 1], 29.95, atol=1e-9)
    assert model(rest)[1, 1] == pytest.approx(-50.0, abs=1e-3)
    np.testing.assert_array_equal(rest[2], starts[2])  # never finite: stays
    assert np.isfinite(report.residual[0])  # the loads where it ends, which are the last known
