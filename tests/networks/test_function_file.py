"""Files of CasADi functions: nothing runs, and nothing crashes, because a file was read."""

import casadi as ca
import pytest

from casadi_contact.core.compiler import shared_library
from casadi_contact.networks.function_file import _seal, load_function, save_function
from casadi_contact.scenes.loading import load_scene
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import random_poses, random_surrogate

X = ca.MX.sym("x")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("function") / "ball.casadi"
    save_function(random_surrogate(load_scene("sphere_on_plane"), "patch").function(), path)
    return path


def refused(path, message):
    with pytest.raises(ValueError, match=message) as error:
        load_function(path)
    assert "\n" not in str(error.value)


def test_casadi_alone_reads_a_saved_function_too(saved):
    pose = random_poses(1)[0]
    assert ca.Function.load(str(saved))(pose).full().tolist() == load_function(saved)(pose).full().tolist()


def test_missing_and_foreign_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load_function(tmp_path / "none.casadi")
    foreign = tmp_path / "foreign.casadi"
    foreign.write_text("not a function")
    refused(foreign, "was not written by save_function")
    with pytest.raises(ValueError, match="not a CasADi function"):
        load_function(foreign, allow_external=True)
    foreign.write_bytes(b"not a function" + _seal(b"not a function"))
    refused(foreign, "is not a CasADi function")
    other = ca.StringSerializer({"debug": True})
    other.pack(X)
    content = other.encode().encode()
    foreign.write_bytes(content + _seal(content))
    refused(foreign, "is not a CasADi function")
    with pytest.raises(OSError, match="foreign"):
        save_function(ca.Function("f", [X], [1.0]), foreign / "file_as_folder.casadi")


def test_a_cut_or_changed_file_is_refused_before_casadi_sees_it(saved, tmp_path):
    whole, damaged = saved.read_bytes(), tmp_path / "damaged.casadi"
    for size in (0, 5, len(whole) // 2, len(whole) - 1):
        damaged.write_bytes(whole[:size])
        refused(damaged, "not written by save_function|is damaged")
    for place in (40, len(whole) // 3, len(whole) - 10):
        damaged.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        refused(damaged, "is damaged")


@needs_compiler
def test_a_function_that_names_a_library_is_refused_and_its_library_never_loaded(tmp_path):
    mark, path = tmp_path / "ran", tmp_path / "evil.casadi"
    source = (
        "#include <stdio.h>\n#include <stdlib.h>\n"
        f'__attribute__((constructor)) static void ran(void) {{ if (getenv("ARMED")) fclose(fopen("{mark}", "w")); }}\n'
        "double f_x; int f(const double **a, double **r, long long *i, double *w, int m) { return 0; }\n"
    )
    external = ca.external("f", str(shared_library(source)))
    external.save(str(path), {"debug": True})
    path.write_bytes(path.read_bytes() + _seal(path.read_bytes()))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARMED", "1")
        refused(path, "may run foreign code")
    assert not mark.exists()
    assert load_function(path, allow_external=True).class_name() == "External"


def test_functions_that_compile_or_load_plug_ins_are_refused(tmp_path):
    path = tmp_path / "it.casadi"
    matrix = ca.MX.sym("matrix", 2, 2)
    solver = ca.rootfinder("solver", "newton", {"x": X, "g": X - 1.0})
    for function in (
        ca.Function("f", [X], [2.0 * X], {"jit": True, "compiler": "shell"}),
        ca.interpolant("table", "linear", [[0.0, 1.0]], [1.0, 2.0]),
        ca.Function("f", [X], [solver(X, [])]),
        ca.Function("f", [matrix], [ca.solve(matrix, ca.vertcat(1.0, 2.0), "lapackqr")]),
    ):
        save_function(function, path)
        refused(path, "allow_external=True")


def test_a_forged_digest_does_not_open_a_file_without_field_names(tmp_path):
    path = tmp_path / "plain.casadi"
    ca.Function("f", [X], [2.0 * X]).save(str(path))
    content = path.read_bytes()
    refused(path, "was not written by save_function")
    path.write_bytes(content + _seal(content))
    refused(path, "lacks the names of its fields")
    assert load_function(path, allow_external=True)(3.0) == 6.0


@needs_compiler
def test_a_compiled_function_is_not_written_since_no_other_computer_could_load_it(tmp_path):
    """Neither alone nor inside of another; what lies at the path stays."""
    path = tmp_path / "kernel.casadi"
    path.write_text("before")
    kernel = random_surrogate(load_scene("sphere_on_plane"), "patch").function(compiled=True)
    pose = ca.MX.sym("pose", 6)
    for function in (kernel, ca.Function("within", [pose], [2.0 * kernel(pose)])):
        with pytest.raises(ValueError, match=r"holds a compiled kernel .* function\(compiled=False\)"):
            save_function(function, path)
    assert path.read_text() == "before"
