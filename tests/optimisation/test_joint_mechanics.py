"""Generalised forces do the work of the wrench, which counts every patch once; a called-back model is the model."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import WRENCH_NAMES, rotation
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection, whole_wrench
from casadi_contact.optimisation.pose_estimation import PoseTargets
from problems.contact_source import wrench_function

POSE = np.array([0.7, 27.3, 0.1, 0.002, -0.04, -0.5])


class Bare(ContactModel):
    """A model without CasADi functions of its own."""

    def __init__(self, model):
        self.scene, self.load_names, self.patch_names = model.scene, model.load_names, model.patch_names
        self.jacobian, self.root_loads = model.jacobian, model.root_loads
        self._model = model

    def __call__(self, poses):
        return self._model(poses)


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
    found = ca.DM(generalised_forces(ca.DM(pose), ca.DM(wrench), about=about)).full().ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-6)


def test_a_called_back_model_has_second_derivatives_and_no_wrench_where_there_is_no_pose():
    model = cc.load_surrogate("knee")
    own, called = (wrench_function(each, "wrench") for each in (model, Bare(model)))
    x, weights = ca.MX.sym("x", 6), np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])
    exact, differenced = (
        ca.Function("h", [x], [ca.hessian(ca.dot(ca.DM(weights), f(x)), x)[0]])(POSE).full() for f in (own, called)
    )
    np.testing.assert_allclose(differenced, exact, rtol=1e-3, atol=1e-3 * np.abs(exact).max())
    assert np.isnan(called(np.full(6, np.nan)).full()).all()


# The total of a scene's loads, however it names them.
OTHERS = [name for name in WRENCH_NAMES if name != "Fy"]
BY_NAMES = {
    "in total": ["Fy", *OTHERS],
    "of both sides": ["Fy_med", "Fy_lat", *OTHERS],
    "in total and of both sides": ["Fy_med", "Fy", "Fy_lat", *OTHERS],
    "in total and of one side": ["Fy_lat", *OTHERS, "Fy"],
}
ONE_SIDE = ["Fy_med", *OTHERS]


def knee(names):
    tables = cc.load_scene("knee").tables
    loads = {**tables["loads"], "names": names}
    return cc.Scene.from_tables({**tables, "loads": loads, "tolerances": dict.fromkeys(names, 5.0)})


@pytest.mark.parametrize("names", BY_NAMES.values(), ids=BY_NAMES)
def test_the_total_wrench_and_its_centre_of_pressure_are_those_of_all_that_presses(names):
    model = PolarFoundation(knee(names), Rays(8, 2), compiled=False)
    pose = np.array([model.example_pose()])
    whole = model.wrenches(pose)[0].sum(axis=0)
    total = total_selection(model.load_names, model.patch_names) @ model(pose)[0]
    np.testing.assert_allclose(total, whole, rtol=1e-12, atol=1e-9)
    centre = whole[5] / whole[1]  # Tz/Fy
    wanted = PoseTargets.of(model.scene, {"cop_ap": np.array([centre])})
    loads = model(pose)[:, [model.load_names.index(name) for name in wanted.load_names]]
    assert wanted.evaluate(loads)[0, 0] == pytest.approx(centre, rel=1e-9)
    frames = ContactFrames(model, 1)
    misfit = ca.Function("misfit", [frames.q], [frames.misfit({"cop_ap": centre})])
    assert abs(float(misfit(frames.variables(pose)))) < 1e-6


def test_of_one_side_alone_there_is_none():
    scene = knee(ONE_SIDE)
    with pytest.raises(ValueError, match="lack Fy"):
        total_selection(scene.load_names, scene.patch_names)
    with pytest.raises(ValueError, match="cop_ap"):
        PoseTargets.of(scene, {"cop_ap": np.zeros(1)})
    with pytest.raises(ValueError, match="Fy"):
        ContactFrames(PolarFoundation(scene, Rays(8, 2), compiled=False), 1).misfit({"cop_ap": 0.0})
    completed = whole_wrench(scene)
    assert completed.load_names == (*ONE_SIDE, "Fy")
    assert whole_wrench(knee(["Fy_med", "Fy_lat"])).tolerances["Tz"] == 125.0  # of 5 N at 25 mm
