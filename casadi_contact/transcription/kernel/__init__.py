"""Compiled kernels: one small C file per surrogate, with structured first and second derivatives."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import cache

import casadi as ca

from casadi_contact.transcription.functions import check_name, check_unused
from casadi_contact.transcription.kernel.casadi_interface import UNNAMED, casadi_interface, name_of_batch
from casadi_contact.transcription.kernel.compiler import CompilerError, shared_library
from casadi_contact.transcription.kernel.network_functions import activation_loops
from casadi_contact.transcription.kernel.source import Kernel, c_text

__all__ = [
    "CompilerError",
    "Kernel",
    "compiled_function",
    "sigmoid_source",
    "warn_once",
]


@cache
def warn_once(message: str) -> None:
    """A RuntimeWarning, the first time that this process has something to say."""
    warnings.warn(message, RuntimeWarning, stacklevel=5)


def sigmoid_source(activation: str) -> str:
    """C function sigmoids(repeats, n, z): the kernel's sigmoid loop alone, to measure the rate of this machine."""
    definitions = "".join(f"#define {name} 8\n" for name in ("WIDEST", "WIDTH"))
    text = f"{c_text('core.h')}\n{activation_loops(activation)}"
    loop = f"for (int i = 0; i < repeats; i++) {activation}_0(n, z);"
    return f"{definitions}{text}\nvoid sigmoids(int repeats, int n, double *z) {{ {loop} }}\n"


def compiled_function(kernel: Kernel, name: str, outputs: Mapping[str, int], batch: int = 1) -> ca.Function:
    """casadi.Function pose (6 x batch) -> outputs, compiled, with its own first- and second-order derivative functions.

    outputs: "loads" and/or "roots" with their numbers. Raises CompilerError where it cannot be compiled.
    """
    name = name_of_batch(check_name(name), batch)
    source = kernel.source(loads=outputs.get("loads", 0), roots=outputs.get("roots", 0))
    check_unused(name, f"{source}\n{casadi_interface({UNNAMED: outputs}, batch)}")
    library = shared_library(f"{source}\n{casadi_interface({name: outputs}, batch)}")
    return ca.external(name, str(library))
