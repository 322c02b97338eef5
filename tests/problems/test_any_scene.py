"""Problems on any scene and any contact model: the foundation in the surrogate's place, other joints than the knee."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.optimisation.verification.verdict import judge, own_model
from casadi_contact.optimisation.verification.verify import loads_on
from casadi_contact.scenes.joint_cycle import JointCycle, read_joint_cycle, scene_cycles
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.workflow.project import reference_motion_cycles
from problems import pose_estimation, static_equilibrium
from problems.common.contact import ContactSource
from problems.pose_estimation import __main__, completion
from problems.pose_estimation.completion import solve_and_complete
from problems.pose_estimation.starts import moved
from tests.support.compiler import needs_compiler


def few_frames(cycle, every=20):
    curves = [{name: curve[::every] for name, curve in part.items()} for part in (cycle.pose, cycle.loads)]
    return JointCycle(cycle.name, cycle.time_s[::every], *curves)


@pytest.fixture(scope="module")
def patellofemoral():
    return PolarFoundation(cc.load_scene("patellofemoral"), Rays(16, 3))


@needs_compiler
def test_poses_on_the_foundation_are_those_on_the_surrogate_that_learned_it():
    cycle = reference_cycle(frames=5)
    learned = pose_estimation.solve(pose_estimation.build(cc.load_surrogate("knee"), cycle))
    foundation = PolarFoundation(cc.load_scene("knee"), Rays(12, 3))
    problem = pose_estimation.build(foundation, cycle)
    result = pose_estimation.solve(problem)
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(result.poses[:, [1, 3]], learned.poses[:, [1, 3]], atol=0.002)
    np.testing.assert_allclose(result.poses, learned.poses, atol=0.05)
    teacher = own_model(foundation.scene)
    assert judge(foundation, result.poses, result.converged, teacher, problem.wanted.load_names).exit_code == 0
    assert cc.verify(foundation, result.poses, teacher).passed


@needs_compiler
@pytest.mark.parametrize(
    ("name", "model", "pressing"),
    [("hip", CupFoundation, None), ("glenohumeral", CupFoundation, ("tz",)), ("patellofemoral", PolarFoundation, None)],
)
def test_every_joint_s_own_motion_is_found_again_from_random_starts(name, model, pressing):
    scene = cc.load_scene(name)
    foundation = model(scene if pressing is None else scene.with_sensitive_pose(pressing))
    cycle = few_frames(scene_cycles(scene)[0])
    problem = pose_estimation.build(foundation, cycle)
    assert problem.free == tuple(n for n in ("tx", "ty", "tz", "rx", "ry", "rz") if n not in cycle.pose)
    result = pose_estimation.solve(problem)
    assert result.converged.all(), result.reason
    verdict = judge(foundation, result.poses, result.converged, own_model(scene), problem.wanted.load_names)
    assert verdict.exit_code == 0, verdict
    for seed in range(3):
        again = pose_estimation.solve(problem, moved(problem, result.poses, np.random.default_rng(seed)))
        assert again.converged.all(), again.reason
        np.testing.assert_allclose(again.poses, result.poses, atol=1e-4)


@needs_compiler
def test_a_frame_without_load_has_no_pose_to_find_and_leaves_the_others_alone():
    """Any pose of the ball out of its cup carries nothing: none of them is the measured one."""
    scene = cc.load_scene("hip")
    foundation, cycle = CupFoundation(scene), few_frames(scene_cycles(scene)[0])
    known = pose_estimation.solve(pose_estimation.build(foundation, cycle))
    unloaded = np.isin(np.arange(len(cycle.time_s)), [0, 2, 3])
    lifted = replace(cycle, loads={name: np.where(unloaded, 0.0, curve) for name, curve in cycle.loads.items()})
    result = solve_and_complete(pose_estimation.build(foundation, lifted), None, own_model(scene))
    np.testing.assert_array_equal(result.converged, ~unloaded)
    assert set(result.reason[unloaded]) == {"no load: any pose out of contact carries it"}
    assert result.ipopt_status == "Solve_Succeeded"
    np.testing.assert_allclose(result.poses[~unloaded], known.poses[~unloaded], atol=1e-6)


@needs_compiler
def test_a_side_whose_load_was_not_measured_may_press_while_the_other_is_free(patellofemoral):
    forces = {"Fx_med": np.array([-90.0, 0.0])}
    assert pose_estimation.WantedLoads.of(patellofemoral.scene, {**forces, "cop_z": np.zeros(2)}).loaded.all()
    alone = pose_estimation.WantedLoads.of(patellofemoral.scene, forces)
    np.testing.assert_array_equal(alone.loaded, [True, False])
    np.testing.assert_array_equal(alone.carried(np.zeros((2, 1))), [True, False])


@needs_compiler
def test_where_normal_loads_are_not_wanted_a_torque_tells_that_something_presses():
    """Fx = 0 and 6.6 N·m about x: no pose out of contact carries that."""
    model, known = cc.foundation("knee"), reference_cycle(frames=5)
    held = pose_estimation.solve(pose_estimation.build(model, known)).poses[2:4]
    measured = {name: held[:, k] for k, name in enumerate(("tz", "rx", "ry", "rz"), start=2)}
    torque = model(held, ("Tx",))[:, 0]
    cycle = JointCycle("torque", np.arange(2.0), measured, {"Fx": np.zeros(2), "Tx": torque})
    problem = pose_estimation.build(model, cycle)
    assert problem.wanted.loaded.all()
    result = solve_and_complete(problem, None, own_model(model.scene))
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(model(result.poses, ("Fx", "Tx")), np.column_stack([0.0 * torque, torque]), atol=1.0)
    free = replace(cycle, loads={"Fx": np.zeros(2), "Tx": 0.0 * torque})
    assert not pose_estimation.build(model, free).wanted.loaded.any()


@needs_compiler
def test_a_part_of_the_force_in_a_cup_is_enough_where_the_rest_of_the_pose_is_measured():
    scene = cc.load_scene("hip")
    cycle = few_frames(scene_cycles(scene)[0])
    foundation = CupFoundation(scene)
    known = pose_estimation.solve(pose_estimation.build(foundation, cycle)).poses
    measured = {**cycle.measured_pose(), "tx": known[:, 0]}
    part = replace(cycle, pose=measured, loads={name: cycle.loads[name] for name in ("Fy", "Fz")})
    problem = pose_estimation.build(foundation, part)
    result = pose_estimation.solve(problem)
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(result.poses, known, atol=1e-3)
    again = pose_estimation.solve(problem, moved(problem, result.poses, np.random.default_rng(0)))
    assert again.converged.all(), again.reason


@needs_compiler
def test_frames_in_which_a_coarse_foundation_is_off_go_on_with_the_contact_model(patellofemoral):
    coarse, teacher = PolarFoundation(patellofemoral.scene, Rays(4, 1)), own_model(patellofemoral.scene)
    problem = pose_estimation.build(coarse, few_frames(scene_cycles(coarse.scene)[0], every=50))
    names = problem.wanted.load_names
    alone = solve_and_complete(problem, None, "no contact model")
    assert judge(coarse, alone.poses, alone.converged, teacher, names).exit_code == 3
    result = solve_and_complete(problem, None, teacher)
    assert result.on_model.any()
    assert judge(coarse, result.poses, result.converged, teacher, names, result.on_model).exit_code == 0
    there = result.poses[result.on_model]
    np.testing.assert_allclose(loads_on(teacher, there, names), result.loads[result.on_model])
    assert problem.wanted.carried(problem.wanted.errors(result.loads)).all()
    assert all("in the pose of the foundation it differs by" in why for why in result.reason[result.on_model])


@needs_compiler
def test_frames_whose_elements_are_too_coarse_stay_on_the_foundation():
    """Elements that finer ones contradict are no reason to give up the foundation's poses."""
    scene = cc.load_scene("knee").with_overrides(teacher=(20, 15))
    problem = pose_estimation.build(PolarFoundation(scene, Rays(12, 3)), reference_cycle(frames=5))
    alone = pose_estimation.solve(problem)
    result = solve_and_complete(problem, None, own_model(scene))
    assert not result.on_model.any()
    np.testing.assert_allclose(result.poses, alone.poses, atol=1e-6)
    verdict = judge(problem.model, result.poses, result.converged, own_model(scene), problem.wanted.load_names)
    assert verdict.doubt == "the contact model is too coarse there"


class WithLoadsOutOfContact:
    """A contact model that also carries the given loads (L,) in poses close to another one."""

    def __init__(self, of, pose, loads):
        self._of, self._pose, self._loads = of, pose, loads

    def __getattr__(self, name):
        return getattr(self._of, name)

    def __call__(self, poses, loads=None):
        values = self._of(poses, loads)
        values[np.abs(poses - self._pose).max(axis=1) < 0.1] = self._loads
        return values


@needs_compiler
def test_a_frame_that_the_foundation_carries_in_a_second_pose_is_solved_in_that_of_the_contact_model(
    patellofemoral, monkeypatch
):
    problem = pose_estimation.build(patellofemoral, few_frames(scene_cycles(patellofemoral.scene)[0], every=20))
    known = pose_estimation.solve(problem)
    assert known.converged.all()
    poses = known.poses.copy()
    poses[2, 0] -= 15.0  # lifted off the groove
    assert np.abs(patellofemoral(poses[[2]])).max() < 1.0, "out of contact"
    false = WithLoadsOutOfContact(patellofemoral, poses[2], known.loads[2])
    monkeypatch.setattr(completion, "solve", lambda *_, **__: replace(known, poses=poses))
    monkeypatch.setattr(completion, "without_leaps", lambda problem, result: result)  # it leaps, and is found so too
    result = solve_and_complete(replace(problem, model=false), None, own_model(patellofemoral.scene))
    np.testing.assert_allclose(result.poses, known.poses, atol=1e-6)
    np.testing.assert_allclose(result.loads, known.loads, atol=1e-3)
    assert not result.on_model.any()
    assert result.reason[2].startswith("found at first in another pose, where the contact model differs by")
    assert not "".join(np.delete(result.reason, 2))


@needs_compiler
def test_a_centre_of_pressure_tells_a_pose_parameter_that_was_not_measured(patellofemoral):
    """Force on one facet, and where the total crosses x = 0, stand for the forces on both.

    The groove's own axis carries no torque, so that cop_y does not exist."""
    cycle = few_frames(scene_cycles(patellofemoral.scene)[0], every=50)
    known = pose_estimation.solve(pose_estimation.build(patellofemoral, cycle)).poses
    loads = dict(zip(patellofemoral.load_names, patellofemoral(known).T, strict=True))
    with pytest.raises(ValueError, match=r"cop_y needs Fx and Tz, scene patellofemoral has .*: add what is missing"):
        pose_estimation.build(patellofemoral, replace(cycle, centres={"cop_y": np.zeros(3)}))
    across = loads["Ty"] / (loads["Fx_med"] + loads["Fx_lat"])
    one_side = {"Fx_med": cycle.loads["Fx_med"]}
    result = pose_estimation.solve(
        pose_estimation.build(patellofemoral, replace(cycle, loads=one_side, centres={"cop_z": across})), known
    )
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(result.poses, known, atol=1e-3)


def test_a_cycle_file_holds_any_loads_and_centres_of_a_scene(tmp_path, patellofemoral):
    text = "time_s,rz_rad,Fx_med_N,Fx_lat_N,cop_z_mm\n0,-0.3,200,300,2\n0.5,-0.4,210,320,1\n"
    (tmp_path / "squat.csv").write_text(text)
    cycle = read_joint_cycle(tmp_path / "squat.csv", patellofemoral.scene)
    assert list(cycle.wanted()) == ["Fx_med", "Fx_lat", "cop_z"]
    assert list(cycle.targets()) == ["Fx_med", "Fx_lat"]
    with pytest.raises(ValueError, match=r"3 loads \(Fx_med, Fx_lat, cop_z\) cannot tell 5 pose parameters"):
        pose_estimation.build(patellofemoral, cycle)


@needs_compiler
def test_a_knee_of_which_something_else_was_measured_has_the_columns_of_any_joint(tmp_path):
    knee = cc.foundation("knee")
    known = np.array([knee.example_pose()] * 2)
    loads = dict(zip(knee.load_names, knee(known[:1])[0], strict=True))
    row = [loads[name] for name in ("Fy_med", "Fy_lat", "Fx", "Fz")]
    text = "time_s,rz_rad,ry_rad,Fy_med_N,Fy_lat_N,Fx_N,Fz_N\n"
    rows = [[time, known[0, 5], known[0, 4], *row] for time in (0.0, 1.0)]
    (tmp_path / "rig.csv").write_text(text + "\n".join(",".join(map(repr, map(float, each))) for each in rows))
    (cycle,) = reference_motion_cycles(knee.scene, [tmp_path / "rig.csv"])
    result = pose_estimation.solve(pose_estimation.build(knee, cycle))
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(result.loads[:, :2], [row[:2]] * 2, atol=1.0)
    (tmp_path / "knee.csv").write_text("time_s,flexion_rz_rad,Fy_med_N,Fy_lat_N\n0,0,-1,-1\n")
    with pytest.raises(ValueError, match="lacks the columns rotation_ry_rad, cop_ap_mm, cop_ml_mm"):
        reference_motion_cycles(knee.scene, [tmp_path / "knee.csv"])


def test_a_cycle_that_prescribes_what_presses_is_told_so(tmp_path, patellofemoral):
    text = "time_s,tx_mm,ry_rad,rz_rad,ty_mm,Fx_med_N,Fx_lat_N\n0,-47,0,-0.3,20,200,300\n0.5,-47,0,-0.4,20,210,320\n"
    (tmp_path / "squat.csv").write_text(text)
    cycle = read_joint_cycle(tmp_path / "squat.csv", patellofemoral.scene)
    with pytest.raises(ValueError, match="gives tx, expected it free: tx, tz carry Fx_med, Fx_lat"):
        pose_estimation.build(patellofemoral, cycle)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"Fy_med": [0.0, -1.0]}, "scene patellofemoral has no load Fy_med, expected Fx_med"),
        ({"cop_ml": [0.0, 1.0]}, "unknown centre of pressure 'cop_ml'"),
    ],
)
def test_a_scene_that_cannot_do_it_says_why(patellofemoral, values, said):
    wanted = {name: np.array(curve) for name, curve in values.items()}
    with pytest.raises(ValueError, match=said):
        pose_estimation.WantedLoads.of(patellofemoral.scene, wanted)


def test_one_centre_of_pressure_under_two_names_is_no_second_measurement():
    twice = {"Fy_med": [-700.0], "Fy_lat": [-500.0], "cop_ap": [3.0], "cop_x": [3.0]}
    with pytest.raises(ValueError, match="got cop_ap and cop_x, which are the same coordinate: leave out one"):
        pose_estimation.WantedLoads.of(cc.load_scene("knee"), {name: np.array(curve) for name, curve in twice.items()})


@needs_compiler
def test_settling_under_six_loads_ends_at_the_same_poses_on_the_foundation():
    loads = np.tile([-100.0, -1500.0, 0.0, 7500.0, -2000.0, 0.0], (2, 1))
    foundation = PolarFoundation(cc.load_scene("knee"), Rays(12, 3))
    found = []
    for model in (cc.load_surrogate("knee"), foundation):
        rest = np.zeros((2, 6))
        rest[:, 1], rest[:, 5] = 27.0, [0.0, -0.5]
        result = static_equilibrium.solve(static_equilibrium.build(model, loads, rest=rest, about="moving"))
        assert result.converged.all(), result.reason
        found.append(result.poses)
    np.testing.assert_allclose(found[1], found[0], atol=0.02)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--scene", "sphere_on_plane"), r"scene sphere_on_plane has no \[motion\]"),
        (("--scene", "none"), "unknown scene 'none'"),
        (("--scene", "knee", "--surrogate", "knee"), "got both --surrogate and --scene, expected one of them"),
    ],
)
def test_a_scene_without_a_motion_or_contact_is_one_line(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["pose_estimation", *arguments, "--out", str(tmp_path)])
    with pytest.raises(SystemExit, match=said):
        __main__.main()


def test_a_contact_source_is_loaded_once_and_says_what_it_is():
    source = ContactSource.of(None, None)
    assert source == ContactSource(surrogate="knee")
    assert source.load() is ContactSource(surrogate="knee").load()
    assert (source.kind, ContactSource(scene="knee").kind) == ("surrogate", "foundation")


@pytest.mark.parametrize(("given", "said"), [({}, "neither"), ({"surrogate": "knee", "scene": "knee"}, "both")])
def test_a_contact_source_is_a_surrogate_or_a_scene(given, said):
    conjunction = {"neither": "nor", "both": "and"}[said]
    with pytest.raises(ValueError, match=f"got {said} --surrogate {conjunction} --scene, expected one of them"):
        ContactSource(**given)


def test_elements_take_the_foundation_s_place_where_the_whole_wrench_is_wanted_too(tmp_path):
    strict = tmp_path / "strict_patella.toml"
    tolerances = "\n".join(f"{load} = 1e-12" for load in cc.load_scene("patellofemoral").load_names)
    text = f'format = 1\nname = "strict_patella"\nlike = "patellofemoral"\n[tolerances]\n{tolerances}\n'
    strict.write_text(text, "utf-8")
    source = ContactSource(scene=str(strict))
    with pytest.warns(RuntimeWarning, match="scene strict_patella: .*; solved here on ElasticFoundation"):
        whole = source.load_whole()
    assert set(whole.load_names) - set(source.load().load_names) == {"Tz"}
    pose = whole.scene.start_pose[None, :]
    elements = cc.ElasticFoundation(whole.scene, whole.scene.grids["fine"])
    np.testing.assert_array_equal(whole(pose), elements(pose))


def test_where_no_foundation_is_good_enough_elements_take_its_place_and_the_user_is_told(tmp_path):
    strict = tmp_path / "strict.toml"
    tolerances = "\n".join(f"{load} = 1e-12" for load in cc.load_scene("hip").load_names)
    strict.write_text(f'format = 1\nname = "strict"\nlike = "hip"\n[tolerances]\n{tolerances}\n', "utf-8")
    with pytest.warns(
        RuntimeWarning, match=r"scene strict: .* expected .* at most: .*; solved here on ElasticFoundation"
    ):
        model = ContactSource(scene=str(strict)).load()
    cycle = few_frames(scene_cycles(model.scene)[0])
    result = pose_estimation.solve(pose_estimation.build(model, cycle))
    assert result.converged.all(), result.reason
    elements = cc.ElasticFoundation(model.scene, model.scene.grids["fine"])
    np.testing.assert_array_equal(model(result.poses), elements(result.poses))
