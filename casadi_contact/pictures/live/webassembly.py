"""Compile C into WebAssembly: by the clang of the package `ziglang`, the same bytes from the same sources."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from casadi_contact.core.compiler import CompilerError
from casadi_contact.core.files.writing import write_bytes

# No -ffast-math, as for every kernel. Vectors of 128 bits run in every browser since 2021 (Safari 2023).
_FLAGS = ("-std=gnu99", "-O2", "-g0", "-s", "-fno-math-errno", "-fno-trapping-math", "-msimd128", "-Wno-psabi")
_TARGET = ("-target", "wasm32-wasi", "-mexec-model=reactor")


def webassembly(files: Mapping[str, str | bytes], exports: Sequence[str]) -> bytes:
    """A WebAssembly module of C sources and what they include (by file name), with the named functions.

    It imports nothing; its memory from ``__heap_base`` on is the caller's. Raises ImportError without the package
    `ziglang`, CompilerError (an OSError) where its compiler refuses.
    """
    if find_spec("ziglang") is None:
        raise ImportError("a page is compiled by ziglang, which is missing: pip install casadi_contact[page]")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            write_bytes(Path(folder) / name, content.encode() if isinstance(content, str) else content)
        sources = [name for name in files if name.endswith(".c")]
        wanted = [f"-Wl,--export={name}" for name in (*exports, "__heap_base")]
        command = [sys.executable, "-m", "ziglang", "cc", *_TARGET, *_FLAGS, "-o", "kernel.wasm", *sources, *wanted]
        found = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", check=False)
        if found.returncode != 0:
            said = found.stderr.strip().splitlines()
            raise CompilerError(f"ziglang failed: {said[0] if said else f'exit status {found.returncode}'}")
        return (Path(folder) / "kernel.wasm").read_bytes()
