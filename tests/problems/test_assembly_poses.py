"""Poses of assemblies over a cycle: measured loads and equilibrium together, from any start; cycles from files."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.connections import Ligament, Pull
from casadi_contact.optimisation.ipopt import ipopt_options
from casadi_contact.optimisation.verification.verdict import own_model
from casadi_contact.scenes.walking import reference_cycle
from problems import assembly_poses, patella
from problems.assembly_poses.check import corrected, verdicts_of
from problems.assembly_poses.cycle import AssemblyCycle, read_assembly_cycle
from problems.assembly_poses.solve import _beside_solved
from problems.patella.follow import SAME_N, loads_apart_n
from tests.support.compiler import needs_compiler

TENSION_N = np.array([150.0, 500.0, 300.0])
FRAMES = [5, 15, 70]  # of flexion from 5 to 64 degrees


@pytest.fixture(scope="module")
def problem():
    """A surrogate for one contact, a foundation for the other."""

    def contact(scene):
        return cc.load_surrogate("knee") if scene.name == "knee" else PolarFoundation(scene, Rays(24, 3))

    knee = cc.load_assembly("knee_with_patella", contact)
    cycle = reference_cycle()
    loads = {"Fy_med": cycle.fy_med, "Fy_lat": cycle.fy_lat, "cop_ap": cycle.cop_ap_mm, "cop_ml": cycle.cop_ml_mm}
    pose = {"femur": {"ry": cycle.ry[FRAMES], "rz": cycle.rz[FRAMES]}}
    loads = {name: curve[FRAMES] for name, curve in loads.items()}
    tensions = {"quadriceps": TENSION_N}
    return assembly_poses.build(
        knee, AssemblyCycle("walk", cycle.time_s[FRAMES], pose, "tibiofemoral", loads, tensions)
    )


@pytest.fixture(scope="module")
def result(problem):
    return assembly_poses.solve(problem)


@needs_compiler
def test_the_femur_carries_what_was_measured_and_the_patella_is_in_equilibrium(problem, result):
    assert result.converged.all(), result.reason
    assert result.ipopt_status == "Solve_Succeeded"
    knee, wanted = problem.assembly, problem.cycle.loads
    for name in ("Fy_med", "Fy_lat"):
        got = result.loads[:, knee.load_names.index(f"tibiofemoral_{name}")]
        np.testing.assert_allclose(got, wanted[name], atol=1e-3)
    np.testing.assert_array_equal(result.poses[:, 0, 5], problem.cycle.pose["femur"]["rz"])
    for poses, tension in zip(result.poses, TENSION_N, strict=True):
        left = np.asarray(knee.forces()(poses.T, tension))[:, 1]
        np.testing.assert_allclose(left / POSE_IN_MM, 0.0, atol=1e-3)


@needs_compiler
def test_the_patella_lies_where_following_the_femur_leads_it(problem, result):
    ride = patella.follow(problem.assembly, result.poses[:, 0], TENSION_N)
    assert ride.converged.all()
    assert loads_apart_n(problem.assembly, ride.loads, result.loads).max() < SAME_N


@needs_compiler
def test_random_starts_of_all_bodies_end_at_the_same_loads(problem, result):
    for seed in range(2):
        moves = np.random.default_rng(seed).uniform(-1.0, 1.0, result.poses.shape) * [1.0, 0.5, 1.0, 0.03, 0.03, 0.0]
        again = assembly_poses.solve(problem, result.poses + moves)
        assert again.converged.all(), again.reason
        assert loads_apart_n(problem.assembly, again.loads, result.loads).max() < SAME_N


BALL = """format = 1
name = "ball"
ground = "plane"
[bodies.ball]
pose = [0.0, 29.9, 0.0, 0.0, 0.0, 0.0]
[contacts.ball]
scene = "sphere_on_plane"
fixed = "plane"
moving = "ball"
change = { teacher = [40, 40] }
"""


@needs_compiler
def test_a_frame_that_the_contact_model_denies_goes_on_with_it(tmp_path):
    """Four rays of one point each carry 5 N as elements do, 500 N not: there the ball lies where elements carry it."""
    (tmp_path / "ball.toml").write_text(BALL)
    coarse = cc.load_assembly(tmp_path / "ball.toml", lambda scene: PolarFoundation(scene, Rays(4, 1)))
    weight = np.array([-5.0, -500.0])
    locked = {name: np.zeros(2) for name in ("tx", "tz", "rx", "ry", "rz")}
    cycle = AssemblyCycle("weighed", np.array([0.0, 1.0]), {"ball": locked}, applied={"ball": {"Fy": weight}})
    problem = assembly_poses.build(coarse, cycle)
    solved = assembly_poses.solve(problem)
    assert solved.converged.all()
    assert verdicts_of(problem, solved)["ball"].verified.tolist() == [True, False]
    result = corrected(tmp_path / "ball.toml", problem, solved)
    assert result.on_model.tolist() == [False, True]
    assert verdicts_of(problem, result)["ball"].exit_code == 0
    elements = own_model(coarse.contact("ball").model.scene)
    assert elements(result.poses[1])[0, 1] == pytest.approx(weight[1], abs=1e-3)
    np.testing.assert_array_equal(result.poses[0], solved.poses[0])


def test_an_unsolved_frame_begins_again_where_the_nearest_solved_one_lies(problem):
    poses = np.random.default_rng(0).random((3, 2, 6))
    moved = _beside_solved(problem, poses, np.array([True, False, True]))
    np.testing.assert_array_equal(moved[[0, 2]], poses[[0, 2]])
    measured = [4, 5]  # ry and rz of the femur
    np.testing.assert_array_equal(np.delete(moved[1].ravel(), measured), np.delete(poses[0].ravel(), measured))
    for column, name in zip(measured, ("ry", "rz"), strict=True):
        assert moved[1, 0, column] == problem.cycle.pose["femur"][name][1]


def poses_of(problem, x):
    """Poses (6, bodies) of each frame."""
    return np.asarray(problem.poses(x)).T.reshape(len(problem.cycle), -1, 6).swapaxes(1, 2)


@needs_compiler
def test_ipopt_alone_finds_the_patella_s_equilibrium_again(problem, result):
    """Not settling before it: the problem's own derivatives lead back from 0.05 mm and 0.1 degrees off."""
    off = result.poses.copy()
    rng = np.random.default_rng(0)
    off[:, 1] += rng.uniform(-1.0, 1.0, off[:, 1].shape) * np.repeat([0.05, 0.002], 3)
    options = ipopt_options(nlp_scaling_method="none", obj_scaling_factor=1e-3)
    solver = ca.nlpsol("poses", "ipopt", problem.nlp, options)
    answer = solver(x0=problem.variables(off), lbx=problem.lower, ubx=problem.upper, lbg=0.0, ubg=0.0)
    assert solver.stats()["success"]
    assert float(answer["f"]) < 1e-9
    assert 0 < solver.stats()["iter_count"] < 40
    loads = np.array([np.asarray(problem.assembly.function()(p)) for p in poses_of(problem, answer["x"])])[..., 0]
    assert loads_apart_n(problem.assembly, loads, result.loads).max() < SAME_N


def hung(pull, hoist):
    """A weight under a ceiling on a ligament, and on a rope beside it: forces and the rope's tensions (n,) [N]."""
    ends = ("weight", "ceiling"), (np.zeros(3), np.zeros(3))
    assembly = Assembly(
        "pendulum",
        "ceiling",
        {"weight": np.array([0.0, -101.0, 0.0, 0.0, 0.0, 0.0])},
        ligaments=[Ligament("band", *ends, 1000.0, 100.0)],
        pulls=[Pull("rope", *ends)],
    )
    locked = {name: np.zeros(len(pull)) for name in ("tx", "tz", "rx", "ry", "rz")}
    time_s = np.arange(len(pull), dtype=float)
    cycle = AssemblyCycle(
        "hang", time_s, {"weight": locked}, tensions={"rope": hoist}, applied={"weight": {"Fy": pull}}
    )
    return assembly_poses.solve(assembly_poses.build(assembly, cycle))


@needs_compiler
def test_frames_in_flight_take_no_steps_of_those_that_bear(problem, result):
    """Out of contact any pose of the femur carries no load: there is nothing to look for, and nothing to slow down."""
    bears = np.array([True, True, True, False, False, False])
    rows = np.array([0, 1, 2, 2, 2, 2])
    given = problem.cycle
    loads = {name: curve[rows] * (bears if name.startswith("Fy") else 1.0) for name, curve in given.loads.items()}
    pose = {"femur": {name: curve[rows] for name, curve in given.pose["femur"].items()}}
    flight = AssemblyCycle(
        "run", np.arange(6.0), pose, given.contact, loads, {"quadriceps": given.tensions["quadriceps"][rows]}
    )
    found = assembly_poses.solve(assembly_poses.build(problem.assembly, flight))
    np.testing.assert_array_equal(found.converged, bears)
    assert found.iterations <= result.iterations + 2
    assert loads_apart_n(problem.assembly, found.loads[bears], result.loads).max() < SAME_N
    tibiofemoral = [k for k, name in enumerate(problem.assembly.load_names) if name.startswith("tibiofemoral_")]
    np.testing.assert_allclose(found.loads[~bears][:, tibiofemoral], 0.0, atol=1e-12)
    assert set(found.reason[~bears]) == {"no load: any pose out of contact carries it"}


def test_a_weight_on_a_ligament_hangs_where_tension_carries_it():
    """No contact, nothing measured: tension = weight, so the strain is weight/stiffness + 0.03 in the straight part."""
    pull = np.array([-60.0, -120.0])
    found = hung(pull, np.zeros(2))
    assert found.converged.all(), found.reason
    np.testing.assert_allclose(found.poses[:, 0, 1], -100.0 * (1.03 - pull / 1000.0), atol=1e-6)
    np.testing.assert_allclose(found.loads[:, 0], -pull, atol=1e-6)


@pytest.mark.parametrize("frame", [0, 1, 2])
def test_one_frame_without_equilibrium_costs_no_other(frame):
    """Hoisted by more than its weight, it ends at the ceiling, where the rope has no direction."""
    pull, hoist = np.array([-60.0, -90.0, -120.0]), np.zeros(3)
    hoist[frame] = 200.0
    found = hung(pull, hoist)
    np.testing.assert_array_equal(found.converged, np.arange(3) != frame)
    assert "left on a body" in found.reason[frame]
    np.testing.assert_allclose(np.delete(found.loads[:, 0] + pull, frame), 0.0, atol=1e-3)


def rope():
    points = (np.zeros(3), np.ones(3))
    return Assembly("one", "earth", {"body": np.zeros(6)}, pulls=[Pull("rope", ("body", "earth"), points)])


def test_a_cycle_is_read_by_the_names_of_the_parts(tmp_path):
    path = tmp_path / "swing.csv"
    path.write_text("time_s,body_rz_rad,body_Fy_N,rope_N\n0,0.1,-5,7\n1,0.2,-6,8\n")
    cycle = read_assembly_cycle(path, rope())
    np.testing.assert_array_equal(cycle.pose["body"]["rz"], [0.1, 0.2])
    np.testing.assert_array_equal(cycle.applied["body"]["Fy"], [-5.0, -6.0])
    np.testing.assert_array_equal(cycle.tensions["rope"], [7.0, 8.0])
    assert (cycle.name, cycle.contact) == ("swing", "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "time_s,rope_N,femur_rz_rad\n0,1,1\n1,1,1\n",
            "unknown columns femur_rz_rad; of assembly one a cycle may tell",
        ),
        ("time_s,rope_N\n0,1\n0,1\n", "time does not rise at frame 1, 0 s after 0 s"),
        ("rope_N\n1\n1\n", "time_s"),
        ("time_s,rope_N,body_rz_rad\n0,1,10\n1,1,70\n", "body_rz_rad reaches 70, expected radians"),
    ],
)
def test_a_cycle_that_tells_of_something_else_is_refused(text, said, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_assembly_cycle(path, rope())


@needs_compiler
def test_a_force_that_may_be_of_a_body_or_of_its_contact_is_refused(tmp_path):
    (tmp_path / "ball.toml").write_text(BALL)
    (tmp_path / "press.csv").write_text("time_s,ball_Fy_N\n0,-5\n1,-6\n")
    with pytest.raises(ValueError, match="ball_Fy_N may tell of a body or of the contact of the same name"):
        read_assembly_cycle(tmp_path / "press.csv", cc.load_assembly(tmp_path / "ball.toml"))


def test_a_pull_without_tension_and_unknown_parts_are_refused():
    time_s = np.array([0.0, 1.0])
    with pytest.raises(ValueError, match="has the tensions of nothing, assembly one has the pulls rope"):
        assembly_poses.build(rope(), AssemblyCycle("swing", time_s))
    tension = {"rope": time_s}
    with pytest.raises(ValueError, match="tells of moon"):
        assembly_poses.build(rope(), AssemblyCycle("swing", time_s, {"moon": {"rz": time_s}}, tensions=tension))
    with pytest.raises(ValueError, match="has no contact joint"):
        assembly_poses.build(rope(), AssemblyCycle("swing", time_s, {}, "joint", {"Fy": time_s}, tension))
    with pytest.raises(ValueError, match=r"tension of rope is -1 N at frame 1.*never pushes"):
        assembly_poses.build(rope(), AssemblyCycle("swing", time_s, tensions={"rope": -time_s}))


def test_a_cycle_that_leaves_nothing_to_find_is_refused():
    time_s = np.array([0.0, 1.0])
    cycle = AssemblyCycle("swing", time_s, {"body": dict.fromkeys(POSE_NAMES, time_s)}, tensions={"rope": time_s})
    with pytest.raises(ValueError, match=r"swing: all pose parameters are measured, .*: leave out a column"):
        assembly_poses.build(rope(), cycle)


def test_forces_on_the_body_whose_loads_are_measured_are_refused(problem):
    """Its pose is told by its loads, which a further force would not change: the answer would not know of it."""
    cycle = replace(problem.cycle, applied={"femur": {"Fy": np.full(len(FRAMES), -300.0)}})
    with pytest.raises(ValueError, match="applies forces to femur, whose pose the loads of contact tibiofemoral tell"):
        assembly_poses.build(problem.assembly, cycle)
