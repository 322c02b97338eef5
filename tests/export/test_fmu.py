"""An FMU is valid, gives the model's loads and derivatives, and simulates as the model itself does."""

import ctypes
import re
import zipfile
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pytest

fmpy = pytest.importorskip("fmpy", reason="checking an FMU needs casadi_contact[fmi]")

from fmpy.fmi3 import FMU3Model  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

import casadi_contact as cc  # noqa: E402
from casadi_contact.core.conventions import POSE_NAMES  # noqa: E402
from tests.support.agreement import close  # noqa: E402
from tests.support.compiler import flags_of_the_library, needs_compiler  # noqa: E402
from tests.support.random_surrogates import random_confidence, random_poses, random_surrogate  # noqa: E402

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def knee():
    made = random_surrogate(cc.load_scene("knee"), "patch", seed=3)
    return type(made)(made.scene, made.networks, {}, random_confidence(2, 7))


@pytest.fixture(scope="module")
def path(knee, tmp_path_factory):
    with flags_of_the_library():
        return cc.export_fmu(knee, tmp_path_factory.mktemp("fmu") / "knee.fmu")


def unpacked(path, folder, token):
    name = fmpy.read_model_description(path).modelExchange.modelIdentifier
    return FMU3Model(guid=token, unzipDirectory=fmpy.extract(path, folder), modelIdentifier=name, instanceName="knee")


@pytest.fixture
def instance(path, tmp_path):
    """An instance for model exchange, and the references of its variables by name."""
    described = fmpy.read_model_description(path)
    fmu = unpacked(path, tmp_path, described.instantiationToken)
    fmu.instantiate(loggingOn=True)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    yield SimpleNamespace(fmu=fmu, of={v.name: v.valueReference for v in described.modelVariables})
    fmu.terminate()
    fmu.freeInstance()


def trajectory(knee):
    """Time and a pose that moves between two random ones."""
    time = np.linspace(0.0, 1.0, 21)
    first, last = random_poses(2, seed=5)
    poses = first + np.outer(0.5 - 0.5 * np.cos(np.pi * time), last - first)
    names = [("time", float), *((name, float) for name in POSE_NAMES)]
    return np.array([tuple(row) for row in np.column_stack([time, poses])], dtype=names), poses


def test_the_file_is_valid_and_states_units(path):
    assert validate_fmu(str(path)) == []
    described = fmpy.read_model_description(path, validate=True)
    units = {variable.name: variable.unit for variable in described.modelVariables}
    assert (units["tx"], units["rz"], units["Fy_med"], units["Tz"]) == ("mm", "rad", "N", "N.mm")
    factors = {unit.name: unit.baseUnit.factor for unit in described.unitDefinitions}
    assert (float(factors["mm"]), float(factors["N.mm"])) == (1e-3, 1e-3)
    with zipfile.ZipFile(path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    for kind in ("ModelExchange", "CoSimulation"):
        assert root.find(kind).get("providesDirectionalDerivatives") == "true"


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_a_simulation_gives_the_loads_of_the_moving_pose(kind, path, knee):
    moved, poses = trajectory(knee)
    result = fmpy.simulate_fmu(
        path, fmi_type=kind, input=moved, output_interval=0.05, stop_time=1.0, output=[*knee.load_names, "root_med"]
    )
    rows = [int(np.argmin(np.abs(result["time"] - t))) for t in moved["time"]]
    np.testing.assert_allclose(result["time"][rows], moved["time"], atol=1e-9)
    got = np.column_stack([result[name][rows] for name in knee.load_names])
    if kind == "CoSimulation":  # FMPy holds the inputs of a step's beginning until its end
        poses = np.vstack([poses[:1], poses[:-1]])
    close(got, knee(poses), 9)
    close(result["root_med"][rows], knee.root_loads(poses)[0][:, 0], 9)


def test_directional_and_adjoint_derivatives_are_the_jacobian(instance, knee):
    pose, seed, names = random_poses(1)[0], np.arange(1.0, 7.0), [*knee.load_names, "root_med", "root_lat"]
    inputs, outputs = [instance.of[n] for n in POSE_NAMES], [instance.of[n] for n in names]
    instance.fmu.setFloat64(inputs, pose)
    jacobian = np.vstack([knee.jacobian(pose)[1], knee.root_loads(pose)[1]])
    close(instance.fmu.getDirectionalDerivative(outputs, inputs, seed), jacobian @ seed, 9)
    weights = np.linspace(-1.0, 1.0, len(names))
    close(instance.fmu.getAdjointDerivative(outputs, inputs, weights, 6), weights @ jacobian, 9)
    close(instance.fmu.getDirectionalDerivative(outputs[2:3], inputs[1:2], [2.0]), 2.0 * jacobian[2:3, 1], 9)
    errors = [instance.of[f"expected_error_{name}"] for name in knee.load_names]
    close(instance.fmu.getFloat64([instance.of["validity"], *errors])[1:], knee.expected_error(pose), 9)


def test_a_pose_out_of_range_warns_and_one_that_is_not_finite_gives_no_loads(instance, capfd):
    inputs = [instance.of[name] for name in POSE_NAMES]
    load = [instance.of["Fy_med"]]
    instance.fmu.setFloat64(inputs, [0.0005, 0.02723, 0.0001, 0.0, -0.05, -0.3])
    assert np.isfinite(instance.fmu.getFloat64(load)).all()
    assert "out of the model's range" in capfd.readouterr().out
    instance.fmu.setFloat64(inputs, [np.nan] * 6)
    with pytest.raises(Exception, match="fmi3GetFloat64"):
        instance.fmu.getFloat64(load)
    with pytest.raises(Exception, match="fmi3SetFloat64"):
        instance.fmu.setFloat64(load, [1.0])
    with pytest.raises(Exception, match="fmi3GetInt32"):
        instance.fmu.getInt32(load)


def test_the_same_model_gives_the_same_description_and_sources(path, knee, tmp_path, monkeypatch):
    monkeypatch.setattr("casadi_contact.export.fmu.portable_library", lambda *_: Path(__file__))  # not looked at
    again = cc.export_fmu(knee, tmp_path / "again.fmu")
    with zipfile.ZipFile(path) as one, zipfile.ZipFile(again) as other:
        names = [name for name in one.namelist() if not name.startswith("binaries/")]
        assert one.namelist() == other.namelist()
        assert all(one.read(name) == other.read(name) for name in names)


def test_an_fmu_of_the_foundation_is_valid_and_gives_its_loads(tmp_path):
    model = cc.foundation("sphere_on_plane")
    start = [0.1, 29.8, 0.2, 0.0, 0.0, 0.0]
    path = cc.export_fmu(model, tmp_path / "ball.fmu", start=start)
    assert validate_fmu(str(path)) == []
    result = fmpy.simulate_fmu(path, stop_time=0.1, fmi_type="CoSimulation")
    close(np.array([result[name][-1] for name in model.load_names]), model(np.array(start)), 9)


def test_another_model_s_token_and_the_interface_s_own_name_are_refused(path, knee, tmp_path):
    with pytest.raises(Exception, match="instantiate"):
        unpacked(path, tmp_path, "another").instantiate()
    with pytest.raises(ValueError, match=r"'fmi3' is not usable, fmi3\.c is FMI's own interface"):
        cc.export_fmu(knee, tmp_path / "knee.fmu", name="fmi3")


def test_the_library_has_every_function_of_the_standard(path, tmp_path):
    header = (Path(fmpy.__file__).parent / "c-code" / "fmi3FunctionTypes.h").read_text("utf-8")
    library = ctypes.CDLL(str(next(Path(fmpy.extract(path, tmp_path)).glob("binaries/*/*"))))
    names = set(re.findall(r"\b(fmi3\w+)TYPE\b", header))
    assert len(names) > 60
    assert [name for name in names if not hasattr(library, name)] == []
