"""A model file becomes an assembly that agrees with the opensim wheel, and with what JAM stored."""

import json
import subprocess
import sys
from functools import partial
from importlib.util import find_spec

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.optimisation.assembly.file import ray_casting, write_assembly
from casadi_contact.optimisation.assembly.settling import CoordinateSettling
from casadi_contact.scenes.opensim import read_opensim_table
from casadi_contact.workflow.opensim_import.contacts import pressing
from casadi_contact.workflow.opensim_import.importing import import_model, states_of
from casadi_contact.workflow.opensim_import.model_file import read_model
from casadi_contact.workflow.opensim_import.process import describe, measure
from tests.support.compiler import needs_compiler
from tests.support.meshes import cap_mesh, sheet_mesh, slab_mesh, write_obj
from tests.support.shared_data import shared_file
from tests.support.small_model import RADIUS, random_states, write_model_with_disc, write_small_model

if find_spec("opensim") is None:
    pytest.skip("needs the extra: pip install casadi_contact[opensim]", allow_module_level=True)

INVERSE_DYNAMICS = """
import sys, json, opensim
opensim.Logger.setLevelString("off")
model = opensim.Model(sys.argv[1]); model.updForceSet().setSize(0); model.setGravity(opensim.Vec3(0.0))
state, values = model.initSystem(), json.load(sys.stdin)
q, u = state.updQ(), state.updU()
for i in range(len(values["q"])): q[i], u[i] = values["q"][i], values["u"][i]
model.realizeVelocity(state)
given = opensim.Vector(len(values["udot"]), 0.0)
for i, value in enumerate(values["udot"]): given.set(i, value)
found = opensim.InverseDynamicsSolver(model).solve(state, given)
print(json.dumps([found.get(i) for i in range(found.size())]))
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The folder of a small model, and the assembly that it became."""
    folder = tmp_path_factory.mktemp("small")
    report = import_model(write_small_model(folder), folder / "out", geometry=[folder, folder / "meshes"])
    return folder, cc.load_assembly(folder / "out"), report


@pytest.fixture(scope="module")
def bare(small):
    """The model without JAM's elements, for the wheel."""
    path = small[0] / "bare.osim"
    path.write_text(read_model(small[0] / "small.osim").rest)
    return path


def test_all_parts_are_there_and_what_is_lost_is_named(small):
    _, assembly, report = small
    assert assembly.coordinates == ("hip_r", "flex_r", "sink_r")
    assert (assembly.ligament_names, assembly.muscle_names) == (("lateral", "front"), ("back",))
    assert assembly.contact_names == ("joint_contact",)
    assert "lost: floor: HuntCrossleyForce" in report
    material = assembly.contacts[0].model.scene.material
    assert (material.youngs_modulus, material.thickness) == (5.0, 4.0)


def test_places_lengths_and_moment_arms_are_the_wheel_s(small, bare):
    _, assembly, _ = small
    states = random_states(assembly, 20)
    found = measure(bare, assembly.coordinates, states, ["lateral", "front", "back"], list(assembly.bodies), arms=True)
    places = np.array(assembly.places(list(assembly.bodies))(states.T)).reshape(3, 20, 2, 4).transpose(1, 2, 0, 3)
    np.testing.assert_allclose(places, found["places"], atol=1e-9)
    function = assembly.function(["ligament_lengths", "muscle_lengths", "muscle_arms"])
    ligaments, muscles, arms = function(states.T, 0.0, 0.0, 0.5)
    lateral, front = np.asarray(ligaments)
    np.testing.assert_allclose(lateral, found["lengths"][:, 0], atol=1e-9)
    np.testing.assert_allclose(np.asarray(muscles)[0], found["lengths"][:, 2], atol=1e-9)
    np.testing.assert_allclose(np.asarray(arms).reshape(20, 3), found["arms"][:, 2], atol=1e-7)
    wraps = found["stretches"][:, 1, 0] >= 0
    assert wraps.any(), "no state in which the path touches the roll"
    np.testing.assert_allclose(front, found["lengths"][:, 1], atol=1e-4)


@needs_compiler
def test_forces_are_those_of_energy_contact_and_the_wheel_s_inverse_dynamics(small, bare):
    _, assembly, _ = small
    (q,), u, udot = random_states(assembly, 1, seed=3), np.array([0.5, -1.0, 0.1]), np.array([3.0, 2.0, -1.0])
    given = json.dumps({"q": q.tolist(), "u": u.tolist(), "udot": udot.tolist()})
    command = [sys.executable, "-c", INVERSE_DYNAMICS, str(bare)]
    told = subprocess.check_output(command, input=given, text=True, cwd=bare.parent)
    inertia = np.ravel(assembly.function(["of_inertia"])(q, u, udot, 0.0))
    np.testing.assert_allclose(-inertia, json.loads(told), rtol=1e-9)
    deeper = assembly.default.copy()
    deeper[2] = -RADIUS + 0.0003
    wrench = np.asarray(assembly.function(["contact_wrenches"])(deeper, 0.0, 0.0, 0.0)).ravel()
    K = (1 - 0.45) * 5.0 / ((1 + 0.45) * (1 - 2 * 0.45)) / 4.0
    np.testing.assert_allclose(wrench[1], -np.pi * K * 1e3 * RADIUS * 0.3**2, rtol=0.03)
    rays = cc.load_assembly(small[0] / "out", contact=ray_casting).function(["contact_wrenches"])
    np.testing.assert_allclose(np.asarray(rays(deeper, 0.0, 0.0, 0.0)).ravel()[1], wrench[1], rtol=0.1)


@needs_compiler
def test_derivatives_are_exact_and_no_denser_than_the_joints(small):
    _, assembly, _ = small
    q, u, udot, a = (ca.MX.sym(name, size) for name, size in (("q", 3), ("u", 3), ("udot", 3), ("a", 1)))
    forces = assembly.function()(q, u, udot, a)
    x = ca.vertcat(q, a)
    jacobian = ca.Function("jacobian_of", [q, u, udot, a], [ca.jacobian(forces, x)])
    at = (assembly.default + np.array([0.1, 0.2, 0.0003]), [0.3, -0.4, 0.02], [1.0, 2.0, 0.5], 0.6)
    function, exact = assembly.function(), np.asarray(jacobian(*at))
    for k, step in enumerate((1e-6, 1e-6, 1e-8, 1e-6)):
        away = np.zeros(4)
        away[k] = step
        up, down = (function(at[0] + s * away[:3], *at[1:3], at[3] + s * away[3]) for s in (1.0, -1.0))
        difference = np.asarray(up - down).ravel() / (2.0 * step)
        np.testing.assert_allclose(exact[:, k], difference, rtol=1e-6, atol=1e-6 * np.abs(exact).max())
    lengths = assembly.function(["ligament_lengths"])(q, u, udot, a)
    assert not ca.jacobian(lengths, q).sparsity().has_nz(0, 0), "the hip does not stretch what crosses the knee"


def test_a_loose_disc_between_two_bodies_is_pressed_on_both_faces(tmp_path):
    """As a meniscus: its coordinate is free while the joint moves, its faces differ by its weight alone, and rays run
    from it, far smaller than the plate."""
    model = write_model_with_disc(tmp_path)
    of_older_files = '<Smith2018ArticularContactForce::ContactParameters name="casting_mesh_contact_params"/>'
    model.write_text(model.read_text().replace("<max_proximity>", f"{of_older_files}<max_proximity>"))
    report = import_model(model, tmp_path / "out", geometry=[tmp_path / "meshes"])
    assert "lost: upper: its own materials" in report
    assert "flex_r to 33 degrees: 8 of 8 states settle" in report
    assert "lower: rays run from bottom" in report
    in_cells = partial(cc.CellFoundation, cells=Cells(1.4, 1.4), compiled=False)
    assembly = cc.load_assembly(tmp_path / "out", in_cells)
    settled = CoordinateSettling(assembly, ["sink_r", "float"])(assembly.default, 0.3)
    wrenches, forces = (
        part.full() for part in assembly.function(["contact_wrenches", "forces"])(settled.q, 0.0, 0.0, 0.3)
    )
    assert np.abs(forces[2:4]).max() < 1e-3
    by_name = dict(zip(assembly.contact_names, wrenches[1], strict=True))
    assert by_name["joint_contact"] == 0.0
    assert by_name["upper"] < -10.0
    assert by_name["lower"] == pytest.approx(-by_name["upper"], abs=0.15)


def test_another_side_with_a_turned_roll_and_a_point_that_moves_is_read_alike(tmp_path):
    model = write_small_model(tmp_path, side="l", contact=False)
    text, on = model.read_text(), "<socket_parent_frame>/bodyset/shank</socket_parent_frame>"
    rolls = text[text.index("<WrapObjectSet>") : text.index("</WrapObjectSet>") + len("</WrapObjectSet>")]
    at = "<socket_parent>/bodyset/thigh</socket_parent><orientation>0.1 0.2 0</orientation>"
    turned = f'<components><PhysicalOffsetFrame name="turned">{at}{rolls}</PhysicalOffsetFrame></components>'
    by, line = "/jointset/knee_l/flex_l", "<LinearFunction><coefficients>{} {}</coefficients></LinearFunction>"
    moves = "".join(f"<socket_{axis}_coordinate>{by}</socket_{axis}_coordinate>" for axis in "xyz")
    for axis, slope, at in (("x", -0.01, -0.04), ("y", 0.02, -0.01), ("z", 0.0, 0.0)):
        moves += f"<{axis}_location>{line.format(slope, at)}</{axis}_location>"
    last = f'<PathPoint name="p1">{on}<location>-0.02 -0.02 0.0'
    moving = f'<MovingPathPoint name="moving">{on}{moves}</MovingPathPoint>'
    text = text.replace(rolls, turned, 1).replace(last, moving + last)
    model.write_text(text.replace("Millard2012EquilibriumMuscle", "Thelen2003Muscle"))
    report = import_model(model, tmp_path / "out", joint="knee_l")
    assert "back: its MovingPathPoint" in report
    assert "back: the curves of Thelen2003Muscle" in report
    assembly = cc.load_assembly(tmp_path / "out")
    (bare := tmp_path / "bare.osim").write_text(read_model(model).rest)
    states = np.abs(random_states(assembly, 20)) * [1.0, 1.0, -1.0]  # within the joint's range
    found = measure(bare, assembly.coordinates, states, ["front", "back"])
    front, back = assembly.function(["ligament_lengths", "muscle_lengths"])(states.T, 0.0, 0.0, 0.5)
    assert (found["stretches"][:, 0, 0] >= 0).any()
    assert float(assembly.function(["muscle_forces"])(states[0], 0.0, 0.0, 0.5)) > 0.3 * 800.0
    np.testing.assert_allclose(np.vstack([front[1, :].full(), back.full()]), found["lengths"].T, atol=1e-4)
    (tmp_path / "loads.sto").write_text("loads\nversion=1\nendheader\ntime\tforce\n0\t1\n1\t2\n")
    for wrong in ({"joint": "knee_r"}, {"motion": tmp_path / "loads.sto"}):
        with pytest.raises(ValueError, match=r"knee_r|hip_l"):
            import_model(model, tmp_path / "out", **wrong)


@pytest.mark.parametrize("turned", [False, True])
def test_neither_the_far_side_of_a_closed_mesh_nor_a_target_inside_out_turns_what_presses(turned):
    points, faces = cap_mesh(20.0, 1.2, 1.0)
    ball = TriangleMesh("ball", points, faces[:, ::-1] if turned else faces)
    slab = TriangleMesh("slab", *slab_mesh(*sheet_mesh(8.0, 1.0), 2.0))
    way, inside_out = pressing(slab, ball, np.array([0.0, 19.9, 0.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(way, [0.0, -1.0, 0.0], atol=1e-9)
    assert inside_out == turned


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("<OpenSimDocument", "<!DOCTYPE a [<!ENTITY b 'c'>]><OpenSimDocument", "entities"),
        ("OpenSimDocument", "Other", "OpenSimDocument"),
        ("contactgeometryset/ball", "contactgeometryset/none", "names none"),
        ("</Model>", "", "no XML"),
        ("model-thigh-ball.stl", "other.stl", "--geometry"),
        ("<thickness>0.002", "<thickness>0.002 0.003", "numbers"),
    ],
)
def test_a_bad_model_is_refused_with_the_cure(tmp_path, before, after, message):
    path = write_small_model(tmp_path)
    path.write_text(path.read_text().replace(before, after))
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        import_model(path, tmp_path / "out", geometry=[tmp_path / "meshes"])


def test_a_knee_of_another_program_has_its_straight_ligaments_and_contact(tmp_path):
    """Lenhart's knee at JAM's stored states, straight paths and rays: its wraps are fitted by a whole import alone."""
    model = shared_file("data/jam_knee/lenhart2015.osim")
    folder = model.parent / "passive_flexion"
    stored = {name: read_opensim_table(folder / f"{name}.sto") for name in ("states", "forces")}
    bare = tmp_path / "bare.osim"
    bare.write_text(read_model(model).rest)
    said = describe(bare)
    tables = said["tables"]
    assert [len(tables[kind]) for kind in ("coordinates", "ligaments", "muscles")] == [52, 76, 44]
    assembly = write_assembly(tmp_path, tables, said["curves"])
    states = states_of(assembly, stored["states"])[::50]
    lengths, tensions = assembly.function(["ligament_lengths", "ligament_tensions"])(states.T, 0.0, 0.0, 0.0)
    for name, length, tension in zip(assembly.ligament_names, lengths.full(), tensions.full(), strict=True):
        if not name.startswith(("MCL", "PT", "pCAP")):
            np.testing.assert_allclose(length, stored["forces"].columns[f"{name}.length"][::50], atol=1e-8)
            np.testing.assert_allclose(tension, stored["forces"].columns[f"{name}.force_spring"][::50], atol=1e-3)


SHOE = """<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000"><Model name="shoe"><gravity>0 -9.8 0</gravity><BodySet name="bodyset"><objects>
<Body name="shoe"><mass>1</mass><mass_center>0 0 0</mass_center><inertia>0.01 0.01 0.01 0 0 0</inertia></Body>
</objects></BodySet><JointSet name="jointset"><objects><FreeJoint name="free"><socket_parent_frame>/ground
</socket_parent_frame><socket_child_frame>/bodyset/shoe</socket_child_frame><coordinates>{coordinates}</coordinates>
</FreeJoint></objects></JointSet><ForceSet name="forceset"><objects><ElasticFoundationForce name="foot-ground">
<ElasticFoundationForce::ContactParametersSet name="contact_parameters"><objects>
<ElasticFoundationForce::ContactParameters><geometry>sole floor</geometry><stiffness>1e10</stiffness>
<dissipation>0.5</dissipation><static_friction>0.8</static_friction><dynamic_friction>0.6</dynamic_friction>
</ElasticFoundationForce::ContactParameters></objects></ElasticFoundationForce::ContactParametersSet>
<transition_velocity>0.1</transition_velocity></ElasticFoundationForce><HuntCrossleyForce name="heel"/>
</objects></ForceSet><ContactGeometrySet name="contactgeometryset"><objects><ContactMesh name="sole">
<socket_frame>../../bodyset/shoe</socket_frame><filename>sole.obj</filename></ContactMesh>{partner}</objects>
</ContactGeometrySet></Model></OpenSimDocument>
"""
FLOOR = (
    '<ContactHalfSpace name="floor"><socket_frame>/ground</socket_frame><orientation>0 0 -1.5707963268</orientation>'
)


@pytest.mark.parametrize(
    ("partner", "reach_mm", "curvature"),
    [
        (f"{FLOOR}</ContactHalfSpace>", 0.0, 0.0),
        (
            '<ContactSphere name="floor"><body_name>ground</body_name><radius>0.03</radius></ContactSphere>',
            30.0,
            1 / 30,
        ),
    ],
    ids=("half_space", "sphere"),
)
def test_a_foundation_of_opensim_presses_rubs_and_damps_as_it_says(tmp_path, partner, reach_mm, curvature):
    """F = π·k·d²/κ of a sphere on a plane or a sphere, κ their curvatures; 0.6 of it where it slides fast."""
    names = ("rx", "ry", "rz", "tx", "ty", "tz")
    coordinates = "".join(f'<Coordinate name="{name}"/>' for name in names)
    (tmp_path / "shoe.osim").write_text(SHOE.format(coordinates=coordinates, partner=partner))
    write_obj(tmp_path / "sole.obj", *cap_mesh(RADIUS, 0.0012, 1.0))
    report = import_model(tmp_path / "shoe.osim", tmp_path / "out")
    assert "lost: heel: HuntCrossleyForce" in report
    in_cells = partial(cc.CellFoundation, cells=Cells(1.4, 1.4), compiled=False)
    function = cc.load_assembly(tmp_path / "out", in_cells).function(["of_contacts"])
    q, u = np.array([0.0, 0.0, 0.0, 0.0, 1e-3 * reach_mm + RADIUS - 3e-4, 0.0]), np.zeros(6)
    pressed = float(function(q, u, 0.0, [])[4])
    assert pressed == pytest.approx(np.pi * 10.0 * 0.3**2 / (1e-3 / RADIUS + curvature), rel=0.02)
    u[3] = 1.0
    assert float(function(q, u, 0.0, [])[3]) == pytest.approx(-0.6 * pressed, rel=0.03)
    u[3:5] = 0.0, -0.2
    assert float(function(q, u, 0.0, [])[4]) == pytest.approx(1.1 * pressed, rel=0.05)
