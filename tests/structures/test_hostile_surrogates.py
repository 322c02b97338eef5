"""Surrogate files made to do harm, each with valid digests: refused in one line, and nothing runs."""

from dataclasses import fields, replace

import h5py
import numpy as np
import pytest

from casadi_contact.files import hdf5_copy, open_hdf5
from casadi_contact.files.hdf5 import sealed
from casadi_contact.structures import PatchSurrogate, load_surrogate
from casadi_contact.structures.file import _digest, _read_content
from casadi_contact.structures.trust import Trust
from tests.support.compiler import needs_compiler
from tests.support.hdf5_files import resealed, unsealed
from tests.support.own_contact import SCENE
from tests.support.random_surrogates import random_surrogate


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
        file.attrs["digest"] = _digest(*_read_content(file))


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
        surrogate.function(compiled=True) if use == "function" else surrogate.export_c(tmp_path / "out")

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
    for use in (lambda: surrogate.function(compiled=True), lambda: surrogate.export_c(tmp_path / "out")):
        with pytest.raises(ValueError, match="cannot be a name in C"):
            use()
    assert not mark.exists()
    assert not (tmp_path / "out").exists()


def random_surrogate_of(scene):
    plain = random_surrogate(SCENE, "patch")
    names = PatchSurrogate.network_inputs(scene)
    return PatchSurrogate(scene, dict(zip(names, plain.networks.values(), strict=True)))


@needs_compiler
@pytest.mark.parametrize("name", ["x **// int a;", "x */ int a; /*", "x ??/\n*/ int a; /*", "x\\\n", "x\n#error"])
def test_a_scene_name_cannot_leave_the_exported_comment(name, tmp_path):
    import subprocess

    from casadi_contact.transcription.kernel.compiler import compiler_command

    surrogate = random_surrogate_of(replace(SCENE, name=name))
    surrogate.export_c(tmp_path, name="ball")
    command = [*compiler_command(), "-std=c99", "-trigraphs", "-Wall", "-Wextra", "-pedantic", "-Werror", "-c"]
    subprocess.run([*command, "ball.c", "-o", "ball.o"], check=True, capture_output=True, cwd=tmp_path)
    first = (tmp_path / "ball.c").read_text().splitlines()[0]
    assert first.startswith("/* ")
    assert first.endswith(". */")
    assert first.count("*/") == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused(saved, bad):
    surrogate = load_surrogate(saved)
    surrogate.networks["root_med"].weights[1][0, 0] = bad
    surrogate.save(saved)
    refused(saved, "network holds NaN or infinity")


def test_trust_that_promises_less_than_nothing_is_refused(tmp_path):
    surrogate = load_surrogate("knee")
    trust = surrogate.trust
    for name in ("shares", "levels", "usual_loads"):
        with pytest.raises(ValueError, match=f"{name} holds a negative number"):
            replace(trust, **{name: -getattr(trust, name)})
    for name in trust.numbers().keys() & {field.name for field in fields(Trust)}:
        with pytest.raises(ValueError, match="not finite"):
            replace(trust, **{name: np.nan * getattr(trust, name)})
    trust.shares[0, 0] = -1.0
    surrogate.save(tmp_path / "knee.h5")
    refused(tmp_path / "knee.h5", "promise errors below zero")


def with_links(file):
    file["networks/extra"] = h5py.SoftLink("/scene")


def with_other_files(file):
    file["networks/extra"] = h5py.ExternalLink("/etc/passwd", "/")


def with_outside_data(file):
    del file["record"]
    file.create_dataset("record", (4096,), "u1", external=[("/etc/passwd", 0, 4096)])


def with_virtual_data(file):
    layout = h5py.VirtualLayout((8,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (8,))
    file.create_virtual_dataset("networks/root_med/weight_9", layout)


def with_eight_terabytes(file):
    file.create_dataset("networks/root_med/weight_9", (1 << 40,), "f8", chunks=(1 << 20,))


def with_a_bomb(file):
    file.create_dataset("networks/root_med/weight_9", (1 << 20,), "f8", chunks=(1 << 20,), compression="gzip")[...] = 0
    file.create_dataset("networks/root_med/bomb", (1 << 28,), "f8", chunks=(1 << 20,), compression="gzip")


def with_a_circle(file):
    file["networks/root_med/again"] = file["networks"]


HARM = {
    with_links: "is a link",
    with_other_files: "is a link",
    with_outside_data: "lies in another file",
    with_virtual_data: "lies in another file",
    with_eight_terabytes: "claims 8796093022208 bytes",
    with_a_bomb: "claims 2147483648 bytes",
    with_a_circle: "there twice",
}


@pytest.mark.parametrize("change", HARM, ids=lambda change: change.__name__)
@pytest.mark.parametrize("digest", [True, False], ids=["sealed", "of an older version"])
def test_what_reaches_outside_a_file_or_beyond_its_size_is_refused(saved, change, digest):
    with resealed(saved) as file:
        change(file)
    if not digest:
        unsealed(saved).replace(saved)
    refused(saved, HARM[change])


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("samples", 3, "record.samples is int, expected a table"),
        ("samples", {"D1": "many"}, r"record.samples.D1 is str, expected a number"),
        ("dropped", {"D1": True}, "record.dropped.D1 is bool"),
        ("pose_range", {"tx": [0.0]}, "record.pose_range.tx is list, expected two numbers"),
        ("valid_share", [], "record.valid_share is list"),
        ("valid_share", 10**400, "record.valid_share is int"),
        ("test_errors", {"D1": {"Fy_med": {"rms": 1.0}}}, "record.test_errors.D1.Fy_med lacks rms or max"),
        ("coverage", {"D1": None}, "record.coverage.D1 is NoneType"),
        ("stop_reasons", {"root_med": ["stalled"]}, "expected text"),
        ("convergence", {"root_med": {"rms": []}}, "record.convergence.root_med lacks gflop or rms"),
        (
            "convergence",
            {"root_med": {"gflop": [1], "rms": 1.0}},
            "record.convergence.root_med.rms is float, expected numbers",
        ),
    ],
)
def test_a_record_of_which_no_table_can_be_made(saved, key, value, said):
    surrogate = load_surrogate(saved)
    changed = type(surrogate)(surrogate.scene, surrogate.networks, {**surrogate.record, key: value}, surrogate.trust)
    changed.save(saved)
    refused(saved, said)


def test_a_record_may_say_more_than_is_known(saved):
    surrogate = load_surrogate(saved)
    more = {**surrogate.record, "found_by": ["somebody", {"on": [1, None]}]}
    type(surrogate)(surrogate.scene, surrogate.networks, more, surrogate.trust).save(saved)
    assert "found_by: ['somebody', {'on': [1, None]}]" in str(load_surrogate(saved).info())


def test_texts_that_all_lie_in_one_place_do_not_multiply(saved):
    """2,000 texts that name one of a megabyte are two gigabytes in memory, of a file of one."""
    with resealed(saved) as file:
        texts = file.create_dataset("texts", (2000,), h5py.string_dtype())
        texts[0], texts[1] = "x" * (1 << 20), "y"
        start = texts.id.get_offset()
    bare = bytearray(unsealed(saved).read_bytes())
    bare[start : start + 16 * 2000] = bare[start : start + 16] * 2000
    saved.write_bytes(sealed(bytes(bare)))
    refused(saved, "is damaged")


def test_a_file_of_an_older_version_without_a_digest_still_loads(saved):
    new = load_surrogate(saved)
    unsealed(saved).replace(saved)
    old = load_surrogate(saved)
    assert list(old.networks) == list(new.networks)
    for name, network in old.networks.items():
        np.testing.assert_array_equal(network.weights[0], new.networks[name].weights[0])


@pytest.mark.parametrize("seal", [bytes, sealed], ids=["without a digest", "with a sound digest"])
def test_a_file_on_which_hdf5_does_not_end_or_crashes_is_one_line(seal, tmp_path, monkeypatch):
    """Bytes that make this version of HDF5 spin may be read well by the next: a stand-in spins for certain."""
    path = tmp_path / "any.h5"
    path.write_bytes(seal(b"\x89HDF\r\n\x1a\n"))
    for body in ("while True: pass", "import os; os.abort()"):
        program = tmp_path / "spin.py"
        program.write_text(f"import resource; resource.setrlimit(resource.RLIMIT_CPU, (1, 2))\n{body}\n")
        monkeypatch.setattr(hdf5_copy, "__file__", str(program))
        with pytest.raises(ValueError, match="HDF5 crashed or did not come to an end"), open_hdf5(path):
            pass


def test_only_what_this_process_wrote_or_the_library_brings_is_parsed_in_this_process(saved, tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5_copy, "__file__", str(tmp_path / "no_such_program.py"))
    load_surrogate(saved)
    load_surrogate("knee")
    with resealed(saved) as file:
        file.attrs["more"] = 1
    refused(saved, "HDF5 crashed")


def test_no_byte_behind_the_seals_first_word_changes_unseen(saved):
    whole = saved.read_bytes()
    assert whole == sealed(whole[512:])
    for place in range(30, len(whole), len(whole) // 40):
        saved.write_bytes(whole[:place] + bytes([whole[place] ^ 16]) + whole[place + 1 :])
        refused(saved, "damaged")
