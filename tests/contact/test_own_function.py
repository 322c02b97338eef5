"""A user's own contact model as a function: what it raises or gives wrongly is told with the pose where it was."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.model_checks import wrong_torques
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.walking import reference_motion_cycles
from tests.support import own_contact
from tests.support.ready_poses import PLACES, placed, walking

KNEE = cc.load_scene("knee")


@pytest.mark.parametrize("what", ["wrenches", "gaps"])
def test_an_exception_of_a_user_s_own_function_goes_on_with_the_pose_that_raised_it(what):
    def fails(poses):
        raise ZeroDivisionError("no equilibrium of the elements")

    functions = {"wrenches": own_contact.wrenches, "gaps": own_contact.gaps} | {what: fails}
    model = cc.CallableModel(own_contact.SCENE, **functions)
    with pytest.raises(ZeroDivisionError, match="no equilibrium of the elements") as error:
        getattr(model, what)(np.tile([*own_contact.CENTRE_MM, 0.1, 0.0, 0.3], (7, 1)))
    (note,) = error.value.__notes__
    assert f"{what}(poses) for 7 poses, the first at tx 5 mm, ty -3 mm, tz 2 mm, rx 5.73°, ry 0°" in note
    assert "flexion" not in note


def estimated(scene, wrenches, gaps):
    asked = []

    def counted(poses):
        asked.append(len(poses))
        return wrenches(poses)

    settings = SamplingSettings.from_scene(scene, frames=5)
    cycles = reference_motion_cycles(scene, ())[:1]
    return asked, lambda: reference_motion(cc.CallableModel(scene, counted, gaps), cycles, settings)


ELEMENTS = cc.ElasticFoundation(KNEE, (24, 16))
JOINTS = {
    "a ball in a socket, pressed along its force": (own_contact.SCENE, own_contact.wrenches, own_contact.gaps),
    "a knee, pressed downwards": (KNEE, ELEMENTS.wrenches, ELEMENTS.gaps),
}


@pytest.mark.parametrize("joint", JOINTS)
def test_loads_on_the_moving_body_are_refused_before_poses_are_sought(joint):
    scene, wrenches, gaps = JOINTS[joint]
    asked, estimate = estimated(scene, lambda poses: -wrenches(poses), gaps)
    with pytest.raises(ValueError, match="on the moving body"):
        estimate()
    assert sum(asked) <= 5 * (18 + 2 * len(scene.patch_names))
    assert estimated(scene, wrenches, gaps)[1]()[1].converged.all()
    if "knee" in joint:
        with pytest.raises(ValueError, match="pulls"):
            estimated(scene, lambda poses: -wrenches(poses), None)[1]()


WRONG_TORQUES = {
    "in N·m, expected N·mm: return 1000 times": (1e-3, False),
    "of the wrong sign": (-1.0, False),
    "about the moving body's origin, expected the": (1.0, True),
    "(in N·m )?about the moving body's origin, expected": (1e-3, True),
}
"""By what is said: the factor of the torques, and whether they are about the moving body's origin."""


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        (joint, said)
        for said, (_, moving) in WRONG_TORQUES.items()
        for joint in JOINTS
        if "ball" not in joint or not moving
    ],
)
def test_torques_that_do_not_belong_to_their_forces_are_refused_with_the_cure(joint, said):
    """By the energy that contact stores: what a turn does to forces a move does to torques."""
    scene, wrenches, gaps = JOINTS[joint]
    factor, moving = WRONG_TORQUES[said]

    def wrong(poses):
        forces, torques = np.split(wrenches(poses), 2, axis=2)
        return np.concatenate([forces, factor * (torques - moving * np.cross(poses[:, None, :3], forces))], axis=2)

    _, estimate = estimated(scene, wrong, gaps)
    with pytest.raises(ValueError, match=f"torques are {said}"):
        estimate()


@pytest.mark.parametrize(("moving", "said"), [(False, ""), (True, "about the moving body's origin")])
def test_torques_about_the_wrong_one_of_two_origins_some_mm_apart_are_found(moving, said):
    model, (poses, targets) = cc.PolarFoundation(KNEE, compiled=False), walking(8)
    poses, _ = cc.settle(model, poses, ("ty", "rx"), targets)
    told = wrong_torques_about(model, poses, [0.0, 27.2, 0.0], moving)
    assert (told.startswith(said), bool(told)) == (True, moving)


@pytest.mark.parametrize("name", ["hip", "glenohumeral"])
@pytest.mark.parametrize("off_mm", [0.0, 0.05, 3.0])
def test_torques_of_a_cup_about_its_centre_or_near_it_are_not_taken_for_those_of_the_ball(name, off_mm):
    """Within the rim and cut by it; the ball's centre lies up to 6 mm from the cup's."""
    model = cc.CupFoundation(cc.load_scene(name), compiled=False)
    for place in PLACES[name][:2]:
        origin = np.add(model.scene.geometry["cup_centre"], [off_mm, 0.0, 0.0])
        assert wrong_torques_about(model, placed(model.scene, [place]), origin, False) == ""


def wrong_torques_about(model, poses, origin, moving):
    """What is said of the torques of the first patch about an origin of the fixed body, or about the moving body's."""
    shift = np.pad(origin, (0, 3))

    def wrenches(at):
        forces, torques = np.split(model.wrenches(at + shift), 2, axis=2)
        arms = (at + shift)[:, None, :3] if moving else shift[:3]
        return np.concatenate([forces, torques - np.cross(arms, forces)], axis=2)

    near = poses - shift
    assert 0.1 < np.linalg.norm(near[:, :3], axis=1).max() < 10.0
    loads, slopes = cc.CallableModel(model.scene, wrenches).wrench_jacobian(near)
    return wrong_torques(near, loads[:, 0], slopes[:, 0])


def with_friction(share, noise=0.0, seed=4):
    """Hysteresis: forces larger by a share where the pose before lay less deep, smaller where it lay deeper."""
    rng, before = np.random.default_rng(seed), [0.0]

    def loop(poses):
        depth = -own_contact.gaps(poses)[:, 0]
        way = np.sign(np.diff(np.concatenate([before, depth])))
        before[0] = depth[-1]
        factor = 1.0 + share * way + noise * rng.standard_normal(len(poses))
        return own_contact.wrenches(poses) * factor[:, None, None]

    return loop


@pytest.mark.parametrize(("share", "noise"), [(0.1, 0.0), (0.0, 0.01)])
def test_loads_that_are_no_function_of_the_pose_are_refused(share, noise):
    """Hysteresis differs from one branch of the loop to the other, noise from call to call."""
    _, estimate = estimated(own_contact.SCENE, with_friction(share, noise), own_contact.gaps)
    with pytest.raises(ValueError, match="no function of the pose"):
        estimate()


def test_out_of_contact_root_loads_fall_with_the_model_s_own_gaps():
    """At 0.1 mm from touching: s = -gap_slope·gap, whose slope leads back along the displacement."""
    model = cc.CallableModel(own_contact.SCENE, own_contact.wrenches, own_contact.gaps)
    away = np.array([0.0, 0.6, 0.8])
    pose = np.array([[*(own_contact.CENTRE_MM + (own_contact.CLEARANCE_MM - 0.1) * away), 0.1, 0.0, -0.2]])
    roots, slopes = model.root_loads(pose)
    scale = own_contact.SCENE.gap_slope
    np.testing.assert_allclose(roots, [[-scale * 0.1]], rtol=1e-9)
    np.testing.assert_allclose(slopes[0, 0], [*(scale * away), 0.0, 0.0, 0.0], atol=1e-4)


def lifted(count=6):
    """Poses 0.3 mm from touching, and the loads and free parameters to settle them to."""
    poses = np.tile([*own_contact.CENTRE_MM, 0.0, 0.0, 0.0], (count, 1))
    poses[:, 1] += 0.1
    poses[:, 5] = np.linspace(-0.3, 0.3, count)
    return poses, ("tx", "ty", "tz"), {"Fx": 0.0, "Fy": 500.0, "Fz": 0.0}


BAD_GAPS = {
    r"gap -0\.3 mm of contact at tx 5 mm, ty -2\.9 mm, .*°, where it returned no load": lambda at: (
        -own_contact.gaps(at)
    ),
    r"gap nan mm of contact at tx 5 mm, .*, rz 17\.19°, expected a finite": lambda at: np.where(
        at[:, 5:] > 0.2, np.nan, own_contact.gaps(at)
    ),
}


@pytest.mark.parametrize("said", BAD_GAPS)
def test_gaps_of_the_wrong_sign_or_that_are_not_finite_are_refused_at_their_first_pose(said):
    poses, free, wanted = lifted()
    with pytest.raises(ValueError, match=said):
        cc.settle(cc.CallableModel(own_contact.SCENE, own_contact.wrenches, BAD_GAPS[said]), poses, free, wanted)


def test_a_model_without_loads_in_deep_overlap_loses_the_poses_that_want_them_and_no_others():
    """From 300 N on its loads are not finite: a pose that wants 500 N reaches that border and is reported there."""

    def fails_deep(poses):
        loads = own_contact.wrenches(poses)
        loads[np.linalg.norm(loads[:, 0, :3], axis=1) > 300.0] = np.nan
        return loads

    poses, free, wanted = lifted(8)
    wanted["Fy"] = np.array([50.0, 100.0, 200.0, 250.0, 290.0, 310.0, 500.0, 900.0])
    _, report = cc.settle(cc.CallableModel(own_contact.SCENE, fails_deep, own_contact.gaps), poses, free, wanted)
    np.testing.assert_array_equal(report.converged, wanted["Fy"] < 300.0, report.reason)


def test_settling_asks_for_loads_and_their_differences_once_for_each_step():
    """13 evaluations, one and two for each pose parameter, give Jacobian and root loads."""
    asked = []

    def counted(poses):
        asked.append(len(poses))
        found = own_contact.wrenches(poses)
        poses[:] = 0.0
        return found

    model, plain = (cc.CallableModel(own_contact.SCENE, f, own_contact.gaps) for f in (counted, own_contact.wrenches))
    poses, *_ = lifted(2)
    for at in (poses, poses + 0.01, poses):
        asked.clear()
        found = (*model.jacobian(at), *model.root_loads(at))
        assert sum(asked) == 13 * len(poses)
        for got, want in zip(found, (*plain.jacobian(at), *plain.root_loads(at)), strict=True):
            np.testing.assert_array_equal(got, want)
            got[:] = 0.0  # what a caller does to them is its own affair
        np.testing.assert_array_equal(model.jacobian(at)[1], plain.jacobian(at)[1])
