"""The cache of compiled kernels: made once, safe against races, and never in the way."""

import ctypes
import os
import shlex
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

from casadi_contact.core import compiler
from casadi_contact.core.compiler import warn_once
from casadi_contact.scenes.loading import load_scene
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import random_poses, random_surrogate

SOURCE = "int answer(void) { return 42; }\n"
pytestmark = needs_compiler


@pytest.fixture
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "new" / "home" / "cache"  # nothing of it is there yet
    monkeypatch.setenv(compiler.CACHE_VARIABLE, str(folder))
    return folder


@pytest.fixture
def surrogate():
    return random_surrogate(load_scene("sphere_on_plane"), "patch")


def test_an_environment_variable_chooses_the_instruction_set_and_each_choice_is_kept(cache, monkeypatch):
    """The compiler names in its macros what it was asked for; the cache tells libraries apart by it."""
    source = "#ifndef WANTED\n#define WANTED 0\n#endif\nint answer(void) { return WANTED; }"
    answers, made = {}, {}
    for flags in (None, "", "-DWANTED=1", "-DWANTED=2 -O1"):
        monkeypatch.delenv(compiler.CFLAGS_VARIABLE, raising=False)
        if flags is not None:
            monkeypatch.setenv(compiler.CFLAGS_VARIABLE, flags)
        library = compiler.shared_library(source)
        made[library] = library.stat().st_mtime_ns
        assert compiler.shared_library(source) == library
        answers[library] = ctypes.CDLL(str(library)).answer()
    assert list(answers.values()) == [0, 0, 1, 2]
    assert made == {path: path.stat().st_mtime_ns for path in cache.iterdir()}, "each is compiled once"
    monkeypatch.setenv(compiler.CFLAGS_VARIABLE, "-march=no-such-processor")
    with pytest.raises(compiler.CompilerError, match="failed"):
        compiler.shared_library(SOURCE)


def test_processes_that_compile_at_once_all_get_a_whole_library(cache):
    code = f"from casadi_contact.core.compiler import shared_library; print(shared_library({SOURCE!r}))"
    command = [sys.executable, "-c", code]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ) for _ in range(3)]
    (library,) = {process.communicate()[0].strip() for process in processes}
    assert all(process.returncode == 0 for process in processes)
    assert ctypes.CDLL(library).answer() == 42
    assert not [path for path in cache.iterdir() if path.name.startswith(".")]


def test_a_cache_that_cannot_be_written_is_not_needed(tmp_path, monkeypatch, surrogate):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv(compiler.CACHE_VARIABLE, str(blocked / "cache"))
    function = surrogate.function(compiled=True)
    assert function.class_name() == "External"
    np.testing.assert_allclose(function(random_poses(1)[0]).full().ravel(), surrogate(random_poses(1))[0], rtol=1e-12)


@pytest.mark.parametrize("cc", ["no-such-compiler", "false"])
def test_without_a_working_compiler_one_warning_and_the_same_results(cache, monkeypatch, surrogate, cc):
    monkeypatch.setenv("CC", cc)
    warn_once.cache_clear()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        functions = [surrogate.function(compiled=True) for _ in range(3)]
        batch = surrogate.function(compiled=True, batch=5)
    assert [w.category for w in told] == [RuntimeWarning]
    assert "CasADi graph" in str(told[0].message)
    poses = random_poses(5)
    for function in functions:
        assert function.class_name() != "External"
        np.testing.assert_allclose(function(poses[0]).full().ravel(), surrogate(poses)[0], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(batch(poses.T).full().T, surrogate(poses), rtol=1e-12, atol=1e-9)


@pytest.mark.skipif(os.name != "posix", reason="needs a shell")
def test_a_library_for_another_machine_is_one_warning_and_the_same_results(cache, tmp_path, monkeypatch, surrogate):
    """A cross compiler's library cannot be loaded, nor can any from a disc that is mounted without programs."""
    crossed = tmp_path / "crossed"  # compiles, then names another machine in byte 18 of the library's header
    crossed.write_text(
        f'#!/bin/sh\n{shlex.join(compiler.compiler_command())} "$@" || exit\n'
        'for word; do test "$last" = -o && printf "\\000" | dd of="$word" bs=1 seek=18 conv=notrunc 2>&-; '
        "last=$word; done; exit 0\n"
    )
    crossed.chmod(0o700)
    monkeypatch.setenv("CC", str(crossed))
    warn_once.cache_clear()
    with pytest.warns(RuntimeWarning, match=r"cannot be loaded .*expected a compiler for this machine") as told:
        function = surrogate.function(compiled=True)
    assert "\n" not in str(told[0].message)
    assert not list(cache.iterdir()), "what cannot be loaded is not kept"
    pose = random_poses(1)[0]
    np.testing.assert_allclose(function(pose).full().ravel(), surrogate(pose[None])[0], rtol=1e-12, atol=1e-9)


def refused(message):
    """No library comes out of the cache as it is, and the reason is one line."""
    with pytest.raises(compiler.CompilerError, match=message) as error:
        compiler.shared_library(SOURCE)
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only the superuser can give files away")
def test_a_cache_of_another_user_is_refused(cache):
    compiler.shared_library(SOURCE)
    os.chown(cache, 65534, 65534)
    refused("belongs to user 65534")
    os.chown(cache, 0, 0)
    os.chown(cache.parent, 65534, 65534)
    refused("where another user can replace it")


@pytest.mark.skipif(os.name != "posix", reason="mode bits are POSIX")
def test_a_cache_that_others_can_write_is_refused(cache):
    cache.mkdir(parents=True)
    cache.chmod(0o1777)
    refused("can be written by other users")
    cache.chmod(0o755)
    cache.parent.chmod(0o777)
    refused("where another user can replace it")
    cache.parent.chmod(0o1777)  # sticky, like /tmp: only the owner can rename
    assert compiler.shared_library(SOURCE).stat().st_mode & 0o077 == 0


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")
def test_a_terminated_program_leaves_no_compiler_running(cache, tmp_path):
    slow = tmp_path / "slow"
    slow.write_text(f'#!/bin/sh\ntest "$1" = --version && exit\nsleep 60 & echo $! > {tmp_path}/pid; wait\n')
    slow.chmod(0o700)
    code = f"from casadi_contact.core.compiler import shared_library; shared_library({SOURCE!r})"
    program = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "CC": str(slow)}, stderr=subprocess.PIPE
    )
    while not (tmp_path / "pid").exists() or not (pid := (tmp_path / "pid").read_text().strip()):
        assert program.poll() is None
        time.sleep(0.05)
    program.terminate()
    program.communicate()
    with pytest.raises(ProcessLookupError):
        ask_for_seconds(int(pid), 10)


def ask_for_seconds(pid, seconds):
    """A killed process is gone as soon as its new parent has heard of it."""
    for _ in range(20 * seconds):
        os.kill(pid, 0)
        time.sleep(0.05)
