"""The total wrench counts every patch once, however a scene names its loads."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import WRENCH_NAMES
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.joint_mechanics import total_selection, whole_wrench
from casadi_contact.optimisation.pose_targets import PoseTargets

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


def foundation_of(scene):
    """Of a few rays: what is summed here is its own."""
    return PolarFoundation(scene, Rays(8, 2))


@pytest.fixture(scope="module", params=BY_NAMES.values(), ids=BY_NAMES)
def model(request):
    return foundation_of(knee(request.param))


def test_it_is_the_sum_over_the_patches(model):
    pose = np.array([model.example_pose()])
    total = total_selection(model.load_names, model.patch_names) @ model(pose)[0]
    np.testing.assert_allclose(total, model.wrenches(pose)[0].sum(axis=0), rtol=1e-12, atol=1e-9)


def test_a_centre_of_pressure_is_that_of_all_that_presses(model):
    pose = np.array([model.example_pose()])
    whole = model.wrenches(pose)[0].sum(axis=0)
    centre = whole[5] / whole[1]  # Tz/Fy
    wanted = PoseTargets.of(model.scene, {"cop_ap": np.array([centre])})
    loads = model(pose)[:, [model.load_names.index(name) for name in wanted.load_names]]
    assert wanted.evaluate(loads)[0, 0] == pytest.approx(centre, rel=1e-9)
    frames = ContactFrames(model, 1)
    misfit = ca.Function("misfit", [frames.q], [frames.misfit({"cop_ap": centre})])
    assert abs(float(misfit(frames.variables(pose)))) < 1e-6


def test_of_one_side_alone_there_is_none():
    scene = knee(ONE_SIDE)
    with pytest.raises(ValueError, match="hold no Fy"):
        total_selection(scene.load_names, scene.patch_names)
    with pytest.raises(ValueError, match="cop_ap"):
        PoseTargets.of(scene, {"cop_ap": np.zeros(1)})
    with pytest.raises(ValueError, match="Fy"):
        ContactFrames(foundation_of(scene), 1).misfit({"cop_ap": 0.0})
    completed = whole_wrench(scene)
    assert completed.load_names == (*ONE_SIDE, "Fy")
