"""Surrogate files made to do harm, each with valid digests: refused in one line, and nothing runs."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.surrogate.file import _read_content, content_digest
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.compiler import needs_compiler
from tests.support.own_contact import SCENE
from tests.support.random_surrogates import random_surrogate
from tests.support.shared_data import resealed


def code_that_marks(mark):
    """A patch name that closes the function it stands in and brings its own, run when the library is loaded."""
    return (
        "x(void) {} extern int creat(const char *, unsigned); __attribute__((constructor)) void run(void) "
        f'{{ creat("{mark}", 420); }} void y'
    )


def forged(path, change):
    """The file changed, with both of its digests made right again."""
    with resealed(path) as file:
        change(file)
        file.attrs["digest"] = content_digest(*_read_content(file))


def refused(path, message):
    with pytest.raises(ValueError, match=message) as error:
        load_surrogate(path)
    assert "\n" not in str(error.value)


@needs_compiler
@pytest.mark.parametrize("use", ["function", "export"])
def test_a_patch_name_that_is_code_never_runs(use, tmp_path):
    mark, path = tmp_path / "ran", tmp_path / "evil.h5"
    random_surrogate(SCENE, "patch").save(path)
    name = code_that_marks(mark)

    def rename(file):
        scene = file["scene"][()].decode().replace("contact = {", f"'''{name}''' = {{")
        scene = scene.replace("[geometry.patches.contact]", f"[geometry.patches.'''{name}''']")
        assert name in scene
        del file["scene"]
        file["scene"] = scene
        for key in list(file["networks"]):
            file["networks"].move(key, key.replace("contact", name.replace("/", "%")))

    forged(path, rename)

    def run():
        surrogate = load_surrogate(path)
        surrogate.function(compiled=True) if use == "function" else cc.export_c(surrogate, tmp_path / "out")

    with pytest.raises(ValueError) as error:
        run()
    assert "\n" not in str(error.value)
    assert not mark.exists()


@needs_compiler
def test_the_same_name_is_refused_where_c_is_written_however_it_came_there(tmp_path):
    mark = tmp_path / "ran"
    part = SCENE.parts[0]
    evil = replace(SCENE, parts=(replace(part, name=code_that_marks(mark)),))
    surrogate = random_surrogate_of(evil)
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
    import subprocess

    from casadi_contact.core.compiler import compiler_command

    surrogate = random_surrogate_of(replace(SCENE, name=name))
    cc.export_c(surrogate, tmp_path, name="ball")
    command = [*compiler_command(), "-std=c99", "-trigraphs", "-Wall", "-Wextra", "-pedantic", "-Werror", "-c"]
    subprocess.run([*command, "ball.c", "-o", "ball.o"], check=True, capture_output=True, cwd=tmp_path)
    first = (tmp_path / "ball.c").read_text().splitlines()[0]
    assert first.startswith("/* ")
    assert first.endswith(". */")
    assert first.count("*/") == 1


def test_weights_that_are_not_finite_are_refused(saved):
    surrogate = load_surrogate(saved)
    surrogate.networks["root_med"].weights[1][0, 0] = np.nan
    surrogate.save(saved)
    refused(saved, "network holds NaN or infinity")


@pytest.mark.parametrize(
    ("field", "damage"),
    [
        ("growth", -1.0),
        ("bandwidth", -1.0),
        ("whitening", -1.0),
        ("columns", 9.0),
        ("centres", np.nan),
        ("edge", np.inf),
    ],
)
def test_a_confidence_that_means_nothing_is_refused(tmp_path, field, damage):
    surrogate = load_surrogate("knee")
    with pytest.raises(ValueError, match="confidence"):
        replace(surrogate.confidence, **{field: damage * getattr(surrogate.confidence, field)})
    surrogate.confidence.growth[0] = -1.0
    surrogate.save(tmp_path / "knee.h5")
    refused(tmp_path / "knee.h5", "growth")


def test_a_record_may_say_more_than_is_known(saved):
    surrogate = load_surrogate(saved)
    more = {**surrogate.record, "found_by": ["somebody", {"on": [1, None]}]}
    type(surrogate)(surrogate.scene, surrogate.networks, more, surrogate.confidence).save(saved)
    assert "found_by: ['somebody', {'on': [1, None]}]" in str(load_surrogate(saved).info())
