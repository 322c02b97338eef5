"""The C functions by which casadi.external finds a kernel and its derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from casadi_contact.core.compiler import shared_library
from casadi_contact.networks.kernel.source import Kernel, c_text
from casadi_contact.networks.names import UNNAMED, check_name, check_unused, name_of_batch


class _Patterns:
    """Sparsity patterns in C, each declared once."""

    def __init__(self, rows: Mapping[str, int]) -> None:
        self.rows = rows
        self.declarations: dict[str, str] = {}

    def _declare(self, name: str, size: str) -> str:
        self.declarations[name] = f"static casadi_int {name}[{size}];"
        return name

    def dense(self, key: str) -> str:
        return f"dense({self.rows[key]}, {self._declare(f'dense_{key}', '3')})"

    def empty(self, key: str) -> str:
        """An input that is of no use here, without entries."""
        return f"empty({self.rows[key]}, BATCH, {self._declare(f'empty_{key}', '3 + BATCH')})"

    def no_block(self, rows: str, columns: str) -> str:
        name = self._declare(f"empty_{rows}_{columns}", f"3 + {self.rows[columns]} * BATCH")
        return f"empty({self.rows[rows]} * BATCH, {self.rows[columns]} * BATCH, {name})"

    def empty_jacobian(self, key: str) -> str:
        name = self._declare(f"empty_jac_{key}", "3 + 6 * BATCH")
        return f"empty({self.rows[key]} * BATCH, 6 * BATCH, {name})"

    def seconds(self, key: str) -> str:
        name = self._declare(f"second_{key}", f"3 + 6 * BATCH + 36 * {self.rows[key]} * BATCH")
        return f"second_blocks({self.rows[key]}, {name})"

    def no_seconds(self, key: str, columns: str) -> str:
        name = self._declare(f"empty_second_{key}_{columns}", f"3 + {self.rows[columns]} * BATCH")
        return f"empty(6 * {self.rows[key]} * BATCH * BATCH, {self.rows[columns]} * BATCH, {name})"

    def blocks(self, rows: str, columns: str) -> str:
        r, c = self.rows[rows], self.rows[columns]
        return f"block_diagonal({r}, {c}, {self._declare(f'block_{rows}_{columns}', f'PATTERN({r}, {c})')})"


def _function(name: str, inputs: Sequence[str], outputs: Sequence[str], statements: Sequence[str]) -> str:
    """A function as casadi.external wants it, with the sparsity of its inputs and outputs."""
    lines = [
        f"EXPORT casadi_int {name}_n_in(void) {{ return {len(inputs)}; }}",
        f"EXPORT casadi_int {name}_n_out(void) {{ return {len(outputs)}; }}",
    ]
    for side, patterns in (("in", inputs), ("out", outputs)):
        cases = "".join(f"    case {i}: return {pattern};\n" for i, pattern in enumerate(patterns))
        lines.append(
            f"EXPORT const casadi_int *{name}_sparsity_{side}(casadi_int i) {{\n"
            f"  switch (i) {{\n{cases}    default: return 0;\n  }}\n}}"
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


def casadi_interface(functions: Mapping[str, Mapping[str, int]], batch: int = 1) -> str:
    """For every name in functions C functions name, jac_name, adj1_name, jac_adj1_name and jac_jac_name, for poses (6 x
    batch).

    functions: the outputs of each, "loads" and/or "roots" with their numbers of rows. jac_name gives the Jacobian's
    blocks, adj1_name the product of an adjoint with it, and jac_adj1_name, its Jacobian, the Hessian of a Lagrangian:
    all that nlpsol asks. jac_jac_name gives the second derivatives of every output, which a Jacobian of a Jacobian and
    forward sensitivities of an integrator ask for.
    """
    rows = {key: count for outputs in functions.values() for key, count in outputs.items()}
    patterns = _Patterns({"pose": 6, **rows})
    texts = [_functions(name, list(outputs), patterns) for name, outputs in functions.items()]
    header = [f"#define BATCH {batch}", c_text("casadi_interface.h")]
    return "\n".join([*header, *patterns.declarations.values(), "", *texts])


def _functions(name: str, keys: Sequence[str], of: _Patterns) -> str:
    """All of one name."""

    def pair(of: str, first: int, step: int = 1) -> str:
        """The arguments for loads and roots, 0 for what this function does not give."""
        places = {key: f"{of}[{first + step * place}]" for place, key in enumerate(keys)}
        return ", ".join(places.get(key, "0") for key in ("loads", "roots"))

    unused, seeds, n = [of.empty(key) for key in keys], [of.dense(key) for key in keys], len(keys)
    functions = [
        _function(name, [of.dense("pose")], seeds, [f"value_of_all(arg[0], {pair('res', 0)});"]),
        _function(
            f"jac_{name}",
            [of.dense("pose"), *unused],
            [of.blocks(key, "pose") for key in keys],
            [f"jacobian_of_all(arg[0], {pair('res', 0)}, 0);"],
        ),
        _function(
            f"adj1_{name}",
            [of.dense("pose"), *unused, *seeds],
            [of.dense("pose")],
            [f"adjoint_of_all(arg[0], {pair('arg', 1 + n)}, res[0]);"],
        ),
        _function(
            f"jac_adj1_{name}",
            [of.dense("pose"), *unused, *seeds, of.empty("pose")],
            [of.blocks("pose", "pose"), *(of.no_block("pose", k) for k in keys), *(of.blocks("pose", k) for k in keys)],
            [
                f"hessian_of_all(arg[0], {pair('arg', 1 + n)}, res[0]);",
                f"jacobian_of_all(arg[0], {pair('res', 1 + n)}, 1);",
            ],
        ),
        _function(
            f"jac_jac_{name}",
            [of.dense("pose"), *unused, *(of.empty_jacobian(key) for key in keys)],
            [block for key in keys for block in (of.seconds(key), *(of.no_seconds(key, k) for k in keys))],
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


def compiled_function(kernel: Kernel, name: str, outputs: Mapping[str, int], batch: int = 1) -> ca.Function:
    """casadi.Function pose (6 x batch) -> outputs, compiled, with its own first- and second-order derivative functions.

    outputs: "loads" and/or "roots" with their numbers. Raises CompilerError where it cannot be compiled.
    """
    name = name_of_batch(check_name(name), batch)
    source = kernel.source(loads=outputs.get("loads", 0), roots=outputs.get("roots", 0))
    check_unused(name, f"{source}\n{casadi_interface({UNNAMED: outputs}, batch)}")
    library = shared_library(f"{source}\n{casadi_interface({name: outputs}, batch)}")
    return ca.external(name, str(library))
