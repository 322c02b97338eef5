"""C functions of bundles: the networks of one input after each other, and families of bundles side by side."""

from __future__ import annotations

from collections.abc import Sequence

from casadi_contact.transcription.kernel.network_functions import sides_of
from casadi_contact.transcription.kernel.networks import Bundle


def bundle_functions(bundle: Bundle) -> str:
    """The groups of a bundle one after the other; networks of some of the inputs get these, and theirs are put back."""
    symbol, columns = bundle.symbol, bundle.columns
    k = bundle.inputs if columns is None else len(columns)
    arguments = {
        "value": ("const double *x, double *y", "{x}, y + {m}"),
        "gradient": ("const double *x, double *y, double *g", f"{{x}}, y + {{m}}, {{g}} + {k} * {{m}}"),
        "hessian": (
            "const double *x, const double *c, double *y, double *g, double *h",
            "{x}, c + {m}, y + {m}, {g}, {h}",
        ),
        "batch": ("const double *x, double *y", "{x}, y + {m} * LANES"),
    }
    names = dict(zip("xgh", "xgh" if columns is None else ("of_x", "of_g", "of_h"), strict=True))
    functions = []
    for what, (parameters, call) in arguments.items():
        lines, m = [f"INLINE void {symbol}_{what}({parameters}) {{"], 0
        before, after = _picked(bundle, columns, what) if columns is not None and bundle.groups else ([], [])
        lines += before
        for group in bundle.groups:
            lines.append(f"  {group.shape.symbol}_{what}({group.symbol}, {call.format(m=m, **names)});")
            m += sum(network.outputs for network in group.networks)
        if not bundle.groups:
            unused = [parameter.split("*")[-1] for parameter in parameters.split(", ")]
            lines.append(f"  {', '.join(f'(void){name}' for name in unused)};")
        functions.append("\n".join([*lines, *after, "}"]))
    return "\n\n".join(functions)


def _picked(bundle: Bundle, columns: Sequence[int], what: str) -> tuple[list[str], list[str]]:
    """C before and after the calls of networks that take these columns of x: inputs gathered, derivatives put back."""
    inputs, k, count = bundle.inputs, len(columns), sum(network.outputs for network in bundle.networks.values())
    if what == "batch":
        copies = [
            f"memcpy(of_x + {t} * LANES, x + {c} * LANES, LANES * sizeof(double));" for t, c in enumerate(columns)
        ]
        return [f"  double of_x[{k} * LANES];", *(f"  {copy}" for copy in copies)], []
    before, after = [f"  const double of_x[{k}] = {{{', '.join(f'x[{c}]' for c in columns)}}};"], []
    if what == "gradient":
        before.append(f"  double of_g[{count * k}];")
        after.append(f"  memset(g, 0, {count * inputs} * sizeof(double));")
        put = " ".join(f"g[{inputs} * m + {c}] = of_g[{k} * m + {t}];" for t, c in enumerate(columns))
        after.append(f"  for (int m = 0; m < {count}; m++) {{ {put} }}")
    if what == "hessian":
        before.append(f"  double of_g[{k}] = {{0}}, of_h[{k * k}] = {{0}};")
        for t, c in enumerate(columns):
            after.append(f"  g[{c}] += of_g[{t}];")
            after += [f"  h[{inputs * c + columns[j]}] += of_h[{k * t + j}];" for j in range(t + 1)]
    return before, after


def family_functions(name: str, bundles: Sequence[Bundle]) -> str:
    """NAME_value(count, which, x, y) and NAME_gradient(count, which, x, y, g): those of the bundles that are listed,
    several side by side where all have networks of the same few neurons; x, y and g hold a pointer for each bundle."""
    sides = _sides(bundles)
    functions = []
    if any(sides.values()):
        rows = ", ".join(f"{{{', '.join(group.symbol for group in bundle.groups)}}}" for bundle in bundles)
        groups = len(bundles[0].groups)
        functions.append(f"static const double *const {name}_weights[{len(bundles)}][{groups}] = {{{rows}}};")
    for what, outputs in (("value", "y"), ("gradient", "yg")):
        pointers = "".join(f", double *const *{array}" for array in outputs)
        lines = [f"INLINE void {name}_{what}(int count, const int *which, const double *const *x{pointers}) {{"]
        lines.append("  int k = 0;")
        most = "SLOPES_SIDE_BY_SIDE" if what == "gradient" else "VALUES_SIDE_BY_SIDE"
        for side in sides[what]:
            lines.append(f"  for (; {side} <= {most} && k + {side} <= count; k += {side}) {{")
            lines += [f"    {line}" for line in _together(bundles[0], name, what, outputs, side)]
            lines.append("  }")
        lines += ["  for (; k < count; k++) {", "    const int i = which[k];", "    switch (i) {"]
        of_one = "".join(f", {array}[i]" for array in outputs)
        lines += [f"      case {p}: {b.symbol}_{what}(x[i]{of_one}); break;" for p, b in enumerate(bundles)]
        functions.append("\n".join([*lines, "    }", "  }", "}"]))
    return "\n\n".join(functions) + "\n"


def _sides(bundles: Sequence[Bundle]) -> dict[str, list[int]]:
    """How many of the bundles are evaluated side by side, the most first; none where their networks differ in shape."""
    shapes = {tuple(group.shape for group in bundle.groups) for bundle in bundles}
    if len(shapes) > 1 or any(bundle.columns is not None or not bundle.groups for bundle in bundles):
        return {"value": [], "gradient": []}
    return {
        what: [
            side
            for side in min((sides_of(group.shape, what) for group in bundles[0].groups), key=len)
            if side <= len(bundles)
        ]
        for what in ("value", "gradient")
    }


def _together(bundle: Bundle, name: str, what: str, outputs: str, side: int) -> list[str]:
    """Calls for as many bundles of one kind, from which[k] on, a group of networks after the other."""
    lines, m = [], 0
    for number, group in enumerate(bundle.groups):
        offset = {"x": 0, "y": m, "g": bundle.inputs * m}
        arrays = [(f"{name}_weights", f"[{number}]", "const double"), ("x", "", "const double")]
        arrays += [(array, f" + {offset[array]}" if offset[array] else "", "double") for array in outputs]
        given = [
            f"({kind} *const[]){{{', '.join(f'{array}[which[k + {p}]]{end}' for p in range(side))}}}"
            for array, end, kind in arrays
        ]
        lines.append(f"{group.shape.symbol}_{what}_{side}({', '.join(given)});")
        m += sum(network.outputs for network in group.networks)
    return lines
