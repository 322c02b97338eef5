"""Muscles and secondary coordinates of a small imported model: the balance's derivatives, whole motions, files."""

import json
from dataclasses import replace
from importlib.util import find_spec

import casadi as ca
import numpy as np
import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli.main import app
from casadi_contact.networks.network import Network
from casadi_contact.optimisation.assembly.balance import FrameBalance, networks_together
from casadi_contact.optimisation.assembly.file import write_assembly
from casadi_contact.scenes.opensim import TIME, Table, read_opensim_table, write_table
from casadi_contact.workflow.opensim_import.importing import import_model, states_of
from casadi_contact.workflow.opensim_import.model_file import read_model
from casadi_contact.workflow.opensim_import.process import describe
from casadi_contact.workflow.presets import PRESETS, Effort, Preset
from problems import comak, knee_picture, passive_flexion
from tests.support.compiler import needs_compiler
from tests.support.shared_data import shared_file
from tests.support.small_model import RADIUS, write_small_model

if find_spec("opensim") is None:
    pytest.skip("needs the extra: pip install casadi_contact[opensim]", allow_module_level=True)

pytestmark = needs_compiler

COMAK = """<OpenSimDocument><COMAKTool><start_time>0.1</start_time><stop_time>0.13</stop_time>
<time_step>0.01</time_step><lowpass_filter_frequency>6</lowpass_filter_frequency>
<primary_coordinates>/jointset/knee_r/flex_r</primary_coordinates><COMAKSecondaryCoordinateSet><objects>
<COMAKSecondaryCoordinate name="sink"><coordinate>/jointset/knee_r/sink_r </coordinate></COMAKSecondaryCoordinate>
</objects></COMAKSecondaryCoordinateSet><COMAKCostFunctionParameterSet><objects><COMAKCostFunctionParameter>
<actuator>/forceset/back</actuator><weight><Constant><value>7</value></Constant></weight>
</COMAKCostFunctionParameter></objects></COMAKCostFunctionParameterSet><AnalysisSet><objects><ForceReporter>
<start_time>-Inf</start_time></ForceReporter></objects></AnalysisSet></COMAKTool></OpenSimDocument>"""
FORSIM = """<OpenSimDocument><ForsimTool><constant_muscle_control>0.1</constant_muscle_control>
<unconstrained_coordinates>/jointset/knee_r/sink_r</unconstrained_coordinates></ForsimTool></OpenSimDocument>"""
LOADS = """<OpenSimDocument><ExternalLoads><ExternalForce name="plate"><applied_to_body>shank</applied_to_body>
<force_expressed_in_body>ground</force_expressed_in_body><point_expressed_in_body>ground</point_expressed_in_body>
<force_identifier>f</force_identifier><point_identifier>p</point_identifier><torque_identifier>t</torque_identifier>
</ExternalForce><datafile>plate.sto</datafile></ExternalLoads></OpenSimDocument>"""


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A folder with the imported model, settings, and a motion of 0.3 s under 40 N of the ground."""
    folder = tmp_path_factory.mktemp("walk")
    import_model(write_small_model(folder), folder / "knee", geometry=[folder / "meshes"])
    t = np.linspace(0.0, 0.3, 61)
    motion = {TIME: t, "hip_r": 5.0 + 4.0 * np.sin(8.0 * t), "flex_r": 6.0 + 3.0 * np.cos(6.0 * t)}
    write_table(Table("motion", motion, in_degrees=True), folder / "motion.mot")
    plate = dict.fromkeys([f"{what}{axis}" for what in "fpt" for axis in "xyz"], np.zeros(61))
    write_table(Table("plate", {TIME: t, **plate, "fy": np.full(61, 40.0), "px": 0.1 * t}), folder / "plate.sto")
    for name, text in (("comak", COMAK), ("forsim", FORSIM), ("loads", LOADS)):
        (folder / f"{name}.xml").write_text(text)
    return folder


def test_the_balance_is_the_assembly_s_with_exact_derivatives(walk):
    assembly, rng = cc.load_assembly(walk / "knee"), np.random.default_rng(0)
    assembly = replace(assembly, ligaments=[replace(each, damping_n_s=6.0) for each in assembly.ligaments])
    balance = FrameBalance(assembly, ["flex_r", "sink_r"], ["sink_r"], ["shank"])
    q, loads = assembly.default + np.array([0.1, 0.2, 0.0]), rng.normal(size=(6, 1))
    u, udot = [0.5, -0.4, 0.0], [3.0, 2.0, 0.0]
    at, multipliers = np.array([200.0, -RADIUS + 0.0003, 0.03]), np.array([0.7, -1.3])
    whole = assembly.function(coordinates=["flex_r", "sink_r"], loaded=["shank"], by_force=True)
    expected = whole([q[0], q[1], at[1]], [u[0], u[1], at[2]], udot, at[0], loads)
    np.testing.assert_allclose(balance.forces(*at, q, u, udot, loads), expected, rtol=1e-6, atol=1e-6)
    J, H = balance.jacobian(*at, q, u, udot, loads).full(), balance.hessian(*at, multipliers, q, u, udot, loads).full()
    for k, step in enumerate((1e-2, 1e-8, 1e-5)):
        ends = [at + sign * step * np.eye(3)[k] for sign in (1.0, -1.0)]
        up, down = (balance.forces(*end, q, u, udot, loads).full() for end in ends)
        np.testing.assert_allclose(J[:, k], (up - down).ravel() / (2.0 * step), rtol=1e-5, atol=1e-5)
        up, down = (balance.jacobian(*end, q, u, udot, loads).full().T @ multipliers for end in ends)
        np.testing.assert_allclose(H[:, k], (up - down) / (2.0 * step), rtol=1e-4, atol=1e-3 * np.abs(H[:, k]).max())


def test_networks_together_are_each_by_itself():
    rng = np.random.default_rng(0)
    sizes = [(3, 4, 1), (6, 5, 5, 1), (3, 1), (3, 2, 1)]
    networks = [
        Network(
            rng.normal(size=size[0]),
            np.full(size[0], 2.0),
            tuple(rng.normal(size=shape) for shape in zip(size[1:], size, strict=False)),
            tuple(rng.normal(size=width) for width in size[1:]),
            3.0,
        )
        for size in sizes
    ]
    x = ca.MX.sym("x", 15)
    together = ca.Function("together", [x], [networks_together(networks)(x)])
    inputs = rng.normal(size=15)
    parts = np.split(inputs, np.cumsum([size[0] for size in sizes])[:-1])
    each = [network.value(part[None]).item() for network, part in zip(networks, parts, strict=True)]
    np.testing.assert_allclose(np.asarray(together(inputs)).ravel(), each, rtol=1e-12)


def test_all_frames_balance_at_no_more_cost_than_one_after_the_other(walk, capsys, monkeypatch):
    given = {"settings": walk / "comak.xml", "coordinates": walk / "motion.mot", "loads": walk / "loads.xml"}
    with pytest.raises(SystemExit, match="0"):
        comak.main(walk / "knee", **given, whole=False, out=walk / "one")
    small = {"root": Effort(((10, 10),), 5.0), "ratios": Effort(((6,),), 1.0)}
    monkeypatch.setitem(PRESETS, "tiny", Preset(0.02, {"patch": small}))
    built = {"--preset": "tiny", "--cycles": walk / "one" / "values.sto", "--out": walk / "networks"}
    options = [str(word) for option in built.items() for word in option]
    result = CliRunner().invoke(app, ["build", str(walk / "knee"), *options])
    assert result.exit_code == 0, result.output
    with pytest.raises(SystemExit, match="0"):
        comak.main(walk / "knee", **given, against=walk / "one", networks=walk / "networks", out=walk / "all")
    assert "frames: 4\n" in capsys.readouterr().out
    told = json.loads((walk / "all" / "summary.json").read_text("utf-8"))
    assert told["networks: muscles from cells"][1] < 0.01 * told["networks: muscles from COMAK"][1] + 1.0
    assert told["networks: CPU time of a frame [ms]"]["hessian"] > 0.0
    assembly, told = cc.load_assembly(walk / "knee"), comak.Settings.read(walk / "comak.xml")
    assert told.weights == {"back": 7.0}
    problem = comak.Walk(assembly, comak.read_motion(assembly, told, given["coordinates"], given["loads"]), told)
    costs = []
    for folder in ("one", "all"):
        x, force = comak.read_result(problem, walk / folder)
        left, contact = comak.replay(problem, assembly, x, force)
        assert np.abs(left[:, 1]).max() < 0.5, "the sinking coordinate has no reserve to speak of"
        assert contact.min() > 10.0
        costs.append(problem.cost(force / problem.strength).sum() + comak.RESERVE_WEIGHT * np.square(left).sum())
    assert costs[1] <= costs[0] * (1.0 + 1e-4)
    activation = read_opensim_table(walk / "all" / "activation.sto").column("/forceset/back")
    assert activation.min() >= comak.LEAST - 1e-6


def test_weight_on_the_contacts_energy_lowers_it_by_exact_derivatives(walk):
    assembly, q = cc.load_assembly(walk / "knee"), np.array([0.1, 0.2, -RADIUS + 0.0004])
    energy, bent = FrameBalance(assembly, ["sink_r"], ["sink_r"]).energy
    depths = -RADIUS + np.array([0.0003, 0.0004, 0.0005])
    values = [float(energy(each, q)) for each in depths]
    wrench = assembly.function(["contact_wrenches"])(q, 0.0, 0.0, 0.0)
    np.testing.assert_allclose((values[2] - values[0]) / 2e-4, abs(float(wrench[1])), rtol=0.02)
    np.testing.assert_allclose(float(bent(depths[1], q)), (values[2] - 2 * values[1] + values[0]) / 1e-8, rtol=0.05)
    given = walk / "motion.mot", walk / "loads.xml"
    pressed = []
    for weight in (0.0, 1e4):
        told = replace(comak.Settings.read(walk / "comak.xml"), energy_weight=weight)
        problem = comak.Walk(assembly, comak.read_motion(assembly, told, *given), told)
        found = problem.all_frames(problem.frame_by_frame())
        assert found.outcome.solved
        pressed.append(sum(float(energy(x, at)) for x, at in zip(found.secondary, problem.motion.q, strict=True)))
    assert pressed[1] < pressed[0]


def test_a_joint_settles_along_a_prescribed_motion_and_a_stored_one_is_compared(walk):
    (walk / "states.sto").write_text((walk / "motion.mot").read_text())
    with pytest.raises(SystemExit, match="0"):
        passive_flexion.main(
            walk / "knee", walk / "forsim.xml", walk / "motion.mot", against=walk, rest=True, out=walk / "passive"
        )
    assembly, values = cc.load_assembly(walk / "knee"), read_opensim_table(walk / "passive" / "values.sto")
    q, function = states_of(assembly, values)[::20], assembly.function(coordinates=["sink_r"])
    forces = [float(function(each, 0.0, 0.0, 0.1)) for each in q]
    assert np.ptp(q[:, 2]) > 1e-6
    assert np.abs(forces).max() < 20.0, "all but damping and inertia of the motion is in balance"
    told = "<external_loads_file>own.xml</external_loads_file></ForsimTool>"
    (walk / "pulled.xml").write_text(FORSIM.replace("</ForsimTool>", told))
    (walk / "own.xml").write_text(LOADS.replace("in_body>ground", "in_body>/bodyset/shank"))
    with pytest.raises(SystemExit, match="0"):
        passive_flexion.main(walk / "knee", walk / "pulled.xml", walk / "motion.mot", out=walk / "pulled")
    pulled = states_of(assembly, read_opensim_table(walk / "pulled" / "values.sto"))[-1]
    loaded = assembly.function(coordinates=["sink_r"], loaded=[("shank", "shank")])
    load = [0.0, 40.0, 0.0, 0.0, 0.0, 40.0 * 0.1 * 0.3]
    assert abs(float(loaded(pulled, 0.0, 0.0, 0.1, load))) < 20.0 < abs(float(function(pulled, 0.0, 0.0, 0.1)))
    knee_picture.main(walk / "knee", walk / "passive" / "values.sto", at=0.1, out=walk / "knee.png")
    assert (walk / "knee.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [("<time_step>0.01</time_step>", "", "time_step"), ("<value>7</value>", "<value>a</value>", "numbers")],
)
def test_bad_settings_are_refused(walk, before, after, message):
    path = walk / "bad.xml"
    path.write_text(COMAK.replace(before, after))
    with pytest.raises(ValueError, match=message):
        comak.Settings.read(path)


def test_a_motion_is_prepared_as_comak_prepares_it(tmp_path):
    """Lenhart's model, JAM's walking trial: prescribed and primary coordinates are those that COMAK stored."""
    stored = shared_file("data/jam_knee/comak/values.sto")
    folder = stored.parents[1]
    (tmp_path / "bare.osim").write_text(read_model(folder / "lenhart2015.osim").rest)
    said = describe(tmp_path / "bare.osim")
    assembly = write_assembly(tmp_path, said["tables"], said["curves"])
    told = comak.Settings.read(stored.with_name("settings.xml"))
    walking = folder / "walking"
    motion = comak.read_motion(assembly, told, walking / "overground_17_ik.mot", walking / "external_loads.xml")
    theirs = states_of(assembly, read_opensim_table(stored))
    held = [i for i in range(52) if i not in assembly.rows(told.secondary)]
    np.testing.assert_allclose(motion.q[:, held], theirs[:, held], atol=1e-9)
    assert (len(told.primary), len(told.secondary), motion.bodies) == (5, 11, ("calcn_l", "calcn_r"))
    assert motion.loads[:, 1, 1].max() > 700.0, "the right foot stands on the second plate"
