"""Measured loads and equilibrium together; a patella on a femur; weights on lines by formula; cycles from files."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.optimisation.assembly.paths import Bundle, Muscle
from casadi_contact.scenes.walking import reference_cycle
from problems import assembly_poses
from problems.assembly_poses import AssemblyCycle, read_assembly_cycle
from tests.support.assemblies import free_bodies
from tests.support.compiler import needs_compiler
from tests.support.shared_data import shared_file

TENSION_N = np.array([150.0, 500.0, 300.0])
FRAMES = [5, 15, 70]  # of flexion from 5 to 64 degrees


@needs_compiler
def test_the_femur_carries_what_was_measured_and_the_patella_is_in_equilibrium():
    """Straight, tendon and quadriceps nearly cancel; the more the knee bends, the more the patella is pressed."""

    def contact(scene):
        return cc.load_surrogate("knee") if scene.name == "knee" else PolarFoundation(scene, Rays(12, 3))

    knee, cycle = cc.load_assembly("knee_with_patella", contact), reference_cycle()
    loads = {name: curve[FRAMES] for name, curve in cycle.estimation_targets().items()}
    pose = {f"femur_{name}": curve[FRAMES] for name, curve in cycle.pose.items()}
    given = AssemblyCycle(cycle.time_s[FRAMES], pose, "tibiofemoral", loads, {"quadriceps": TENSION_N})
    found = assembly_poses.solve(knee, given)
    assert found.solved.all()
    for name in ("Fy_med", "Fy_lat"):
        np.testing.assert_allclose(found.loads[f"tibiofemoral_{name}"], loads[name], atol=0.02)
    np.testing.assert_array_equal(found.q[:, 5], pose["femur_rz"])
    left = knee.function(by_force=True).map(3)(found.q.T, 0.0, 0.0, TENSION_N[None]).full()[6:]
    np.testing.assert_allclose(left / np.repeat([1.0, 0.025], 3)[:, None], 0.0, atol=1e-4)
    sides = found.loads["patellofemoral_Fx_med"] + found.loads["patellofemoral_Fx_lat"]
    share = np.hypot(sides, found.loads["patellofemoral_Fy"]) / TENSION_N
    assert share[0] < share[1] < share[2]


@needs_compiler
def test_the_natural_knee_bends_on_its_ligaments():
    """Straight, the collaterals hold; bent, the cruciates do; the femur rolls back and turns outwards on the tibia."""
    shared_file("data/jam/femur_cartilage.obj")
    toml = Path(assembly_poses.__file__).parent / "scenes" / "natural_knee_with_ligaments.toml"
    knee = cc.load_assembly(toml, lambda scene: CellFoundation(scene, Cells(1.7, 1.7, 4, 4)))
    bent = {"femur_rz": -np.radians([0.0, 30.0, 60.0])}
    cycle = AssemblyCycle(np.arange(3.0), bent, applied={"femur_ty": np.full(3, -300.0)})
    found = assembly_poses.solve(knee, cycle)
    assert found.solved.all()
    assert found.loads["lcl"][0] > 10.0 > found.loads["lcl"][2]
    assert (np.diff(found.loads["acl_anteromedial_2"]) > 0.0).all()
    assert (np.diff(found.q[:, 0]) > 0.0).all()
    assert (np.diff(found.q[:, 4]) < -0.05).all()
    for q in found.q:
        assert float(knee.function()(q, 0.0, 0.0, ca.DM(0, 1))[1]) == pytest.approx(300.0, abs=1e-3)
    pressed = found.loads["tibiofemoral_Fy_med"] + found.loads["tibiofemoral_Fy_lat"]
    assert (pressed < -300.0).all(), "ligaments press beside what is applied"


def hung(pull, hoist):
    """A weight under a ceiling on a ligament, and on a rope beside it: forces and the rope's tensions (n,) [N]."""
    ends = ("weight", "ceiling"), np.zeros((2, 3))
    band, rope = Bundle("band", *ends, stiffness_n=1000.0, slack_length_mm=100.0), Muscle("rope", *ends)
    assembly = free_bodies("ceiling", {"weight": -101.0 * np.eye(6)[1]}, ligaments=[band], muscles=[rope])
    locked = {f"weight_{name}": np.zeros(len(pull)) for name in ("tx", "tz", "rx", "ry", "rz")}
    time_s, applied = np.arange(len(pull), dtype=float), {"weight_ty": pull}
    return assembly_poses.solve(assembly, AssemblyCycle(time_s, locked, muscles={"rope": hoist}, applied=applied))


def test_a_weight_on_a_ligament_hangs_where_tension_carries_it():
    """Tension = weight less the rope's pull, so the strain is tension/stiffness + 0.03 in the straight part."""
    pull = np.array([-61.0, -121.0])
    found = hung(pull, np.ones(2))
    assert found.solved.all()
    np.testing.assert_allclose(1e3 * found.q[:, 1], -100.0 * (1.03 - (pull + 1.0) / 1000.0), atol=1e-5)
    np.testing.assert_allclose(found.loads["band"], -pull - 1.0, atol=1e-3)


@pytest.mark.parametrize("frame", [0, 1, 2])
def test_one_frame_without_equilibrium_costs_no_other(frame):
    """Hoisted by more than its weight, it ends at the ceiling, where the rope has no direction."""
    pull, hoist = np.array([-60.0, -90.0, -120.0]), np.zeros(3)
    hoist[frame] = 200.0
    found = hung(pull, hoist)
    np.testing.assert_array_equal(found.solved, np.arange(3) != frame)
    np.testing.assert_allclose(np.delete(found.loads["band"] + pull, frame), 0.0, atol=1e-3)


def one_rope():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    return free_bodies("earth", {"body": np.zeros(6)}, muscles=[Muscle("rope", ("body", "earth"), points)])


def test_a_cycle_is_read_by_the_names_of_the_parts(tmp_path):
    path = tmp_path / "swing.csv"
    path.write_text("time_s,body_rz_rad,body_Fy_N,rope_N\n0,0.1,-5,7\n1,0.2,-6,8\n")
    cycle = read_assembly_cycle(path, one_rope())
    np.testing.assert_array_equal(cycle.coordinates["body_rz"], [0.1, 0.2])
    np.testing.assert_array_equal(cycle.applied["body_ty"], [-5.0, -6.0])
    np.testing.assert_array_equal(cycle.muscles["rope"], [7.0, 8.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,rope_N,femur_rz_rad\n0,1,1\n1,1,1\n", "femur_rz_rad"),
        ("time_s,rope_N\n0,1\n0,1\n", "time"),
        ("time_s,rope_N,body_rz_rad\n0,1,10\n1,1,70\n", "radians"),
    ],
)
def test_a_cycle_of_something_else_is_refused(text, said, tmp_path):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(ValueError, match=said):
        read_assembly_cycle(tmp_path / "bad.csv", one_rope())


def test_a_muscle_without_force_and_unknown_coordinates_are_refused():
    time_s = np.array([0.0, 1.0])
    for cycle, word in (
        (AssemblyCycle(time_s), "rope"),
        (AssemblyCycle(time_s, {"moon_rz": time_s}, muscles={"rope": time_s}), "moon_rz"),
    ):
        with pytest.raises(ValueError, match=word):
            assembly_poses.solve(one_rope(), cycle)
