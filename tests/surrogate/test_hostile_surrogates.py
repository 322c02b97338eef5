"""Surrogate files made to do harm, each with valid digests: refused in one line, and nothing runs."""

import subprocess
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.compiler import compiler_command
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.compiler import needs_compiler
from tests.support.own_contact import SCENE
from tests.support.random_surrogates import random_surrogate
from tests.support.shared_data import resealed


def refused(path, message):
    with pytest.raises(ValueError, match=message) as error:
        load_surrogate(path)
    assert "\n" not in str(error.value)


@needs_compiler
def test_a_patch_name_that_is_code_never_runs_whether_in_a_file_or_in_python(tmp_path):
    """It closes the function it stands in and brings its own, run when the library is loaded."""
    mark, path = tmp_path / "ran", tmp_path / "evil.h5"
    name = (
        "x(void) {} extern int creat(const char *, unsigned); __attribute__((constructor)) void run(void) "
        f'{{ creat("{mark}", 420); }} void y'
    )
    random_surrogate(SCENE, "patch").save(path)
    with resealed(path) as file:
        scene = file["scene"][()].decode().replace("patches.contact]", f"patches.'{name}']")
        assert name in scene
        del file["scene"]
        file["scene"] = scene
        for key in list(file["networks"]):
            file["networks"].move(key, key.replace("contact", name.replace("/", "%")))
    refused(path, "letters")
    surrogate = random_surrogate_of(replace(SCENE, patches=(SCENE.patches[0]._replace(name=name),)))
    for use in (lambda: surrogate.function(compiled=True), lambda: cc.export_c(surrogate, tmp_path / "out")):
        with pytest.raises(ValueError, match="cannot be a name in C"):
            use()
    assert not mark.exists()
    assert not (tmp_path / "out").exists()


def random_surrogate_of(scene):
    plain = random_surrogate(SCENE, "patch")
    names = PatchSurrogate.network_inputs(scene)
    return PatchSurrogate(scene, dict(zip(names, plain.networks.values(), strict=True)))


@needs_compiler
@pytest.mark.parametrize("name", ["x */ int a; /*", "x ??/\n*/ int a; /*", "x\\\n"])
def test_a_scene_name_cannot_leave_the_exported_comment(name, tmp_path):
    surrogate = random_surrogate_of(replace(SCENE, name=name))
    cc.export_c(surrogate, tmp_path, name="ball")
    command = [*compiler_command(), "-std=c99", "-trigraphs", "-Wall", "-Wextra", "-pedantic", "-Werror", "-c"]
    subprocess.run([*command, "ball.c", "-o", "ball.o"], check=True, capture_output=True, cwd=tmp_path)
    first = (tmp_path / "ball.c").read_text().splitlines()[0]
    assert first.startswith("/* ")
    assert first.endswith(". */")
    assert first.count("*/") == 1


def test_weights_that_are_not_finite_and_a_confidence_that_means_nothing_are_refused(saved, tmp_path):
    surrogate, knee = load_surrogate(saved), load_surrogate("knee")
    surrogate.networks["root_med"].weights[1][0, 0] = np.nan
    surrogate.save(saved)
    refused(saved, "network holds NaN or infinity")
    damaged = {"growth": -1.0, "bandwidth": -1.0, "whitening": -1.0, "columns": 9.0, "centres": np.nan, "edge": np.inf}
    for field, damage in damaged.items():
        with pytest.raises(ValueError, match="confidence"):
            replace(knee.confidence, **{field: damage * getattr(knee.confidence, field)})
    knee.confidence.growth[0] = -1.0
    knee.save(tmp_path / "knee.h5")
    refused(tmp_path / "knee.h5", "growth")


@pytest.mark.parametrize(
    "record",
    [
        {"samples": 5},
        {"samples": {"D1": "many"}},
        {"test_errors": {"D1": {"Fy": {"max": 1.0}}}},
        {"coverage": {"D1": None}},
        {"stop_reasons": ["stalled"]},
    ],
)
def test_a_record_may_say_more_than_is_known_and_what_is_known_has_its_form(saved, record):
    surrogate = load_surrogate(saved)
    surrogate.record["found_by"] = ["somebody", {"on": [1, None]}]
    surrogate.save(saved)
    assert "found_by: ['somebody', {'on': [1, None]}]" in str(load_surrogate(saved).info())
    surrogate.record.update(record)
    surrogate.save(saved)
    refused(saved, "its record")
