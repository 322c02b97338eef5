"""Every function of an exported model gives Python's numbers; its status says whether the pose was learned."""

import ctypes
import re
import shutil
import subprocess

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.core.compiler import compiler_command
from casadi_contact.core.quantities import quantity
from casadi_contact.surrogate.base import Surrogate
from tests.support.agreement import close
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import THREE, random_confidence, random_poses, random_surrogate, scene_called

OK, OUTSIDE, NOT_FINITE = range(3)
pytestmark = [needs_compiler, pytest.mark.skipif(shutil.which("make") is None, reason="no make found")]


class Exported:
    """The functions of a model's shared library, built by its own makefile."""

    def __init__(self, model, folder, **keywords):
        cc.export_c(model, folder, name="joint", **keywords)
        plain = "-std=c99 -pedantic" if isinstance(model, Surrogate) else "-Wno-psabi"
        flags = f"CFLAGS=-O0 -Wall -Wextra {plain}"  # the makefile's -O3 takes long
        command = ["make", "-C", str(folder), "joint.so", f"CC={compiler_command()[0]}", flags]
        built = subprocess.run(command, check=True, capture_output=True, text=True)
        assert "warning" not in built.stderr
        self.library, self.header = ctypes.CDLL(str(folder / "joint.so")), (folder / "joint.h").read_text()
        self.loads, self.patches = len(model.load_names), len(model.patch_names)

    def __call__(self, function, pose, *outputs):
        """The arrays that were filled in."""
        arrays = [np.full(output, 7.0) if isinstance(output, tuple) else np.array(output, float) for output in outputs]
        pose = np.array(pose, dtype=float)
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (pose, *arrays)]
        getattr(self.library, f"joint_{function}")(*pointers)
        return arrays[0] if len(arrays) == 1 else arrays

    def status(self, pose):
        return self.library.joint_status((ctypes.c_double * 6)(*pose))

    def all_of(self, pose):
        """Status, and the numbers of every function."""
        loads = self("loads", pose, (self.loads,))
        again, jacobian = self("jacobian", pose, (self.loads,), (self.loads, 6))
        validity, errors = self("confidence", pose, (1,), (self.loads,))
        np.testing.assert_allclose(again, loads, rtol=1e-9)
        roots = self("roots", pose, (self.patches,), (self.patches, 6))
        return self.status(pose), loads, jacobian, *roots, validity[0], errors


@pytest.mark.parametrize(("scene", "structure"), [("knee", "patch"), (THREE, "patch"), ("knee", "two_stage")])
def test_an_exported_surrogate_gives_loads_roots_validity_and_expected_error_and_says_what_was_learned(
    scene, structure, tmp_path
):
    made = random_surrogate(scene_called(scene), structure)
    size = 800.0 if structure == "two_stage" else 1.0
    confidence = random_confidence(len(made.patch_names), len(made.load_names), root_size=size)
    surrogate = type(made)(made.scene, made.networks, made.record, confidence)
    exported = Exported(surrogate, tmp_path)
    poses, weights = random_poses(30), np.linspace(1.0, 2.0, len(surrogate.load_names))
    poses[0] = confidence.centre_poses[0]
    for pose in poses:
        status, *got = exported.all_of(pose)
        wanted = (*surrogate.jacobian(pose), *surrogate.root_loads(pose))
        for number, want in zip(got, (*wanted, surrogate.validity(pose), surrogate.expected_error(pose)), strict=True):
            close(number, want, 8)
        assert status == (OK if surrogate.validity(pose) >= 0.5 else OUTSIDE)
        close(exported("hessian", pose, weights, (6, 6))[1], surrogate.hessian(pose, weights), 8)
    validity = surrogate.validity(poses)
    assert ((validity >= 0.5) & (validity < 0.9)).any(), "the limit is a half"
    assert (validity < 0.5).any()
    assert exported.status(poses[0] * [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0]) == OUTSIDE, "a pose in metres"
    status, *numbers = exported.all_of([0.0, np.nan, 0.0, 0.0, 0.0, 0.0])
    assert status == NOT_FINITE
    assert all(np.isnan(number).all() for number in numbers)


def test_the_shipped_knee_starts_from_a_learned_pose_and_refuses_one_in_metres(tmp_path):
    knee = cc.load_surrogate("knee")
    exported, pose = Exported(knee, tmp_path), np.array(knee.example_pose())
    assert all(text in exported.header for text in ("tx [mm]", "Fy_med [N]", "Tz [Nmm]"))
    command = ["make", "-C", str(tmp_path), f"CC={compiler_command()[0]}", "CFLAGS=-O0"]
    subprocess.run(command, check=True, capture_output=True)
    demo = subprocess.run([tmp_path / "example", "demo"], capture_output=True, text=True, check=True)
    name, load, unit, *_ = demo.stdout.split()
    assert (name, unit) == ("Fy_med", "N")
    assert -2000.0 < float(load) < -10.0
    given = " ".join(map(repr, np.r_[pose, pose + 1e-3].tolist()))
    rows = subprocess.run([tmp_path / "example"], input=given, capture_output=True, text=True, check=True).stdout
    rows = [np.array(row.split(), dtype=float) for row in rows.splitlines()[14:]]
    close(rows[0], knee(pose + 1e-3), 9)
    close(np.stack(rows[1:8]), knee.jacobian(pose + 1e-3)[1], 9)
    close(np.stack(rows[8:]), knee.hessian(pose + 1e-3, np.ones(7)), 8)
    metres = "0.0005 0.02723 0.0001 0 -0.05 -0.3"
    told = subprocess.run([tmp_path / "example"], input=metres, capture_output=True, text=True)
    assert told.returncode == 1
    assert told.stderr.startswith("pose out of the model's range (validity of at least 1/2)")
    for arguments, given, said in ((metres.split(), "", "got the argument 0.0005"), ([], "1 2 3", "pose of 3 numbers")):
        wrong = subprocess.run([tmp_path / "example", *arguments], input=given, capture_output=True, text=True)
        assert wrong.returncode == 2
        assert said in wrong.stderr


def test_without_calibration_no_pose_is_known_to_be_out_of_range(tmp_path):
    unknown = Exported(random_surrogate(scene_called("sphere_on_plane"), "patch"), tmp_path)
    status, *_, errors = unknown.all_of([0.0, 41.0, 0.0, 0.0, 0.0, 0.0])
    assert status == OK
    assert np.isnan(errors).all()
    assert "never calibrated" in unknown.header
    assert "pressures none" in unknown.header
    assert not hasattr(unknown.library, "joint_pressures")


@pytest.mark.parametrize("scene", ["knee", "hip", "sphere_on_plane"])
def test_an_exported_foundation_gives_its_loads_and_refuses_what_no_layer_can_bear(scene, tmp_path):
    # Cubic cells, which the sphere gets here, keep their tables in a file of their own.
    model = CellFoundation(cc.load_scene(scene)) if scene == "sphere_on_plane" else cc.foundation(scene)
    pole = model.scene.geometry.get("cup_pole", (0.0, -1.0, 0.0))
    away = np.array([*(np.negative(pole) / np.linalg.norm(pole)), 0.0, 0.0, 0.0])
    nearest = model.scene.start_pose + np.outer(np.linspace(30.0, -30.0, 601), away)
    pressed = nearest[np.flatnonzero(model.gaps(nearest).min(axis=1) < -0.1)[0]]
    exported = Exported(model, tmp_path, example_pose=pressed)
    status, *got, validity, errors = exported.all_of(pressed)
    assert status == OK
    for number, want in zip(got, (*model.jacobian(pressed), *model.root_loads(pressed)), strict=True):
        close(number, want, 8)
    assert np.isnan(validity)
    assert np.isnan(errors).all()
    assert_pressures_are_python_s(exported, model, [pressed, pressed + 0.05 * away, pressed + 20.0 * away])
    weights = np.ones(len(model.load_names))
    close(exported("hessian", pressed, weights, (6, 6))[1], model.hessian(pressed, weights), 8)
    assert exported.status(pressed - 10.0 * away) == OUTSIDE
    for distance in (1e3, 1e50, 1e155, 1e300):  # squares of the last two are no numbers
        status, *numbers = exported.all_of(pressed + distance * away)[:5]
        assert status == (OK if distance < 1e100 else OUTSIDE)
        assert status == OUTSIDE or all(np.isfinite(array).all() for array in numbers)
    if scene == "knee":
        assert re.search(r"\d+ rays x \d points", exported.header)
        metres = [0.0005, 0.02723, 0.0001, 0.0, -0.05, -0.3]
        assert exported.status(metres) == OUTSIDE, "the surfaces have passed through each other"
    if scene == "hip":
        for way in (-away[:3], np.array([1.0, 0.0, 0.0])):
            behind = np.array([*(model.scene.geometry["cup_centre"] + 30.0 * way), 0.0, 0.0, 0.0])
            assert -4.0 < model.gaps(behind)[0] < 0.0, "presses the cup from behind, and but a little"
            assert exported.status(behind) == OUTSIDE


def assert_pressures_are_python_s(exported, model, poses):
    """Pressures of poses, the last of them out of contact."""
    count = len(model.pressure_names)
    listed = " ".join(exported.header.replace("*", "").split())
    assert ", ".join(f"{name} [{quantity(name).kind.plain_unit}]" for name in model.pressure_names) in listed
    for pose in poses:
        found = exported("pressures", pose, (count,))
        np.testing.assert_allclose(found, model.pressures(pose)[0], rtol=1e-12, atol=1e-12)  # symmetry gives zeros
    centres = np.array(["cop" in name for name in model.pressure_names])
    assert np.isnan(found[centres]).all()
    assert not found[~centres].any()
    assert np.isnan(exported("pressures", [0.0, np.inf, 0.0, 0.0, 0.0, 0.0], (count,))).all()
