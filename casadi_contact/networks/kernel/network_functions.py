"""C functions that evaluate networks: value, gradient, weighted Hessian.

With z_l = W_l a_{l-1} + b_l, a_l = σ(z_l) and r_l = dy/da_l:

    r_{l-1} = W_lᵀ (r_l ∘ σ'(z_l)),   Z_l = dz_l/dx = W_l diag(σ'(z_{l-1})) Z_{l-1},
    d²y/dx² = Σ_l Z_lᵀ diag(r_l ∘ σ''(z_l)) Z_l

Networks of one input share the loops of each layer, so that their
short chains of sums overlap in the processor.
"""

from collections.abc import Sequence

from casadi_contact.networks.activations import ACTIVATIONS
from casadi_contact.networks.kernel.networks import Bundle, Shape, padded

NEURONS_SIDE_BY_SIDE = 64  # of a layer, in networks that are evaluated together: more would leave the registers


def network_functions(bundles: Sequence[Bundle]) -> str:
    """Weights, and SHAPE_value, _gradient, _hessian of every shape, each once."""
    groups = [group for bundle in bundles for group in bundle.groups]
    shapes = dict.fromkeys(group.shape for group in groups)
    loops = [activation_loops(name) for name in dict.fromkeys(shape.activation for shape in shapes)]
    of_shapes = ["\n".join(part(shape)) for shape in shapes for part in (_value, _gradient, _hessian)]
    return "\n\n".join([*(group.declaration() for group in groups), *loops, *of_shapes])


def activation_loops(name: str) -> str:
    """NAME_0(n, a), NAME_1(n, a, d), NAME_2(n, a, d, e): a = σ(a) in place, d = σ', e = σ''.

    The compiler drops what a loop does not store.
    """
    activation = ACTIVATIONS[name]
    kind, step, stored = ("Vector", "VECTOR", "Stored") if activation.c_type == "Vector" else ("double", "1", "double")
    body = activation.c.replace("\n", "\n    ")
    results = dict(zip("ade", ("value", "slope", "curvature"), strict=True))
    functions = []
    for order in range(3):
        arrays = "ade"[: order + 1]
        parameters = ", ".join(f"double *{array}" for array in arrays)
        functions.append(
            f"INLINE void {name}_{order}(int n, {parameters}) {{\n"
            f"  for (int i = 0; i < n; i += {step}) {{\n"
            f"    {kind} value, slope, curvature;\n    const {kind} z = *(const {stored} *)(a + i);\n    {body}\n    "
            + " ".join(f"*({stored} *)({array} + i) = {results[array]};" for array in arrays)
            + "\n    (void)slope, (void)curvature;\n  }\n}"
        )
    return "\n\n".join(functions)


def paired(shape: Shape) -> bool:
    """Whether networks of a shape may be evaluated in pairs."""
    return 2 * shape.widest <= NEURONS_SIDE_BY_SIDE


def _each(shape: Shape, statement: str) -> str:
    return f"for (int m = 0; m < {shape.count}; m++) {statement}"


def _weights(shape: Shape, layer: int, at: str = "") -> str:
    """Weights of network m in a layer after the first."""
    return f"w{at} + {shape.layer(layer)} + m * {shape.slab(layer)}"


def _first_row(shape: Shape, at: str = "") -> str:
    """Weights of input t in the first layer of all networks: also d(first layer)/dx_t."""
    return f"w{at} + {shape.layer(0)} + (t + 1) * {shape.stacked[0]}"


def _of(shape: Shape, layer: int, array: str) -> str:
    """The part of network m in an array of a whole layer."""
    return f"{array} + m * {shape.rows[layer]}"


def _arrays(shape: Shape, names: str, side: str = "") -> str:
    """Declared: numbers of each layer's neurons, and of the last layer's outputs where there are several."""
    declared = [f"{name}{side}[{len(shape.hidden)}][WIDEST]" for name in names]
    if shape.outputs > 1:
        declared.append(f"z{side}[{padded(shape.outputs)}]")
    return ", ".join([f"offset{side}[{shape.inputs}]", *declared])


def _forward(shape: Shape, order: int, at: str = "") -> list[str]:
    """Fill a (activations), d, e (first and second derivatives of the sigmoid, up to the order) and y."""
    lines = [
        f"KEEP_LOOP for (int j = 0; j < {shape.inputs}; j++) offset{at}[j] = bounded(x{at}[j] - w{at}[j]);",
        f"affine({shape.inputs}, {shape.stacked[0]}, w{at} + {shape.layer(0)}, offset{at}, a{at}[0]);",
    ]
    for layer, n in enumerate(shape.stacked):
        if layer:
            before, after = _of(shape, layer - 1, f"a{at}[{layer - 1}]"), _of(shape, layer, f"a{at}[{layer}]")
            sizes = f"{shape.hidden[layer - 1]}, {shape.rows[layer]}"
            lines.append(_each(shape, f"affine({sizes}, {_weights(shape, layer, at)}, {before}, {after});"))
        arrays = ", ".join(f"{name}{at}[{layer}]" for name in "ade"[: order + 1])
        lines.append(f"{shape.activation}_{order}({n}, {arrays});")
    if shape.outputs > 1:
        return [
            *lines,
            f"affine({shape.hidden[-1]}, {padded(shape.outputs)}, w{at} + {shape.output}, a{at}[{shape.last}], z{at});",
            f"memcpy(y{at}, z{at}, {shape.outputs} * sizeof(double));",
        ]
    output = f"dot({shape.rows[-1]}, {_of(shape, shape.last, f'w{at} + {shape.output}')}, "
    output += f"{_of(shape, shape.last, f'a{at}[{shape.last}]')})"
    return [*lines, _each(shape, f"y{at}[m] = w{at}[{shape.output_bias} + m] + {output};")]


def _reverse(shape: Shape, layer: int, q: str, r: str, at: str = "") -> str:
    """r of the layer before, from q = r∘σ' of this one."""
    sizes = f"{shape.hidden[layer]}, {shape.rows[layer - 1]}"
    weights = f"w{at} + {shape.turned(layer)} + m * {shape.turned_slab(layer)}"
    return _each(shape, f"linear({sizes}, {weights}, {_of(shape, layer, q)}, {_of(shape, layer - 1, r)});")


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"  {line}" for line in lines]


def _side_by_side(shape: Shape, what: str, comment: str, outputs: Sequence[str], body: Sequence[str]) -> list[str]:
    """SHAPE_whats for networks p, each statement for one after the other; SHAPE_what for one, SHAPE_what_2 for two."""
    name = f"{shape.symbol}_{what}"
    several = ", ".join(["const double *const *w", "const double *const *x", *(f"double *const *{y}" for y in outputs)])
    one = ", ".join(["const double *w", "const double *x", *(f"double *{y}" for y in outputs)])
    names = ["w", "x", *outputs]
    return [
        comment,
        f"INLINE void {name}s(int n, {several}) {{",
        *_indented(body),
        "}",
        "",
        f"FUNCTION void {name}({one}) {{ {name}s(1, {', '.join(f'&{each}' for each in names)}); }}",
        f"\nFUNCTION void {name}_2({several}) {{ {name}s(2, {', '.join(names)}); }}" if paired(shape) else "",
    ]


def _value(shape: Shape) -> list[str]:
    body = [f"double {_arrays(shape, 'a', '[SIDE]')};", *(f"EACH {line}" for line in _forward(shape, 0, "[p]"))]
    return _side_by_side(shape, "value", "/* y[p][m] */", ["y"], body)


def _gradient(shape: Shape) -> list[str]:
    body = _gradient_forward(shape) if shape.outputs > 1 else _gradient_reverse(shape)
    k = shape.inputs
    return _side_by_side(shape, "gradient", f"/* y[p][m] and g[p][{k} m + t] = dy_m/dx_t */", ["y", "g"], body)


def _gradient_forward(shape: Shape) -> list[str]:
    """Derivatives of several outputs, along each input in turn."""
    k = shape.inputs
    lines = [
        f"double {_arrays(shape, 'ad', '[SIDE]')}, damped[SIDE][WIDEST], ahead[SIDE][WIDEST];",
        *(f"EACH {line}" for line in _forward(shape, 1, "[p]")),
        f"for (int t = 0; t < {k}; t++) {{",
        f"  EACH times({shape.stacked[0]}, d[p][0], {_first_row(shape, '[p]')}, damped[p]);",
    ]
    for layer in range(1, len(shape.hidden)):
        sizes = f"{shape.hidden[layer - 1]}, {shape.rows[layer]}"
        lines += [
            f"  EACH linear({sizes}, w[p] + {shape.layer(layer)}, damped[p], ahead[p]);",
            f"  EACH times({shape.rows[layer]}, d[p][{layer}], ahead[p], damped[p]);",
        ]
    return [
        *lines,
        f"  EACH linear({shape.hidden[-1]}, {padded(shape.outputs)}, w[p] + {shape.output}, damped[p], z[p]);",
        f"  EACH for (int m = 0; m < {shape.outputs}; m++) g[p][{k} * m + t] = z[p][m];",
        "}",
    ]


def _gradient_reverse(shape: Shape) -> list[str]:
    """Derivatives of one output of each network, from the last layer to the first."""
    k = shape.inputs
    lines = [
        f"double {_arrays(shape, 'ad', '[SIDE]')}, q[SIDE][WIDEST]{', r[SIDE][WIDEST]' if shape.last else ''};",
        *(f"EACH {line}" for line in _forward(shape, 1, "[p]")),
        f"EACH times({shape.stacked[-1]}, w[p] + {shape.output}, d[p][{shape.last}], q[p]);",
    ]
    for layer in range(shape.last, 0, -1):
        lines += [
            f"EACH {_reverse(shape, layer, 'q[p]', 'r[p]', '[p]')}",
            f"EACH times({shape.stacked[layer - 1]}, r[p], d[p][{layer - 1}], q[p]);",
        ]
    slope = f"dot({shape.rows[0]}, {_of(shape, 0, _first_row(shape, '[p]'))}, {_of(shape, 0, 'q[p]')})"
    return [
        *lines,
        f"for (int t = 0; t < {k}; t++) {{",
        f"  EACH {_each(shape, f'g[p][{k} * m + t] = {slope};')}",
        "}",
    ]


def _seed(shape: Shape) -> list[str]:
    """r of the last hidden layer: the weighted sum of the outputs by its activations."""
    r = f"r[{shape.last}]"
    if shape.outputs > 1:
        return [
            f"  memset(z, 0, sizeof z), memcpy(z, c, {shape.outputs} * sizeof(double));",
            f"  transposed({shape.hidden[-1]}, {padded(shape.outputs)}, w + {shape.output}, z, {r});",
        ]
    loop = f"for (int i = m * {shape.rows[-1]}; i < (m + 1) * {shape.rows[-1]}; i++)"
    return ["  " + _each(shape, f"{loop} {r}[i] = c[m] * w[{shape.output} + i];")]


def _hessian(shape: Shape) -> list[str]:
    k, layers = shape.inputs, len(shape.hidden)
    scratch = f"tangents[{k} * WIDEST], " if layers > 2 else ""
    lines = [
        f"/* y[m]; g += sum_m c_m dy_m/dx; h += sum_m c_m d2y_m/dx2, lower triangle of {k} x {k} */",
        f"FUNCTION void {shape.symbol}_hessian(const double *w, const double *x, const double *c, double *y,",
        "    double *g, double *h) {",
        f"  double {_arrays(shape, 'ade')}, q[WIDEST], r[{layers}][WIDEST] = {{{{0}}}};",
        f"  double sums[{k * (k + 1) // 2}][WIDTH] = {{{{0}}}};",
        *([f"  double {scratch}ahead[{k} * WIDEST], damped[WIDEST];"] if layers > 1 else []),
        *_indented(_forward(shape, 2)),
        *_seed(shape),
    ]
    for layer in range(shape.last, 0, -1):
        lines += [
            f"  times({shape.stacked[layer]}, r[{layer}], d[{layer}], q);",
            "  " + _reverse(shape, layer, "q", f"r[{layer - 1}]"),
        ]
    n0 = shape.stacked[0]
    lines += [
        f"  times({n0}, r[0], d[0], q);",
        f"  for (int t = 0; t < {k}; t++) g[t] += dot({n0}, {_first_row(shape)}, q);",
        f"  times({n0}, r[0], e[0], q);",
        f"  curvature({k}, {n0}, q, w + {shape.layer(0) + n0}, sums);",
    ]
    for layer in range(1, layers):
        before, n = shape.stacked[layer - 1], shape.stacked[layer]
        tangent = _first_row(shape) if layer == 1 else f"tangents + t * {before}"
        sizes = f"{shape.hidden[layer - 1]}, {shape.rows[layer]}"
        arrays = f"{_of(shape, layer - 1, 'damped')}, {_of(shape, layer, f'ahead + t * {n}')}"
        lines += [
            f"  for (int t = 0; t < {k}; t++) {{",
            f"    times({before}, d[{layer - 1}], {tangent}, damped);",
            "    " + _each(shape, f"linear({sizes}, {_weights(shape, layer)}, {arrays});"),
            "  }",
            f"  times({n}, r[{layer}], e[{layer}], q);",
            f"  curvature({k}, {n}, q, ahead, sums);",
        ]
        if layer < shape.last:
            lines.append(f"  memcpy(tangents, ahead, {k * n} * sizeof(double));")
    return [*lines, f"  curved({k}, sums, h);", "}"]


def bundle_functions(bundle: Bundle) -> str:
    """The groups of a bundle one after the other."""
    symbol, k = bundle.symbol, bundle.inputs
    arguments = {
        "value": ("const double *x, double *y", "x, y + {m}"),
        "gradient": ("const double *x, double *y, double *g", f"x, y + {{m}}, g + {k} * {{m}}"),
        "hessian": ("const double *x, const double *c, double *y, double *g, double *h", "x, c + {m}, y + {m}, g, h"),
    }
    functions = []
    for what, (parameters, call) in arguments.items():
        lines, m = [f"INLINE void {symbol}_{what}({parameters}) {{"], 0
        for group in bundle.groups:
            lines.append(f"  {group.shape.symbol}_{what}({group.symbol}, {call.format(m=m)});")
            m += sum(network.outputs for network in group.networks)
        if not bundle.groups:
            unused = [parameter.split("*")[-1] for parameter in parameters.split(", ")]
            lines.append(f"  {', '.join(f'(void){name}' for name in unused)};")
        functions.append("\n".join([*lines, "}"]))
    return "\n\n".join(functions)


def family_functions(name: str, bundles: Sequence[Bundle]) -> str:
    """NAME_value(count, which, x, y) and NAME_gradient(count, which, x, y, g): those of the bundles that are listed; in
    pairs where each is one network, all of the same few neurons. x, y and g hold a pointer for each."""
    shapes = {bundle.groups[0].shape if bundle.groups else None for bundle in bundles}
    shape = shapes.pop() if len(shapes) == 1 and len(bundles) > 1 else None
    functions = []
    if pairs := shape is not None and paired(shape):
        weights = ", ".join(group.symbol for bundle in bundles for group in bundle.groups)
        functions.append(f"static const double *const {name}_weights[{len(bundles)}] = {{{weights}}};")
    for what, outputs, in_pairs in (("value", "y", "VALUES_IN_PAIRS"), ("gradient", "yg", "SLOPES_IN_PAIRS")):
        pointers = "".join(f", double *const *{array}" for array in outputs)
        lines = [f"INLINE void {name}_{what}(int count, const int *which, const double *const *x{pointers}) {{"]
        lines.append("  int k = 0;")
        if pairs:
            kinds = {f"{name}_weights": "const double", "x": "const double", **dict.fromkeys(outputs, "double")}
            of_two = "({kind} *const[]){{{array}[which[k]], {array}[which[k + 1]]}}"
            given = (of_two.format(kind=kind, array=array) for array, kind in kinds.items())
            lines.append(f"  for (; {in_pairs} && k + 2 <= count; k += 2) {{")
            lines += [f"    {shape.symbol}_{what}_2({', '.join(given)});", "  }"]  # type: ignore[union-attr]
        lines += ["  for (; k < count; k++) {", "    const int i = which[k];", "    switch (i) {"]
        of_one = "".join(f", {array}[i]" for array in outputs)
        lines += [f"      case {p}: {b.symbol}_{what}(x[i]{of_one}); break;" for p, b in enumerate(bundles)]
        functions.append("\n".join([*lines, "    }", "  }", "}"]))
    return "\n\n".join(functions) + "\n"
