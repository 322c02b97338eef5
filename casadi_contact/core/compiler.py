"""Compile C source with the system's compiler into a shared library, once: kept in the user's cache folder.

The file's name is the digest of what it was made from (source, compiler, flags, processor). It is written beside and
then renamed: none is half-written, and two processes may compile the same source at once.

A library is compiled for the instruction set of this processor. ``CASADI_CONTACT_CFLAGS`` replaces that choice: with
``-march=x86-64-v3`` it runs on any processor with AVX2, with ``-march=x86-64-v2`` on any x86-64 since 2009.
"""

import _ctypes
import atexit
import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import platformdirs

from casadi_contact.core.compilation import announce
from casadi_contact.core.files.reading import short
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.interrupts import terminated_as_interrupted
from casadi_contact.core.machine import CFLAGS_VARIABLE, cpuinfo

FLAGS = ("-std=gnu99", "-O3", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
NATIVE = ("-march=native",)
SUFFIX = ".dylib" if sys.platform == "darwin" else ".so"
DATA_FILE = "kernel.bin"
CACHE_VARIABLE = "CASADI_CONTACT_CACHE"


class CompilerError(OSError):
    """There is no C compiler, or it failed."""


def compiler_command() -> list[str]:
    """$CC, or the first of cc, gcc and clang on the path; raises CompilerError if there is none."""
    if wanted := _words_of("CC"):
        if shutil.which(wanted[0]) is None:
            raise CompilerError(f"no C compiler: $CC is {os.environ['CC']!r}, which is not on the path")
        return wanted
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return [found]
    raise CompilerError("no C compiler (cc, gcc, clang or $CC) on the path")


def _words_of(variable: str) -> list[str]:
    text = os.environ.get(variable, "")
    try:
        return shlex.split(text)
    except ValueError as error:
        raise CompilerError(f"${variable} is {text!r}, expected words as in a shell ({error})") from None


def cache_folder() -> Path:
    """$CASADI_CONTACT_CACHE, or the user's cache folder of this system."""
    return Path(os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_path("casadi_contact"))


@cache
def _compiler_version(command: tuple[str, ...]) -> str:
    return run_compiler([*command, "--version"])


@cache
def _processor() -> str:
    """What -march=native depends on."""
    return cpuinfo("model name") + cpuinfo("flags", "Features") or platform.processor() + platform.machine()


def run_compiler(command: list[str], folder: Path | None = None) -> str:
    """What a command prints; raises CompilerError with its first error. Interrupted, it leaves no program running."""
    name = "ziglang" if "ziglang" in command else command[0]  # a module of Python
    in_main = threading.current_thread() is threading.main_thread()
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "process_group": 0}
    try:
        # A compiler's messages name files as they are called, and need not be text in this locale.
        running = subprocess.Popen(command, text=True, errors="replace", cwd=folder, **pipes)
    except OSError as error:
        raise CompilerError(f"{name} failed: {error}") from None
    with terminated_as_interrupted() if in_main else nullcontext(), running:
        try:
            printed, errors = running.communicate()
        except BaseException:
            os.killpg(running.pid, signal.SIGKILL)
            raise
    if running.returncode != 0:
        said = (errors or printed).strip().splitlines() or [f"exit status {running.returncode}"]
        reason = next((line for line in said if "error" in line.lower()), said[0])  # lines before it say where
        raise CompilerError(f"{name} failed: {reason}")
    return printed


def shared_library(source: str, waited_for: str = "", data: bytes = b"", linked: Path | None = None) -> Path:
    """Path of the library compiled from C source, taken from the cache where it is there already. A cache that cannot
    be written is replaced by a folder that is removed when Python ends.

    waited_for: what stderr says is being compiled; silent if left out. data: content of the file DATA_FILE, which the
    source includes (`.incbin`). linked: a library whose functions the source calls. Raises CompilerError without a
    compiler, where it fails, and for a cache that other users can write to or whose disc may not hold programs."""
    command = compiler_command()
    chosen = tuple(_words_of(CFLAGS_VARIABLE)) if CFLAGS_VARIABLE in os.environ else NATIVE
    libraries = ["-lm"] if linked is None else [str(linked)]
    settings = [*command, *FLAGS, *chosen, *libraries, _processor()]
    made_from = "\0".join([source, _compiler_version(tuple(command)), *settings])
    key = hashlib.sha256(made_from.encode() + (b"\0" + data if data else b"")).hexdigest()[:32]
    folder = Path(os.path.realpath(cache_folder()))
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        folder = _process_folder()
    check_private(folder)
    if not (path := folder / f"{key}{SUFFIX}").is_file() and not os.access(folder, os.W_OK):
        path = _process_folder() / path.name
    if path.is_file():
        return path
    if waited_for:
        announce(waited_for, path.parent)
    try:
        _compile(source, data, command, chosen, libraries, path)
        return path
    except CompilerError:
        raise
    except OSError as error:
        raise CompilerError(f"cannot write to the kernel cache {folder}: {error.strerror or error}") from None


def _compile(
    source: str, data: bytes, command: list[str], chosen: tuple[str, ...], libraries: list[str], path: Path
) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".kernel.") as name:
        place, library = Path(name), Path(name, f"kernel{SUFFIX}")
        (place / "kernel.c").write_text(source, "utf-8")
        (place / DATA_FILE).write_bytes(data)
        last = ["-o", str(library), "kernel.c", *libraries]
        try:
            run_compiler([*command, *FLAGS, *chosen, *last], place)
        except CompilerError:
            if chosen != NATIVE:  # what a user asked for is not replaced
                raise
            run_compiler([*command, *FLAGS, *last], place)  # not every compiler knows -march=native
        library.chmod(0o700)
        try:
            _ctypes.dlclose(ctypes.CDLL(str(library))._handle)  # closed, since a file that is open may not be changed
        except OSError as error:
            said = f"the compiled kernel cannot be loaded ({short(str(error))}), expected a compiler for this machine"
            raise CompilerError(f"{said} ($CC) and a disc that may hold programs: set ${CACHE_VARIABLE}") from None
        os.replace(library, path)


def copied_library(library: Path, name: str) -> Path:
    """A copy of a shared library beside it, which a process loads besides the original."""
    path = library.with_name(name)
    if not path.is_file():
        with replacing(path) as beside:
            shutil.copy(library, beside)
    return path


def portable_library(folder: Path, sources: Sequence[str], library: str) -> Path:
    """Compile C files of a folder into a library for any processor of this kind, or as $CASADI_CONTACT_CFLAGS says;
    raises CompilerError without a compiler, or where it fails."""
    run_compiler([*compiler_command(), *FLAGS, *_words_of(CFLAGS_VARIABLE), "-o", library, *sources, "-lm"], folder)
    return folder / library


def check_private(folder: Path) -> None:
    """Raise CompilerError where another user could put a file into the folder, or another folder in its place."""
    if not is_private(folder):
        others = f"belongs to user {folder.stat().st_uid} or can be written by other users, expected your own"
        raise CompilerError(f"the kernel cache {folder} {others}: chmod go-w, or choose another by ${CACHE_VARIABLE}")
    for above in folder.parents if os.name == "posix" else ():
        there = above.stat()
        if there.st_uid not in (0, os.geteuid()) or there.st_mode & (stat.S_IWOTH | stat.S_ISVTX) == stat.S_IWOTH:
            others = f"lies in {above}, where another user can replace it"
            raise CompilerError(f"the kernel cache {folder} {others}: choose another by ${CACHE_VARIABLE}")


def is_private(path: Path) -> bool:
    """Whether a file or folder is this user's, or root's, and nobody else may write to it."""
    there = path.lstat()
    if os.name != "posix":
        return True
    return there.st_uid in (0, os.geteuid()) and not there.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


@cache
def _process_folder() -> Path:
    folder = tempfile.mkdtemp(prefix="casadi_contact-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@cache
def warn_once(message: str) -> None:
    """A RuntimeWarning, the first time that this process has something to say."""
    warnings.warn(message, RuntimeWarning, stacklevel=5)
