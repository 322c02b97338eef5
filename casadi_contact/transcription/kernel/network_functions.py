"""C functions that evaluate networks: value, gradient, weighted Hessian, a batch of poses.

The formulas are those of `network_graph`. Networks of one input share each layer's loop, so that their short chains
of sums overlap in the processor.
"""

from __future__ import annotations

from collections.abc import Sequence

from casadi_contact.network.activations import activation_of
from casadi_contact.transcription.kernel.networks import Bundle, Shape, padded

LANES = 16  # poses worked on at once in a batch: so many that all of a layer stays in the nearest cache


def network_functions(bundles: Sequence[Bundle]) -> str:
    """Weights, functions of every shape (each once), and SYMBOL_value, _gradient, _hessian, _batch of every bundle."""
    groups = [group for bundle in bundles for group in bundle.groups]
    shapes = dict.fromkeys(group.shape for group in groups)
    loops = [activation_loops(name) for name in dict.fromkeys(shape.activation for shape in shapes)]
    of_shapes = ["\n".join(part(shape)) for shape in shapes for part in (_value, _gradient, _hessian, _batch)]
    return "\n\n".join([*(group.declaration() for group in groups), *loops, *of_shapes, *map(_bundle, bundles)])


def activation_loops(name: str) -> str:
    """NAME_0(n, a), NAME_1(n, a, d), NAME_2(n, a, d, e): a = σ(a) in place, d = σ', e = σ''.

    The compiler drops what a loop does not store.
    """
    body = activation_of(name).c.replace("\n", "\n    ")
    stored = ("a[i] = value;", "d[i] = slope;", "e[i] = curvature;")
    functions = []
    for order in range(3):
        parameters = ", ".join(f"double *{array}" for array in "ade"[: order + 1])
        functions.append(
            f"INLINE void {name}_{order}(int n, {parameters}) {{\n"
            "  for (int i = 0; i < n; i++) {\n"
            f"    double value, slope, curvature;\n    const double z = a[i];\n    {body}\n"
            f"    {' '.join(stored[: order + 1])}\n    (void)slope, (void)curvature;\n  }}\n}}"
        )
    return "\n\n".join(functions)


def _bundle(bundle: Bundle) -> str:
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


def _each(shape: Shape, statement: str) -> str:
    return f"  for (int m = 0; m < {shape.count}; m++) {statement}"


def _weights(shape: Shape, layer: int) -> str:
    """Weights of network m in a layer after the first."""
    return f"w + {shape.layer(layer)} + m * {shape.slab(layer)}"


def _first_row(shape: Shape) -> str:
    """Weights of input t in the first layer of all networks: also d(first layer)/dx_t."""
    return f"w + {shape.layer(0)} + (t + 1) * {shape.stacked[0]}"


def _of(shape: Shape, layer: int, array: str) -> str:
    """The part of network m in an array of a whole layer."""
    return f"{array} + m * {shape.rows[layer]}"


def _arrays(shape: Shape, names: str) -> str:
    return ", ".join(f"{name}[{len(shape.hidden)}][WIDEST]" for name in names)


def _forward(shape: Shape, order: int) -> list[str]:
    """Fill a (activations), d, e (first and second derivatives of the sigmoid, up to the order) and y."""
    lines = [
        f"  for (int j = 0; j < {shape.inputs}; j++) offset[j] = bounded(x[j] - w[j]);",
        f"  affine({shape.inputs}, {shape.stacked[0]}, w + {shape.layer(0)}, offset, a[0]);",
    ]
    for layer, n in enumerate(shape.stacked):
        if layer:
            before, after = _of(shape, layer - 1, f"a[{layer - 1}]"), _of(shape, layer, f"a[{layer}]")
            sizes = f"{shape.hidden[layer - 1]}, {shape.rows[layer]}"
            lines.append(_each(shape, f"affine({sizes}, {_weights(shape, layer)}, {before}, {after});"))
        arrays = ", ".join(f"{name}[{layer}]" for name in "ade"[: order + 1])
        lines.append(f"  {shape.activation}_{order}({n}, {arrays});")
    if shape.outputs > 1:
        return [*lines, f"  double z[{padded(shape.outputs)}];", *_last_layer(shape, "affine", f"a[{shape.last}]", "y")]
    output = f"dot({shape.rows[-1]}, {_of(shape, shape.last, f'w + {shape.output}')}, "
    output += f"{_of(shape, shape.last, f'a[{shape.last}]')})"
    return [*lines, _each(shape, f"y[m] = w[{shape.output_bias} + m] + {output};")]


def _last_layer(shape: Shape, product: str, a: str, y: str) -> list[str]:
    """Outputs y of one network of several, from what goes into its last layer."""
    sizes = f"{shape.hidden[-1]}, {padded(shape.outputs)}"
    return [
        f"  {product}({sizes}, w + {shape.output}, {a}, z);",
        f"  memcpy({y}, z, {shape.outputs} * sizeof(double));",
    ]


def _reverse(shape: Shape, layer: int, q: str, r: str) -> str:
    """r of the layer before, from q = r∘σ' of this one."""
    sizes = f"{shape.hidden[layer - 1]}, {shape.rows[layer]}"
    arrays = f"{_of(shape, layer, q)}, {_of(shape, layer - 1, r)}"
    return _each(shape, f"transposed({sizes}, {_weights(shape, layer)}, {arrays});")


def _value(shape: Shape) -> list[str]:
    return [
        f"FUNCTION void {shape.symbol}_value(const double *w, const double *x, double *y) {{",
        f"  double offset[{shape.inputs}], {_arrays(shape, 'a')};",
        *_forward(shape, 0),
        "}",
    ]


def _gradient_forward(shape: Shape) -> list[str]:
    """Derivatives of several outputs, along each input in turn."""
    k, ahead = shape.inputs, "ahead"
    lines = [
        f"/* y[m] and g[{k} m + t] = dy_m/dx_t */",
        f"FUNCTION void {shape.symbol}_gradient(const double *w, const double *x, double *y, double *g) {{",
        f"  double offset[{k}], {_arrays(shape, 'ad')}, damped[WIDEST], ahead[WIDEST];",
        *_forward(shape, 1),
        f"  for (int t = 0; t < {k}; t++) {{",
        f"    times({shape.stacked[0]}, d[0], {_first_row(shape)}, damped);",
    ]
    for layer in range(1, len(shape.hidden)):
        sizes = f"{shape.hidden[layer - 1]}, {shape.rows[layer]}"
        lines += [
            f"    linear({sizes}, w + {shape.layer(layer)}, damped, {ahead});",
            f"    times({shape.rows[layer]}, d[{layer}], {ahead}, damped);",
        ]
    return [
        *lines,
        f"    linear({shape.hidden[-1]}, {padded(shape.outputs)}, w + {shape.output}, damped, z);",
        f"    for (int m = 0; m < {shape.outputs}; m++) g[{k} * m + t] = z[m];",
        "  }",
        "}",
    ]


def _gradient(shape: Shape) -> list[str]:
    if shape.outputs > 1:
        return _gradient_forward(shape)
    k = shape.inputs
    lines = [
        f"/* y[m] and g[{k} m + t] = dy_m/dx_t */",
        f"FUNCTION void {shape.symbol}_gradient(const double *w, const double *x, double *y, double *g) {{",
        f"  double offset[{k}], {_arrays(shape, 'ad')}, q[WIDEST], r[WIDEST] = {{0}};",
        *_forward(shape, 1),
        f"  times({shape.stacked[-1]}, w + {shape.output}, d[{shape.last}], q);",
    ]
    for layer in range(shape.last, 0, -1):
        lines += [_reverse(shape, layer, "q", "r"), f"  times({shape.stacked[layer - 1]}, r, d[{layer - 1}], q);"]
    slope = f"dot({shape.rows[0]}, {_of(shape, 0, _first_row(shape))}, {_of(shape, 0, 'q')})"
    return [
        *lines,
        f"  for (int t = 0; t < {k}; t++) {{",
        "  " + _each(shape, f"g[{k} * m + t] = {slope};"),
        "  }",
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
    return [_each(shape, f"{loop} {r}[i] = c[m] * w[{shape.output} + i];")]


def _hessian(shape: Shape) -> list[str]:
    k, layers = shape.inputs, len(shape.hidden)
    scratch = f"tangents[{k} * WIDEST], " if layers > 2 else ""
    lines = [
        f"/* y[m]; g += sum_m c_m dy_m/dx; h += sum_m c_m d2y_m/dx2, lower triangle of {k} x {k} */",
        f"FUNCTION void {shape.symbol}_hessian(const double *w, const double *x, const double *c, double *y,",
        "    double *g, double *h) {",
        f"  double offset[{k}], {_arrays(shape, 'ade')}, q[WIDEST], r[{layers}][WIDEST] = {{{{0}}}};",
        *([f"  double {scratch}ahead[{k} * WIDEST], damped[WIDEST];"] if layers > 1 else []),
        *_forward(shape, 2),
        *_seed(shape),
    ]
    for layer in range(shape.last, 0, -1):
        lines += [
            f"  times({shape.stacked[layer]}, r[{layer}], d[{layer}], q);",
            _reverse(shape, layer, "q", f"r[{layer - 1}]"),
        ]
    n0 = shape.stacked[0]
    lines += [
        f"  times({n0}, r[0], d[0], q);",
        f"  for (int t = 0; t < {k}; t++) g[t] += dot({n0}, {_first_row(shape)}, q);",
        f"  times({n0}, r[0], e[0], q);",
        f"  curvature({k}, {n0}, q, w + {shape.layer(0) + n0}, h);",
    ]
    for layer in range(1, layers):
        before, n = shape.stacked[layer - 1], shape.stacked[layer]
        tangent = _first_row(shape) if layer == 1 else f"tangents + t * {before}"
        sizes = f"{shape.hidden[layer - 1]}, {shape.rows[layer]}"
        arrays = f"{_of(shape, layer - 1, 'damped')}, {_of(shape, layer, f'ahead + t * {n}')}"
        lines += [
            f"  for (int t = 0; t < {k}; t++) {{",
            f"    times({before}, d[{layer - 1}], {tangent}, damped);",
            "  " + _each(shape, f"linear({sizes}, {_weights(shape, layer)}, {arrays});"),
            "  }",
            f"  times({n}, r[{layer}], e[{layer}], q);",
            f"  curvature({k}, {n}, q, ahead, h);",
        ]
        if layer < shape.last:
            lines.append(f"  memcpy(tangents, ahead, {k * n} * sizeof(double));")
    return [*lines, "}"]


def _batch(shape: Shape) -> list[str]:
    """Without padding: vectors run over poses, not over neurons."""
    k, here, there = shape.inputs, "a", "b"
    further = len(shape.hidden) > 1

    def lanes(count: int, array: str) -> str:
        return f"{array} + m * {count * LANES}"

    first = f"lanes({k}, {shape.hidden[0]}, {shape.stacked[0]}, {_of(shape, 0, f'w + {shape.layer(0)}')}, offset, "
    lines = [
        "/* LANES poses at once: x[t][lane] -> y[m][lane] */",
        f"FUNCTION void {shape.symbol}_batch(const double *w, const double *x, double *y) {{",
        f"  double offset[{k} * LANES], a[WIDEST * LANES]{', b[WIDEST * LANES]' if further else ''};",
        f"  for (int i = 0; i < {k} * LANES; i++) offset[i] = bounded(x[i] - w[i / LANES]);",
        _each(shape, f"{first}{lanes(shape.hidden[0], here)});"),
        f"  {shape.activation}_0({shape.count * shape.hidden[0]} * LANES, {here});",
    ]
    for layer in range(1, len(shape.hidden)):
        sizes = f"{shape.hidden[layer - 1]}, {shape.hidden[layer]}, {shape.rows[layer]}"
        arrays = f"{lanes(shape.hidden[layer - 1], here)}, {lanes(shape.hidden[layer], there)}"
        lines += [
            _each(shape, f"lanes({sizes}, {_weights(shape, layer)}, {arrays});"),
            f"  {shape.activation}_0({shape.count * shape.hidden[layer]} * LANES, {there});",
        ]
        here, there = there, here
    if shape.outputs > 1:
        sizes = f"{shape.hidden[-1]}, {shape.outputs}, {padded(shape.outputs)}"
        return [*lines, f"  lanes({sizes}, w + {shape.output}, {here}, y);", "}"]
    output = f"{_of(shape, shape.last, f'w + {shape.output}')}, w[{shape.output_bias} + m]"
    result = f"{lanes(shape.hidden[-1], here)}, y + m * LANES"
    return [*lines, _each(shape, f"lanes_out({shape.hidden[-1]}, {output}, {result});"), "}"]
