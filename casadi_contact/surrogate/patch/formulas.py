"""The formulas of a patch surrogate (docs/method.md) as CasADi expressions, and in C with both derivatives:

    N = N0·max(s, 0)²,  dN = 2·N0·max(s, 0)·ds,  d²N = 2·N0·([s > 0]·dsᵀds + max(s, 0)·d²s)
    W_k = N·ρ_k,        dW_k = ρ_k·dN + N·dρ_k,  d²W_k = ρ_k·d²N + dNᵀdρ_k + dρ_kᵀdN + N·d²ρ_k

in the local pose x = (t + R·a, rx, ry, rz) of a patch with anchor a; every order is exactly zero outside contact.
"""

from collections.abc import Iterable, Sequence
from string import Template

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.frames import rotation
from casadi_contact.networks.graph import network_value
from casadi_contact.networks.kernel.network_functions import family_functions
from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.kernel.source import Kernel, c_text
from casadi_contact.networks.names import identifier
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.surrogate.patch.networks import PatchNetworks

# --- CasADi


def patch_expressions(
    patches: Sequence[PatchNetworks], selection: Array, reference_load: float, space: PoseSpace, pose: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """Root loads of the patches, and loads = Σ S·wrench.

    selection S has shape (L, patches, 6); ratios that S does not touch are left out of the graph.
    """
    roots, loads = [], ca.MX.zeros(len(selection))
    for p, patch in enumerate(patches):
        x = _local_pose(patch.anchor_mm, space)(pose)
        s = network_value(patch.root, x)
        roots.append(s)
        used = [k for k in range(6) if selection[:, p, k].any()]
        if not used:
            continue
        normal, ratios = reference_load * ca.fmax(s, 0) ** 2, {}
        if any(k in used for k in patch.columns):
            ratios = dict(zip(patch.columns, ca.vertsplit(network_value(patch.ratios, x)), strict=True))
        shares = ca.vertcat(*(ratios.get(k, float(patch.own[k])) for k in used))
        loads += ca.mtimes(ca.sparsify(ca.DM(selection[:, p, used])), normal * shares)
    return ca.vertcat(*roots), loads


def _local_pose(anchor_mm: Array, space: PoseSpace) -> ca.Function:
    """Pose (6) -> local pose x (6) on the space."""
    pose = ca.SX.sym("pose", 6)
    on_space = pose if space.unconstrained else ca.mtimes(ca.sparsify(ca.DM(space.matrix)), pose) + ca.DM(space.offset)
    x = ca.vertcat(on_space[:3] + ca.mtimes(rotation(on_space[3:]), ca.sparsify(ca.DM(anchor_mm))), on_space[3:])
    return ca.Function("local_pose", [pose], [x])


# --- C


def _template(name: str) -> Template:
    return Template(c_text(name, __package__))


def _anchor(patch: PatchNetworks) -> str:
    return ", ".join(repr(float(a)) for a in patch.anchor_mm)


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(f"  {line}" for line in lines)


def _patch_functions(
    patch: PatchNetworks, row: int, selection: Array, reference_load: float
) -> tuple[Bundle, Bundle, str]:
    """Root load network (the one at `row`), ratios and functions of one patch; selection (L, 6) picks its loads."""
    picked = [(int(load), k, float(selection[load, k])) for k, load in np.argwhere(selection.T)]
    ratios, of_ratios = [], {}
    if any(k in patch.columns for _, k, _ in picked):
        ratios, of_ratios = patch.columns, {f"{', '.join(patch.components)} by N {patch.name}": patch.ratios}
    sign = "-" if patch.sign < 0.0 else ""

    def sums(target: str, pressed: str, ratio: str) -> str:
        """target of each load += its share of a wrench component; {m} stands for the ratio."""
        return _lines(
            f"{target.format(load=load)} += {share!r} * "
            + (ratio.format(m=ratios.index(k)) if k in ratios else pressed)
            + ";"
            for load, k, share in picked
        )

    def weight(ks: Sequence[int]) -> str:
        """Of the Hessian: the weighted sum of these components."""
        return " + ".join(f"{share!r} * loads_weight[{load}]" for load, k, share in picked if k in ks) or "0.0"

    slope = "(ratio[{m}] * d_normal + normal * d_ratio[{m}][j])"
    code = _template("patch_loads.h").substitute(
        patch=identifier(patch.name),
        row=row,
        n0=repr(float(reference_load)),
        anchor=_anchor(patch),
        ratio_slopes=_lines(f"gradient_in_pose(local, d_ratio[{m}]);" for m in range(len(ratios))),
        ratio_sum=_lines(f"phi += c[{m}] * ratio[{m}];" for m in range(len(ratios))),
        loads=sums("loads[{load}]", f"{sign}normal", "normal * ratio[{m}]"),
        rows=sums("loads_jacobian[{load}][j]", f"({sign}d_normal)", slope),
        ratio_weights=", ".join(weight([k]) for k in ratios) or "0.0",
        sign=sign,
        sensitive_weight=weight(np.flatnonzero(patch.own).tolist()),
    )
    root = Bundle(f"root_{patch.name}", 6, {f"root {patch.name}": patch.root})
    return root, Bundle(f"ratios_{patch.name}", 6, of_ratios), code


def _held(space: PoseSpace | None) -> tuple[str, str]:
    """The pose that networks are evaluated at, from the one given (None: the same); and C of gradient_by_free(g,
    stride), which turns a gradient by that pose into one by the given pose, in place."""
    if space is None:
        return "given", "INLINE void gradient_by_free(double *g, int stride) { (void)g, (void)stride; }\n"
    matrix = space.matrix.tolist()
    entries = [
        f"given[{k}]" if row[k] else " + ".join([f"{m!r} * given[{j}]" for j, m in enumerate(row) if m] + [repr(c)])
        for k, (row, c) in enumerate(zip(matrix, space.offset.tolist(), strict=True))
    ]
    bound = [k for k in range(6) if not matrix[k][k]]
    lines = [f"  g[{j} * stride] += {m!r} * g[{k} * stride];" for k in bound for j, m in enumerate(matrix[k]) if m] + [
        f"  g[{k} * stride] = 0.0;" for k in bound
    ]
    by_free = "\n".join(["INLINE void gradient_by_free(double *g, int stride) {", *lines, "}\n"])
    return f"(const double[6]){{{', '.join(entries)}}}", by_free


def patch_kernel(
    patches: Sequence[PatchNetworks],
    selection: Array,
    reference_load: float,
    space: PoseSpace | None,
    before: str = "",
) -> Kernel:
    """Kernel of loads (selection (L, patches, 6)) and root loads; space: None if all is free; before: of names."""
    held, by_free = _held(space)
    made = [_patch_functions(patch, p, selection[:, p], reference_load) for p, patch in enumerate(patches)]
    roots, ratios, functions = zip(*made, strict=True)

    def each(call: str) -> str:
        return _lines(call.format(p=p, name=patch.name) for p, patch in enumerate(patches))

    slopes = "local + {p}, normal[{p}], s[{p}], ds[{p}], ratio[{p}], d_ratio[{p}], loads, loads_jacobian"
    whole = _template("patches.h").substitute(
        before=before,
        held=held,
        patches=len(patches),
        anchors=", ".join(f"{{{_anchor(patch)}}}" for patch in patches),
        n0=repr(float(reference_load)),
        values=each("if (normal[{p}] > 0.0) loads_on_{name}(normal[{p}], ratio[{p}], loads);"),
        jacobians=each(f"if (normal[{{p}}] > 0.0) slopes_on_{{name}}({slopes});"),
        hessians=each("hessian_on_{name}(pose, &frame, loads_weight, roots_weight, hessian);"),
    )
    code = [
        c_text("pose.h"),
        c_text("patch.h", __package__),
        f"#define RATIOS {max(1, *(len(patch.columns) for patch in patches))}\n",
        family_functions("roots", roots),
        family_functions("ratios", ratios),
        *functions,
        by_free,
        whole,
    ]
    return Kernel([*roots, *ratios], "\n".join(code))
