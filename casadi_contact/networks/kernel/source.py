"""A kernel's C in one file without dependencies, with what casadi.external finds it and its derivatives by."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from string import Template

import casadi as ca
import numpy as np

from casadi_contact.core.compiler import copied_library, shared_library
from casadi_contact.networks.kernel.network_functions import bundle_functions, network_functions
from casadi_contact.networks.kernel.networks import WIDTH, Bundle
from casadi_contact.networks.names import DEFAULT_NAMES, check_name, check_unused, name_of_batch


def c_text(name: str, package: str = f"{__package__}.c") -> str:
    """A C file that lies in a package: the core's own, or a structure's template."""
    return resources.files(package).joinpath(name).read_text("utf-8")


@dataclass(frozen=True)
class Kernel:
    """Networks, and C code that calls them and defines three functions for LOADS loads and ROOTS root loads:

    kernel_value(pose, loads, roots), kernel_jacobian(pose, loads, roots, loads_jacobian, roots_jacobian),
    kernel_hessian(pose, loads_weight, roots_weight, hessian): of the weighted sum, 6 x 6 in full.
    Loads or roots that are 0 are not computed.
    """

    bundles: Sequence[Bundle]
    code: str

    def source(self, *, loads: int, roots: int, beside: Kernel | None = None) -> str:
        """C99 up to guarded_value, values_of, array_jacobians and their like: NaN where a pose is not finite.

        beside: another whose networks and code come after it, with other names.
        """
        bundles = [*self.bundles, *(beside.bundles if beside else ())]
        widest = max(group.shape.widest for bundle in bundles for group in bundle.groups)
        sizes = {"LOADS": loads, "ROOTS": roots, "WIDEST": widest, "WIDTH": WIDTH}
        definitions = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
        networks = "\n\n".join([network_functions(bundles), *map(bundle_functions, bundles)])
        head = [definitions, "", c_text("core.h")]
        return "\n".join([*head, networks, "", self.code, guards(), beside.code if beside else ""])


def guards(before: str = "", loads: str = "LOADS", roots: str = "ROOTS", inputs: str = "6") -> str:
    """C of ``guarded_value`` and its like of a kernel, whose functions' names begin with `before`, of some inputs."""
    return Template(c_text("guards.h")).substitute(before=before, loads=loads, roots=roots, inputs=inputs)


def c_of_functions(functions: Sequence[ca.Function], kind: str = "FUNCTION") -> str:
    """C that CasADi writes of functions of SX: ``kind int name(given, found, 0, 0, 0)``, two arrays of pointers."""
    generator = ca.CodeGenerator("written")
    for function in functions:
        generator.add(function)
    return f"#define CASADI_SYMBOL_EXPORT {kind}\n{generator.dump()}"


@dataclass(frozen=True)
class ExportedModel:
    """C of a contact model, and what a header must say of it (see the room `export`).

    name: default name of files and functions, unlike that of any other model.
    source: C99 up to guarded_value and its like, for these loads and the root loads of all patches;
    confidence_guarded_value where it is calibrated; outside(pose), which is 0 for a pose that the model is made for, as
    made_for says in words. pressure_names: where there are any, source defines pressure_guarded_value for them.
    vectors: source needs the vectors of GCC and clang. data: what the source includes as the file DATA_FILE of the
    folder in which it is compiled. wrench_source: C of a kernel whose loads are the wrenches of all patches, for CasADi
    functions with parameters; none where the model has none of these.
    """

    name: str
    source: str
    load_names: Sequence[str]
    patch_names: Sequence[str]
    calibrated: bool
    made_for: str
    reference_load: float
    description: str
    vectors: bool = False
    data: bytes = b""
    pressure_names: Sequence[str] = ()
    wrench_source: str = ""


def table(name: str, numbers: np.ndarray) -> str:
    """Numbers as a C array of their own shape: of int or double."""
    kind = "int" if numbers.dtype.kind == "i" else "double"
    sizes = "".join(f"[{size}]" for size in numbers.shape)
    return f"static const {kind} {name}{sizes} = {_braces(numbers)};"


def _braces(table: np.ndarray) -> str:
    if table.ndim > 1:
        return "{" + ",\n  ".join(map(_braces, table)) + "}"
    return "{" + ", ".join("NAN" if value != value else repr(value) for value in table.tolist()) + "}"


# --- the interface of casadi.external


Pattern = tuple[str, *tuple[int | str, ...]]  # a function of casadi_interface.h, and its numbers


def _function(name: str, inputs: Sequence[Pattern], outputs: Sequence[Pattern], statements: Sequence[str]) -> str:
    """A function as casadi.external wants it, with the sparsity of its inputs and outputs."""
    lines = [
        f"EXPORT casadi_int {name}_n_in(void) {{ return {len(inputs)}; }}",
        f"EXPORT casadi_int {name}_n_out(void) {{ return {len(outputs)}; }}",
    ]
    for side, patterns in (("in", inputs), ("out", outputs)):
        calls = (
            f"{function}({', '.join(map(str, numbers))}, kept + {i})" for i, (function, *numbers) in enumerate(patterns)
        )
        cases = "".join(f"    case {i}: return {call};\n" for i, call in enumerate(calls))
        lines.append(
            f"EXPORT const casadi_int *{name}_sparsity_{side}(casadi_int i) {{\n"
            f"  static casadi_int *kept[{len(patterns)}];\n  switch (i) {{\n{cases}    default: return 0;\n  }}\n}}"
        )
    lines.append(
        f"EXPORT int {name}_work(casadi_int *sz_arg, casadi_int *sz_res, casadi_int *sz_iw, casadi_int *sz_w) {{\n"
        f"  return work_of({len(inputs)}, {len(outputs)}, sz_arg, sz_res, sz_iw, sz_w);\n}}"
    )
    body = "".join(f"  {statement}\n" for statement in statements)
    lines.append(
        f"EXPORT int {name}(const double **arg, double **res, casadi_int *iw, double *w, int mem) {{\n"
        f"{body}  (void)iw, (void)w, (void)mem;\n  return 0;\n}}\n"
    )
    return "\n".join(lines)


def casadi_interface(functions: Mapping[str, Mapping[str, int]], kernel: Sequence[str] = ("loads", "roots")) -> str:
    """For every name in functions C functions name, jac_name, adj1_name, jac_adj1_name, jac_jac_name of 6 x FRAMES.

    functions: of each some of the kernel's two outputs, with their numbers of rows. jac_name gives the Jacobian's
    blocks, adj1_name the product of an adjoint with it, and jac_adj1_name, its Jacobian, the Hessian of a Lagrangian:
    all that nlpsol asks. jac_jac_name gives the second derivatives of every output, which a Jacobian of a Jacobian and
    forward sensitivities of an integrator ask for.
    """
    texts = [_functions(name, outputs, kernel) for name, outputs in functions.items()]
    return "\n".join([c_text("casadi_interface.h"), *texts])


def _functions(name: str, outputs: Mapping[str, int], kernel: Sequence[str]) -> str:
    """All of one name."""
    keys, sizes, n = list(outputs), list(outputs.values()), len(outputs)

    def pair(of: str, first: int, step: int = 1) -> str:
        """The arguments for loads and roots, 0 for what this function does not give."""
        places = {key: f"{of}[{first + step * place}]" for place, key in enumerate(keys)}
        return ", ".join(places.get(key, "0") for key in kernel)

    of_pose: Pattern = ("dense", "VARIABLES")
    unused: list[Pattern] = [("empty", size, "FRAMES") for size in sizes]
    seeds: list[Pattern] = [("dense", size) for size in sizes]

    def by_unused(rows: str, frames: str = "FRAMES * FRAMES") -> list[Pattern]:
        """Derivatives of so many rows by the inputs that are of no use."""
        return [("empty", f"{rows} * {frames}", f"{size} * FRAMES") for size in sizes]

    functions = [
        _function(name, [of_pose], seeds, [f"values_of(FRAMES, arg[0], {pair('res', 0)});"]),
        _function(
            f"jac_{name}",
            [of_pose, *unused],
            [("blocks", size, "VARIABLES") for size in sizes],
            [f"jacobian_of_all(arg[0], {pair('res', 0)}, 0);"],
        ),
        _function(
            f"adj1_{name}",
            [of_pose, *unused, *seeds],
            [of_pose],
            [f"adjoint_of_all(arg[0], {pair('arg', 1 + n)}, res[0]);"],
        ),
        _function(
            f"jac_adj1_{name}",
            [of_pose, *unused, *seeds, ("empty", "VARIABLES", "FRAMES")],
            [
                ("blocks", "VARIABLES", "VARIABLES"),
                *by_unused("VARIABLES", "FRAMES"),
                *(("blocks", "VARIABLES", size) for size in sizes),
            ],
            [
                f"hessian_of_all(arg[0], {pair('arg', 1 + n)}, res[0]);",
                f"jacobian_of_all(arg[0], {pair('res', 1 + n)}, 1);",
            ],
        ),
        _function(
            f"jac_jac_{name}",
            [of_pose, *unused, *(("empty", f"{size} * FRAMES", "VARIABLES * FRAMES") for size in sizes)],
            [block for size in sizes for block in (("second_blocks", size), *by_unused(f"VARIABLES * {size}"))],
            [f"seconds_of_all(arg[0], {pair('res', 0, 1 + n)});"],
        ),
    ]
    names = " : ".join(f'i == {i} ? "{key}"' for i, key in enumerate(keys))
    return "\n".join(
        [
            f'EXPORT const char *{name}_name_in(casadi_int i) {{ return i == 0 ? "pose" : 0; }}',
            f"EXPORT const char *{name}_name_out(casadi_int i) {{ return {names} : 0; }}",
            *functions,
        ]
    )


@cache
def _stop_generated_code() -> None:
    """Code that CasADi generates calls an external function by its name alone. Where CasADi compiles it itself
    (``jit``) no library has that name, which would end Python: let the default names be there, and fail."""
    message = "contact functions cannot be called under jit: export the model as C, or take compiled=False\\n"
    symbols = [f"{order}{name}" for name in DEFAULT_NAMES for order in ("", "jac_", "adj1_", "jac_adj1_", "jac_jac_")]
    lines = [f'int {symbol}(void) {{ fputs("{message}", stderr); return 1; }}' for symbol in symbols]
    ctypes.CDLL(str(shared_library("\n".join(["#include <stdio.h>", *lines]))), mode=ctypes.RTLD_GLOBAL)


def external_function(
    library: Path,
    name: str,
    sizes: Mapping[str, int],
    outputs: Sequence[str],
    frames: int = 1,
    before: str = "",
    inputs: int = 6,
) -> ca.Function:
    """casadi.Function pose (inputs x frames) -> outputs of a kernel's library, with its first and second derivatives.

    sizes: numbers of the kernel's two outputs, "loads" and "roots" or what stands for them in a kernel whose functions'
    names begin with `before`; outputs: some of them. A small library of its own, which every number of frames shares,
    tells CasADi of them. Raises CompilerError where it cannot be compiled.
    """
    name = name_of_batch(check_name(name), frames)
    check_unused(name, f"{c_text('frames.h')}\n{casadi_interface({})}")
    called = ("guarded_value", "guarded_jacobian", "guarded_hessian", "values_of") if before else ()
    renamed = [f"#define {function} {before}{function}" for function in called]
    numbers = [f"#define {key} {size}" for key, size in zip(("LOADS", "ROOTS"), sizes.values(), strict=True)]
    interface = casadi_interface({name: {key: sizes[key] for key in outputs}}, list(sizes))
    renamed.append(f"#define VARIABLES {inputs}")
    beside = shared_library("\n".join([*renamed, c_text("frames.h"), *numbers, interface]), linked=library)
    _stop_generated_code()
    return ca.external(name, str(beside if frames == 1 else copied_library(beside, f"x{frames}-{beside.name}")))
