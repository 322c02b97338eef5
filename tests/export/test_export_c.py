"""Exported C, compiled without warnings, gives the same numbers."""

import re
import subprocess

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact import load_surrogate
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.core.compiler import compiler_command
from casadi_contact.scenes.loading import load_scene
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import THREE, random_poses, random_surrogate, scene_called


def of_three():
    return random_surrogate(scene_called(THREE), "patch", seed=6), random_poses(1)[0]


def cells():
    model = CellFoundation(load_scene("sphere_on_plane"), Cells(2.0, 2.0))
    return model, model.example_pose()


@needs_compiler
@pytest.mark.parametrize("made", [of_three, cells])
def test_code_that_casadi_generates_is_linked_with_the_exported_files(made, tmp_path, monkeypatch):
    """All compiled functions of a model are called by their names there, in one program, with their derivatives."""
    monkeypatch.chdir(tmp_path)  # where Function.generate writes
    (model, at), pose, inputs = made(), ca.MX.sym("pose", 6), ca.MX.sym("inputs", 4)
    name, given = model.exported().name, ca.vertcat(pose, inputs)
    outputs = [
        model.function(name=name, compiled=True)(pose),
        model.root_function(name=f"{name}_root_loads", compiled=True)(pose),
        *model.load_and_root_function(name=f"{name}_loads_and_roots", compiled=True)(pose),
    ]
    if made is cells:
        parameters = ("youngs_modulus", "thickness", "fixed_ty", "fixed_rz")
        outputs.append(model.function(name=name, parameters=parameters)(pose, inputs))
    both = ca.vertcat(*outputs)
    cost = ca.sumsqr(both * np.linspace(1.0, 2.0, both.numel()))
    mine = ca.Function("mine", [pose, inputs], [both, ca.gradient(cost, given), ca.hessian(cost, given)[0]])
    mine.generate("mine.c")
    sources = ["mine.c"]
    for path in cc.export_c(model, tmp_path):
        if path.suffix == ".c" and path.stem in (name, f"{name}_patch_wrenches"):
            sources.append(path.name)
    command = [*compiler_command(), "-O0", "-shared", "-fPIC", "-Wno-psabi", *sources, "-o", "mine.so", "-lm"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    linked = ca.external("mine", str(tmp_path / "mine.so"))
    at = at, [450.0, 6.5, 0.01, 0.002]
    for got, want in zip(linked(*at), mine(*at), strict=True):
        np.testing.assert_allclose(got.full(), want.full(), rtol=1e-9, atol=1e-9 * np.abs(want.full()).max())
        assert want.full().any()


@needs_compiler
@pytest.mark.parametrize("kind", ["surrogate", "foundation"])
def test_code_for_many_poses_does_not_call_the_exported_function_of_one(kind, tmp_path, monkeypatch):
    """Linked with it, it would take the first pose for all: it calls for another name, which no linker finds there."""
    monkeypatch.chdir(tmp_path)
    model = load_surrogate("knee") if kind == "surrogate" else PolarFoundation(load_scene("sphere_on_plane"))
    poses, name = ca.MX.sym("poses", 6, 3), model.exported().name
    loads = model.function(name=name, compiled=True, batch=3)(poses)
    ca.Function("mine", [poses], [loads, ca.jacobian(ca.vec(loads), ca.vec(poses))]).generate("mine.c")
    calls = set(re.findall(rf"\w*{name}\w*(?=\()", (tmp_path / "mine.c").read_text()))
    assert calls == {f"{name}_of_frames", f"jac_{name}_of_frames"}


@needs_compiler
def test_a_function_is_not_named_as_what_its_c_is_made_of(tmp_path):
    surrogate = random_surrogate(load_scene("sphere_on_plane"), "patch")
    of_c = "int main class sin j1 stdin errno size_t linux unix NAN EOF"
    for name in f"{of_c} not-a-c-name example linear dense work_of blocks outside FRAMES".split():
        with pytest.raises(ValueError, match="not usable"):
            cc.export_c(surrogate, tmp_path, name=name)
    assert not list(tmp_path.iterdir())
    for model in (surrogate, cc.foundation("sphere_on_plane")):
        for name in ("blocks", "values_of"):
            with pytest.raises(ValueError, match=f"'{name}' is not usable, C or the C of contact models has it"):
                model.function(name=name, compiled=True)
    assert surrogate.function(name="example", compiled=True).name() == "example"


@pytest.mark.parametrize(
    ("pose", "said"), [([0.5, 27.0], r"shape \(1, 2\), expected \(n, 6\)"), ([np.nan] * 6, r"nan at row 0 \(tx\)")]
)
def test_a_pose_that_c_could_not_hold_is_refused_before_anything_is_written(pose, said, tmp_path):
    surrogate = random_surrogate(load_scene("sphere_on_plane"), "patch")
    with pytest.raises(ValueError, match=said):
        cc.export_c(surrogate, tmp_path, example_pose=pose)
    with pytest.raises(ValueError, match=said):
        cc.export_fmu(surrogate, tmp_path / "ball.fmu", start=pose)
    assert not list(tmp_path.iterdir())
