"""Generalised forces do the work of the wrench; a called-back model is the model, derivatives included."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import WRENCH_NAMES, rotation
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection, wrench_function

POSE = np.array([0.7, 27.3, 0.1, 0.002, -0.04, -0.5])


class Bare(ContactModel):
    """A model without CasADi functions of its own."""

    def __init__(self, model):
        self.scene, self.load_names, self.patch_names = model.scene, model.load_names, model.patch_names
        self.jacobian, self.root_loads = model.jacobian, model.root_loads
        self._model = model

    def __call__(self, poses):
        return self._model(poses)


def forces_of(pose, wrench, about):
    return np.asarray(ca.DM(generalised_forces(ca.DM(pose), ca.DM(wrench), about=about))).ravel()


def work_of_two_point_forces(pose, points, forces, step):
    """Work of forces fixed in space on points carried along by a small motion of the body."""
    local = (points - pose[:3]) @ rotation(pose[3:])
    moved = pose + step
    return float(np.sum(forces * (moved[:3] + local @ rotation(moved[3:]).T - points)))


@pytest.mark.parametrize("about", ["fixed", "moving"])
def test_generalised_forces_do_the_work_of_forces_on_the_body(about):
    rng = np.random.default_rng(3)
    pose = np.array([1.0, 20.0, -2.0, 0.3, -0.2, -0.9])
    points, forces = rng.normal(size=(2, 3)) * 10.0, rng.normal(size=(2, 3)) * 50.0
    arms = points - (pose[:3] if about == "moving" else 0.0)
    wrench = np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)])
    expected = [
        (work_of_two_point_forces(pose, points, forces, s) - work_of_two_point_forces(pose, points, forces, -s)) / 2e-5
        for s in 1e-5 * np.eye(6)
    ]
    np.testing.assert_allclose(forces_of(pose, wrench, about), expected, rtol=1e-7, atol=1e-6)


def test_a_called_back_foundation_gives_its_wrench_and_analytic_jacobian():
    foundation = cc.ElasticFoundation(cc.load_scene("knee"), (40, 30))
    called, x = wrench_function(foundation), ca.MX.sym("x", 6)
    slope = ca.Function("slope", [x], [ca.jacobian(called(x), x)])
    pick = total_selection(foundation.load_names, foundation.patch_names)
    wrench, jacobian = foundation.jacobian(POSE[None])
    np.testing.assert_allclose(np.asarray(called(POSE)).ravel(), pick @ wrench[0], rtol=1e-12)
    np.testing.assert_allclose(np.asarray(slope(POSE)), pick @ jacobian[0], rtol=1e-12)


def test_a_called_back_model_has_second_derivatives_and_no_wrench_where_there_is_no_pose():
    model = cc.foundation("knee")
    own, called = (wrench_function(each, "wrench") for each in (model, Bare(model)))
    x, weights = ca.MX.sym("x", 6), np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])
    exact, differenced = (
        ca.Function("h", [x], [ca.hessian(ca.dot(ca.DM(weights), f(x)), x)[0]])(POSE).full() for f in (own, called)
    )
    np.testing.assert_allclose(differenced, exact, rtol=1e-3, atol=1e-3 * np.abs(exact).max())
    assert np.isnan(called(np.full(6, np.nan)).full()).all()


def test_a_called_back_surrogate_equals_its_own_function():
    knee = cc.load_surrogate("knee")
    own, called = wrench_function(knee), wrench_function(Bare(knee))
    np.testing.assert_allclose(np.asarray(own(POSE)), np.asarray(called(POSE)), rtol=1e-10, atol=1e-9)


def test_loads_without_a_whole_wrench_are_refused():
    with pytest.raises(ValueError, match="Fz"):
        total_selection([name for name in WRENCH_NAMES if name not in ("Fz", "Tz")], ("med", "lat"))
