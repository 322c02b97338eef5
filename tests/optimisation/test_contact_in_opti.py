"""A contact in the user's own Opti or NLP: wanted loads are found from far away, and misfits are what they say."""

import copy
import pickle
from functools import partial

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES, pose_index
from casadi_contact.optimisation.ipopt import ipopt_options
from casadi_contact.optimisation.starts import pose_bounds
from tests.support.compiler import needs_compiler

LOCKED = {"ry": 0.02, "rz": -0.5}
FORCES = {"Fy_med": -600.0, "Fy_lat": -400.0}
HIP = {"Fx": 100.0, "Fy": 500.0, "Fz": -50.0}
CENTRE = {"cop_ap_mm": 3.0, "cop_ml_mm": 1.0}


def values(surrogate, poses):
    return dict(zip(surrogate.load_names, surrogate(poses).T, strict=True))


def in_opti(knee, wanted, frames=1, locked=LOCKED):
    opti = ca.Opti()
    contact = cc.ContactInOpti(opti, knee, frames, locked=locked)
    contact.carry(wanted)
    opti.solver("ipopt", contact.options())
    return opti, contact


def test_forces_and_their_centre_are_carried(knee):
    wanted = FORCES | CENTRE
    opti, contact = in_opti(knee, wanted)
    opti.minimize(1e-3 * ca.sumsqr(contact.q[[0, 2], :]))  # slide no farther than is needed
    got = {name: load[0] for name, load in values(knee, contact.poses(opti.solve())).items()}
    fy = got["Fy_med"] + got["Fy_lat"]
    np.testing.assert_allclose([got["Fy_med"], got["Fy_lat"]], [-600.0, -400.0], atol=1e-3)
    np.testing.assert_allclose([got["Tz"] / fy, -got["Tx"] / fy], [3.0, 1.0], atol=1e-4)


def test_a_report_names_what_a_solver_calls_solved(knee):
    """A lateral load that no pose in the learned range carries, a frame out of contact."""
    opti = ca.Opti()
    contact = cc.ContactInOpti(opti, knee, 2, locked=LOCKED)
    opti.minimize(ca.sumsqr(contact.misfit(FORCES | {"cop_ap_mm": 100.0})))
    opti.solver("ipopt", contact.options())
    solution = opti.solve()
    poses, report = contact.poses(solution), contact.report(solution)
    got = values(knee, poses)
    off = np.abs(got["Tz"] / (got["Fy_med"] + got["Fy_lat"]) - 100.0)
    said = f"cop_ap_mm is off by {np.sqrt((off**2).mean()):.2g} mm (RMS), {off.max():.2g} in frame {off.argmax()}"
    assert said in report
    assert "tx is on its bound in 2 of 2 frames" in report
    assert ("validity is below 1/2 in 2 of 2" in report) == (knee.validity(poses) < 0.5).all()
    assert "no contact" not in report
    lifted = cc.ContactFrames(knee, 2, locked=LOCKED)
    at = lifted.variables(poses + 3.0 * np.eye(6)[1]).reshape(2, -1).T
    assert "there is no contact" in lifted.report(lambda of: ca.Function("value", [lifted.q], [of])(at).full())


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_compiler)])
def test_a_bounded_solution_follows_its_wanted_load_by_the_inverse_of_the_stiffness(knee, compiled):
    """To CasADi bounds with a multiplier are active, and IPOPT leaves one on each: see docs/how-to/optimisation.md."""
    sides, force, q = [knee.load_names.index(name) for name in FORCES], ca.MX.sym("force"), ca.MX.sym("q", 2)
    pose = ca.vertcat(0.0, 27.2 + 0.1 * q[0], 0.0, 0.02 * q[1], 0.02, -0.5)
    loads = knee.function(compiled=compiled)(pose)[sides]
    misfit = (loads - ca.vertcat(force, FORCES["Fy_lat"])) / 100.0
    options = {"min_lam": 1e-6, **ipopt_options()}
    solver = ca.nlpsol("settle", "ipopt", {"x": q, "p": force, "f": ca.sumsqr(misfit)}, options)
    found = solver(x0=0.0, p=force, lbx=-5.0, ubx=5.0)["x"]
    at, compliance = ca.Function("follow", [force], [found, ca.jacobian(found, force)])(FORCES["Fy_med"])
    stiffness = np.asarray(ca.Function("stiffness", [q], [ca.jacobian(loads, q)])(at))
    np.testing.assert_allclose(np.asarray(compliance).ravel(), np.linalg.solve(stiffness, [1.0, 0.0]), rtol=1e-3)


@pytest.fixture(scope="module")
def planar():
    return cc.PolarFoundation(cc.load_scene("planar_knee"), cc.Rays(8, 2))


@needs_compiler
@pytest.mark.parametrize(
    ("model", "wanted", "locked"),
    [
        (lambda: cc.load_surrogate("knee"), FORCES, LOCKED),
        (lambda: cc.load_surrogate("knee_reach"), FORCES, LOCKED),
        (lambda: cc.PolarFoundation(cc.load_scene("knee"), cc.Rays(8, 2)), FORCES, LOCKED),
        (lambda: cc.PolarFoundation(cc.load_scene("planar_knee"), cc.Rays(8, 2)), {"Fy": -600.0}, {"rz": -0.5}),
        (lambda: cc.PolarFoundation(cc.load_scene("planar_knee"), cc.Rays(8, 2)), {"Fy": -2.0}, {"rz": -0.9}),
        (lambda: cc.foundation("hip"), HIP, dict.fromkeys(("rx", "ry", "rz"), 0.0)),
    ],
    ids=["knee", "knee_reach", "foundation", "planar", "planar, hardly loaded", "hip"],
)
def test_from_far_starts_every_load_is_carried_and_no_solution_is_claimed_that_misses_it(model, wanted, locked):
    """20 starts lifted clear of contact, where loads have no slope, 50 up to 10 mm and 0.1 rad off. Settled, as `begin`
    does, all are solved; as they are nearly all, and none is claimed that is off."""
    model, rng, solved = model(), np.random.default_rng(0), 0
    opti, contact = in_opti(model, wanted, locked=locked)
    if wanted is not HIP:
        opti.minimize(ca.sumsqr(contact.pose[[0, 2], :]))
    near = contact.start_poses(wanted)
    lifted = near + rng.uniform(2.0, 15.0, (20, 1)) * np.eye(6)[1]
    assert wanted is HIP or not model(lifted).any()
    starts = np.vstack([lifted, near + rng.uniform(-1.0, 1.0, (50, 6)) * [6.0, 10.0, 6.0, 0.1, 0.1, 0.1]])
    settled = cc.ContactFrames(model, len(starts), locked=locked).start_poses(wanted, starts)
    for number, start in enumerate((*settled, *starts)):
        contact.begin_at(start)
        try:
            pose = contact.poses(opti.solve())
        except RuntimeError:
            assert number >= len(settled)
            continue
        solved += 1
        np.testing.assert_allclose(model(pose, tuple(wanted))[0], list(wanted.values()), atol=0.1)
    assert solved >= 70 + 66


@pytest.mark.parametrize("form", [list, ca.DM, lambda values: values[:, None]], ids=["list", "DM", "column"])
def test_several_frames_carry_their_own_loads_at_their_own_flexion(knee, form):
    flexion, medial = np.linspace(-0.1, -0.9, 5), np.linspace(-300.0, -900.0, 5)
    wanted, locked = {"Fy_med": form(medial), "Fy_lat": -400.0}, {"ry": 0.0, "rz": form(flexion)}
    opti, contact = in_opti(knee, wanted, 5, locked)
    steps = contact.q[:, 1:] - contact.q[:, :-1]
    opti.minimize(1e-3 * ca.sumsqr(steps))
    poses = contact.poses(opti.solve())
    np.testing.assert_array_equal(poses[:, pose_index("rz")], flexion)
    np.testing.assert_allclose(values(knee, poses)["Fy_med"], medial, atol=1e-3)


def test_a_side_that_should_carry_nothing_just_touches(knee):
    opti, contact = in_opti(knee, {"Fy_med": -500.0, "Fy_lat": 0.0})
    opti.minimize(1e-3 * ca.sumsqr(contact.q[[0, 2], :]))
    pose = contact.poses(opti.solve())
    assert knee.root_loads(pose)[0][0, 1] == pytest.approx(0.0, abs=1e-6)


def test_loads_may_be_the_user_s_own_variables(knee):
    """Two muscles of 500 N at most hold a pole of 700 N up: contact carries what they pull, found with the pose."""
    opti = ca.Opti()
    pull = opti.variable(2)
    contact = cc.ContactInOpti(opti, knee, locked=LOCKED)
    contact.begin(FORCES)
    opti.subject_to(opti.bounded(0.0, pull, 500.0))
    opti.subject_to(ca.sum1(pull) == 700.0)
    contact.carry({"Fy_med": -pull[0], "Fy_lat": -pull[1]})
    opti.minimize(ca.sumsqr(pull / 100.0) + 1e-3 * ca.sumsqr(contact.q[[0, 2], :]))
    opti.set_initial(pull, 100.0)
    opti.solver("ipopt", contact.options())
    solution = opti.solve()
    got = values(knee, contact.poses(solution))
    np.testing.assert_allclose([-got["Fy_med"][0], -got["Fy_lat"][0]], solution.value(pull), atol=1e-3)
    assert solution.value(ca.sum1(pull)) == pytest.approx(700.0)


@pytest.mark.parametrize(("kept", "lifted"), [(False, 3.0), (True, 3.0), (False, 0.0)])
def test_a_balance_with_a_reserve_ends_without_contact_unless_it_begins_there_or_is_kept(knee, kept, lifted):
    """A body of 829 N above the knee, held by contact and, dearly, by a reserve."""
    opti = ca.Opti()
    contact, reserve = cc.ContactInOpti(opti, knee, locked=LOCKED), opti.variable()
    contact.begin_at(contact.start_poses() + lifted * np.eye(6)[1])
    opti.subject_to(reserve / 100.0 - (contact.load("Fy_med") + contact.load("Fy_lat")) / 100.0 == 8.29)
    opti.minimize(ca.sumsqr(reserve / 100.0) + 1e-3 * ca.sumsqr(contact.q[[0, 2], :]))
    if kept:
        contact.keep()
    opti.solver("ipopt", contact.options())
    solution = opti.solve()
    lost = not kept and lifted > 0.0
    assert solution.value(reserve) == pytest.approx(829.0 if lost else 0.0, abs=5.0)
    assert ("there is no contact" in contact.report(solution)) == lost


def test_near_the_solution_a_misfit_is_the_error_in_newtons(knee, planar):
    """Of one side, of a total that one parameter sets, of shear, and of a torque over 25 mm."""
    for model, locked, off in ((knee, LOCKED, {"Fy_med": -1.0, "Fx": -3.0, "Tz": -50.0}), (planar, {}, {"Fy": -0.6})):
        frames = cc.ContactFrames(model, locked=locked)
        pose = frames.start_poses(FORCES if model is knee else {"Fy": -600.0})
        got = values(model, pose)
        misfit = frames.misfit({name: got[name][0] + by for name, by in off.items()})
        found = np.asarray(ca.Function("misfit", [frames.q], [misfit])(frames.variables(pose))).ravel()
        expected = {"Fy_med": -1.0, "Fx": 3.0, "Tz": 2.0, "Fy": -0.6}
        np.testing.assert_allclose(found, [expected[name] for name in off], rtol=2e-3)


def test_a_force_out_of_the_cup_is_not_carried_by_the_opposite_one():
    """A hip's cup opens downwards: no pose of the head presses its inside down, and the reverse is another wish."""
    hip, locked = cc.foundation("hip"), {"rx": 0.0, "ry": 0.0, "rz": 0.0}
    force = np.array([100.0, 500.0, -50.0])
    for sign in (1.0, -1.0):
        opti, contact = in_opti(hip, dict(zip(("Fx", "Fy", "Fz"), sign * force, strict=True)), locked=locked)
        opti.solver("ipopt", contact.options(max_iterations=60))
        if sign > 0.0:
            np.testing.assert_allclose(hip(contact.poses(opti.solve()))[0, :3], force, atol=1e-3)
        else:
            with pytest.raises(RuntimeError, match="Solver failed"):
                opti.solve()


@needs_compiler
def test_the_start_lies_in_the_learned_range_and_in_contact_and_a_foundation_s_box_holds_it_all(knee):
    low, high = pose_bounds(knee)
    poses = cc.ContactFrames(knee, 3, locked=LOCKED).start_poses(FORCES, [50.0, 90.0, -40.0, 0.5, 0.0, 0.0])
    assert ((poses >= low) & (poses <= high)).all()
    np.testing.assert_allclose(values(knee, poses)["Fy_med"], -600.0, atol=2.0)
    least, most = pose_bounds(cc.PolarFoundation(knee.scene, cc.Rays(8, 2)))
    low, high = pose_bounds(cc.load_surrogate("knee_reach"))
    assert ((least < low) & (high < most)).all()


@pytest.mark.parametrize(
    ("method", "given", "said"),
    [
        ("misfit", {}, "target"),
        ("misfit", {"Fy_med": [-600.0, 600.0]}, "Fy_med pulls .* frame 1"),
        ("misfit", {"Fy_med": [-600.0] * 3}, "frames"),
        ("misfit", {"Fy_med": np.nan}, "finite"),
        ("start_poses", {"Fy_medial": -600.0, "Fy_lat": -400.0}, "Fy_medial"),
        ("each_frame", np.zeros((3, 6)), "3 poses"),
        (None, {"frames": 0}, "frames"),
        (None, {"locked": {"rz": -2.0}}, "learned"),
        (None, {"locked": {"rz": [[-0.1, -0.2], [-0.3, -0.4]]}, "frames": 4}, "frames"),
        (None, {"locked": {"rz": ca.SX.sym("flexion")}}, "finite"),
        (None, {"locked": dict.fromkeys(POSE_NAMES, 0.0)}, "locked"),
        (None, {"loads": ("Fy_med", "My")}, "My"),
    ],
)
def test_wrong_wishes_starts_and_frames_are_refused(knee, method, given, said):
    frames, contact = cc.ContactFrames(knee, 2, locked=LOCKED), partial(cc.ContactInOpti, ca.Opti(), knee)
    with pytest.raises(ValueError, match=said):
        getattr(frames, method)(given) if method else contact(**given)


@needs_compiler
@pytest.mark.parametrize("name", ["knee", "planar"])
def test_a_settled_pose_follows_its_loads_to_second_order(request, name):
    """Loads are carried from 1.5 mm too deep to 5 mm off; derivatives are those of differences."""
    model = request.getfixturevalue(name)
    free, forces = (("ty", "rx"), FORCES) if name == "knee" else (("ty",), {"Fy": -600.0})
    settled, target = cc.settled_function(model, free, tuple(forces)), np.array(list(forces.values()))
    start = cc.ContactFrames(model, 1, locked={"rz": -0.5}).start_poses(forces)[0]
    for lift in (-1.5, 0.0, 5.0):
        pose = np.ravel(settled(target, start + lift * np.eye(6)[1]))
        got = values(model, pose[None])
        np.testing.assert_allclose([got[load][0] for load in forces], target, atol=1e-5)
        np.testing.assert_array_equal(pose[[0, 2, 4, 5]], start[[0, 2, 4, 5]])
    t, step = ca.MX.sym("t", len(target)), 1e-2
    total = ca.sumsqr(settled(t, start)[[POSE_NAMES.index(of) for of in free]])
    orders = ca.Function("orders", [t], [total, ca.gradient(total, t), ca.hessian(total, t)[0]])
    moves = step * np.eye(len(target))
    for order in (0, 1):
        ends = [(np.ravel(orders(target + m)[order]), np.ravel(orders(target - m)[order])) for m in moves]
        differences = np.squeeze([(a - b) / (2.0 * step) for a, b in ends])
        np.testing.assert_allclose(np.squeeze(orders(target)[order + 1]), differences, rtol=1e-3, atol=1e-10)


def test_a_pose_that_newton_s_method_does_not_find_is_no_number(knee):
    settled = cc.settled_function(knee, ("tx", "ty", "tz", "rx"), tuple(FORCES | CENTRE))
    start = cc.ContactFrames(knee, 1, locked=LOCKED).start_poses(FORCES)[0]
    assert np.isfinite(np.ravel(settled(list((FORCES | CENTRE).values()), start))).all()
    assert np.isnan(np.ravel(settled([-600.0, -400.0, 3.0, 1.0], start + 3.0 * np.eye(6)[1]))).any()
    with pytest.raises(ValueError, match="as many"):
        cc.settled_function(knee, ("ty",))


@needs_compiler
def test_material_and_placement_may_be_parameters_and_poses_follow_them():
    """The solution is that of a scene with this material, turned with the bodies; its slope is that of differences."""
    names, stiff = ("youngs_modulus", "fixed_ty", "fixed_rx"), np.array([800.0, 2.0, 0.05])
    model = cc.PolarFoundation(cc.load_scene("knee"), cc.Rays(8, 2))
    opti = ca.Opti()
    p = opti.parameter(3)
    contact = cc.ContactInOpti(
        opti,
        model,
        2,
        locked=LOCKED | {"tx": 0.0, "tz": 0.0},
        parameters=dict(zip(names, ca.vertsplit(p), strict=True)),
    )
    contact.carry(FORCES)
    opti.solver("ipopt", contact.options())
    opti.set_value(p, stiff)
    poses = contact.poses(opti.solve())
    f = model.function(tuple(FORCES), parameters=names)
    for pose in poses:
        np.testing.assert_allclose(np.array(f(pose, stiff))[:, 0], list(FORCES.values()), atol=1e-3)
    settled = cc.settled_function(model, targets=tuple(FORCES), parameters=names)
    np.testing.assert_allclose(np.array(settled(list(FORCES.values()), poses[0], stiff))[:, 0], poses[0], atol=1e-6)
    of = ca.MX.sym("p", 3)
    slope = ca.Function("slope", [of], [ca.jacobian(settled(list(FORCES.values()), poses[0], of), of)])(stiff)
    moves = np.diag([1.0, 1e-3, 1e-4])
    ends = [
        settled(list(FORCES.values()), poses[0], stiff + m) - settled(list(FORCES.values()), poses[0], stiff - m)
        for m in moves
    ]
    differences = np.hstack([np.array(end) for end in ends]) / (2.0 * np.diag(moves))
    np.testing.assert_allclose(np.array(slope), differences, rtol=1e-3, atol=1e-7)
    with pytest.raises(ValueError, match="foundation"):
        cc.ContactFrames(cc.load_surrogate("knee"), parameters={"youngs_modulus": 500.0})
    np.testing.assert_array_equal(copy.deepcopy(contact).lower, contact.lower)
    with pytest.raises(Exception, match="Cannot pickle"):  # CasADi's own word, with its cure
        pickle.dumps(contact)
    with pytest.raises(ValueError, match="least_n"):
        contact.keep(-1.0)
    for model in ("knee", cc.load_scene("knee")):
        with pytest.raises(TypeError, match="foundation"):
            cc.ContactInOpti(opti, model)
