"""C functions of a patch surrogate (the formulas of `structures.patch.graph`)."""

from __future__ import annotations

from collections.abc import Sequence
from string import Template

from casadi_contact.core.conventions import WRENCH_NAMES, Array
from casadi_contact.networks.kernel.network_functions import family_functions
from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.kernel.source import Kernel, c_text
from casadi_contact.networks.names import identifier
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.surrogate.patch.networks import PatchNetworks

_FEW = 2  # patches, of which both are pressed as a rule


def _template(name: str) -> Template:
    return Template(c_text(name, __package__))


def _anchor(patch: PatchNetworks) -> str:
    return ", ".join(repr(float(a)) for a in patch.anchor_mm)


def _lines(lines: Sequence[str], indent: int) -> str:
    return "\n".join(" " * indent + line for line in lines)


def _patch(patch: PatchNetworks, row: int, selection: Array, reference_load: float) -> tuple[list[Bundle], str]:
    """Networks and functions of one patch, whose root load is the one at `row`; selection (L, 6) picks its wrench
    components into loads."""
    used = [name for k, name in enumerate(WRENCH_NAMES) if selection[:, k].any()]
    ratios, of_ratios = [], {}
    if patch.ratios is not None and any(name != patch.sensitive for name in used):
        ratios, of_ratios = list(patch.components), {f"{', '.join(patch.components)} by N {patch.name}": patch.ratios}
    sign = "-" if patch.sign < 0.0 else ""
    bundles = [
        Bundle(f"root_{patch.name}", 6, {f"root {patch.name}": patch.root}),
        Bundle(f"ratios_{patch.name}", 6, of_ratios),
    ]
    picked = [
        (int(load), name, float(selection[load, WRENCH_NAMES.index(name)]))
        for name in used
        for load in selection[:, WRENCH_NAMES.index(name)].nonzero()[0]
    ]

    def sums(target: str, pressed: str, ratio: str) -> list[str]:
        """target of each load += its share of a wrench component; {m} stands for the ratio."""
        return [
            f"{target.format(load=load)} += {share!r} * "
            + (pressed if name == patch.sensitive else ratio.format(m=ratios.index(name)))
            + ";"
            for load, name, share in picked
        ]

    def weight(component: str | None) -> str:
        shares = (f"{share!r} * loads_weight[{load}]" for load, name, share in picked if name == component)
        return " + ".join(shares) or "0.0"

    code = _template("part.h").substitute(
        patch=identifier(patch.name),
        row=row,
        n0=repr(float(reference_load)),
        anchor=_anchor(patch),
        ratio_slopes=_lines([f"gradient_in_pose(local, d_ratio[{m}]);" for m in range(len(ratios))], 2),
        ratio_sum=_lines([f"phi += c[{m}] * ratio[{m}];" for m in range(len(ratios))], 4),
        loads=_lines(sums("loads[{load}]", f"{sign}normal", "normal * ratio[{m}]"), 2),
        rows=_lines(
            sums(
                "loads_jacobian[{load}][j]",
                f"({sign}d_normal)",
                "(ratio[{m}] * d_normal + normal * d_ratio[{m}][j])",
            ),
            4,
        ),
        lane_loads=_lines(sums("loads[{load}][l]", f"{sign}normal", "normal * all_ratios[{m} * LANES + l]"), 4),
        ratio_weights=", ".join(weight(name) for name in ratios) or "0.0",
        sign=sign,
        sensitive_weight=weight(patch.sensitive),
    )
    return bundles, code


def _held(space: PoseSpace) -> tuple[str, str]:
    """The pose that networks are evaluated at, from the one given; and C of gradient_by_free(g, stride), which turns a
    gradient by that pose into one by the given pose, in place."""
    entries = [
        f"given[{k}]"
        if k in space.free
        else " + ".join([f"{m!r} * given[{j}]" for j, m in enumerate(row) if m] + [repr(c)])
        for k, (row, c) in enumerate(zip(space.matrix.tolist(), space.offset.tolist(), strict=True))
    ]
    bound = [k for k in range(6) if k not in space.free]
    ties = [(j, k, m) for k in bound for j, m in enumerate(space.matrix[k].tolist()) if m]
    lines = [f"  g[{j} * stride] += {m!r} * g[{k} * stride];" for j, k, m in ties]
    lines += [f"  g[{k} * stride] = 0.0;" for k in bound]
    lines = lines or ["  (void)g, (void)stride;"]
    by_free = "\n".join(["INLINE void gradient_by_free(double *g, int stride) {", *lines, "}\n"])
    return "given" if space.unconstrained else f"(const double[6]){{{', '.join(entries)}}}", by_free


def patch_kernel(patches: Sequence[PatchNetworks], selection: Array, reference_load: float, space: PoseSpace) -> Kernel:
    """Kernel of loads (selection (L, P, 6) of the patches' wrenches) and of the root load of every patch."""
    held, by_free = _held(space)
    made = [_patch(patch, p, selection[:, p], reference_load) for p, patch in enumerate(patches)]
    symbols = [identifier(patch.name) for patch in patches]
    many = len(symbols) > _FEW
    whole = _template("patches.h").substitute(
        held=held,
        patches=len(symbols),
        anchors=", ".join(f"{{{_anchor(patch)}}}" for patch in patches),
        n0=repr(float(reference_load)),
        values=_lines(
            [
                f"if (normal[{p}] > 0.0) loads_on_{name}(normal[{p}], ratio[{p}], loads);"
                for p, name in enumerate(symbols)
            ],
            2,
        ),
        jacobians=_lines(
            [
                line
                for p, name in enumerate(symbols)
                for line in (
                    f"if (normal[{p}] > 0.0) {{",
                    f"  loads_on_{name}(normal[{p}], ratio[{p}], loads);",
                    f"  slopes_on_{name}(local + {p}, normal[{p}], s[{p}], ds[{p}], ratio[{p}], "
                    f"d_ratio[{p}], loads_jacobian);",
                    "}",
                )
            ],
            2,
        ),
        bent=_template("bent.h").substitute(patches=len(symbols)) if many else "",
        hessians=_lines(
            [
                (f"if (bent[{p}]) " if many else "")
                + f"hessian_on_{name}(pose, &frame, loads_weight, roots_weight, hessian);"
                for p, name in enumerate(symbols)
            ],
            2,
        ),
        batches=_lines([f"batch_on_{name}(pose, frame, loads, roots);" for name in symbols], 2),
    )
    most = max(1, *(sum(net.outputs for net in bundles[1].networks.values()) for bundles, _ in made))
    code = [
        c_text("pose.h"),
        c_text("patch.h", __package__),
        f"#define RATIOS {most}\n",
        family_functions("roots", [bundles[0] for bundles, _ in made]),
        family_functions("ratios", [bundles[1] for bundles, _ in made]),
        *(code for _, code in made),
        by_free,
        whole,
    ]
    return Kernel([bundle for bundles, _ in made for bundle in bundles], "\n".join(code))
