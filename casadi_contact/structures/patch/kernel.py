"""C functions of a patch surrogate (the formulas of `structures.patch.graph`)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from string import Template

from casadi_contact.conventions import WRENCH_NAMES, Array
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.structures.patch.graph import PatchNetworks
from casadi_contact.transcription.c_names import identifier
from casadi_contact.transcription.kernel.networks import Bundle
from casadi_contact.transcription.kernel.source import Kernel, c_text

# Loads of one patch from its local pose and the root loads of its spots; nothing but these outside contact. (void) is
# for a patch that has none of the loads asked for.
_PATCH = Template("""\
INLINE void ${patch}_value(const Local *local, const double *s, double *loads) {
  const double normal = $n0 * pressed_squares($spots, s, 1);
  double ratio[RATIOS];
  (void)loads;
  if (!(normal > 0.0)) return;
  ratios_${patch}_value(local->x, ratio);
$loads
}

INLINE void ${patch}_jacobian(const double *pose, const Frame *frame, double *loads, double *roots,
                              double (*loads_jacobian)[6], double (*roots_jacobian)[6]) {
  const Local local = local_of(pose, frame, $anchor, 1);
  double s[$spots], ds[$spots][6], ratio[RATIOS], d_ratio[RATIOS][6], normal, d_normal[6];
  (void)loads, (void)loads_jacobian;
  root_${patch}_gradient(local.x, s, ds[0]);
  for (int k = 0; k < $spots; k++) gradient_in_pose(&local, ds[k]);
  if (ROOTS) {
    memcpy(roots + $row, s, sizeof s);
    memcpy(roots_jacobian[$row], ds, sizeof ds);
  }
  normal = $n0 * pressed_squares($spots, s, 1);
  if (!(normal > 0.0)) return;
  normal_gradient($spots, $n0, s, ds, d_normal);
  ratios_${patch}_gradient(local.x, ratio, d_ratio[0]);
$ratio_slopes
$loads
  for (int j = 0; j < 6; j++) {
$rows
  }
}

/* N times phi = sum_k c_k ratio_k + sign c of the sensitive component: one weighted sum for all loads. */
INLINE void ${patch}_hessian(const double *pose, const Frame *frame, const double *loads_weight,
                             const double *roots_weight, double *hessian) {
  const Local local = local_of(pose, frame, $anchor, 1);
  const double c[RATIOS] = {$ratio_weights};
  double s[$spots], ds[$spots][6] = {{0}}, d2s[36] = {0}, on_root[$spots];
  double ratio[RATIOS], phi = $sign($sensitive_weight), d_phi[6] = {0}, d2_phi[36] = {0};
  (void)loads_weight;
$root_slopes
  if (pressed_squares($spots, s, 1) > 0.0) {
    ratios_${patch}_hessian(local.x, c, ratio, d_phi, d2_phi);
$ratio_sum
  } else {
    phi = 0.0;
  }
  for (int k = 0; k < $spots; k++) {
    on_root[k] = 2.0 * $n0 * (s[k] > 0.0 ? s[k] : 0.0) * phi + (ROOTS ? roots_weight[$row + k] : 0.0);
  }
$root_curvature
  patch_hessian_in_pose(frame, &local, $n0, $spots, s, ds, on_root, d2s, phi, d_phi, d2_phi, hessian);
}

INLINE void ${patch}_batch(const double *pose, const Frame *frame, double (*loads)[LANES], double (*roots)[LANES]) {
  double x[6 * LANES], s[$spots * LANES], all_ratios[RATIOS * LANES];
  (void)loads;
  for (int l = 0; l < LANES; l++) {
    const Local local = local_of(pose + 6 * l, frame + l, $anchor, 0);
    for (int j = 0; j < 6; j++) x[j * LANES + l] = local.x[j];
  }
  root_${patch}_batch(x, s);
  ratios_${patch}_batch(x, all_ratios);
  if (ROOTS) memcpy(roots[$row], s, sizeof s);
  for (int l = 0; l < LANES; l++) {
    const double normal = $n0 * pressed_squares($spots, s + l, LANES);
    (void)normal;
$lane_loads
  }
}
""")


_KERNEL = Template("""\
FUNCTION void kernel_value(const double *given, double *loads, double *roots) {
  const double *const pose = $held;
  const Frame frame = frame_of(pose);
  const Local local[$patches] = {
$locals
  };
  double s[$spots];
$roots
  memset(loads, 0, LOADS * sizeof(double));
  if (ROOTS) memcpy(roots, s, sizeof s);
$values
}

FUNCTION void kernel_jacobian(const double *given, double *loads, double *roots, double (*loads_jacobian)[6],
                              double (*roots_jacobian)[6]) {
  const double *const pose = $held;
  const Frame frame = frame_of(pose);
  memset(loads, 0, LOADS * sizeof(double));
  memset(loads_jacobian, 0, LOADS * sizeof(double[6]));
$jacobians
  for (int k = 0; k < LOADS; k++) gradient_by_free(loads_jacobian[k], 1);
  for (int k = 0; k < ROOTS; k++) gradient_by_free(roots_jacobian[k], 1);
}

FUNCTION void kernel_hessian(const double *given, const double *loads_weight, const double *roots_weight,
                             double *hessian) {
  const double *const pose = $held;
  const Frame frame = frame_of(pose);
  memset(hessian, 0, 36 * sizeof(double));
$hessians
  for (int k = 0; k < 6; k++) gradient_by_free(hessian + 6 * k, 1);
  for (int k = 0; k < 6; k++) gradient_by_free(hessian + k, 6);
}

FUNCTION void kernel_batch(const double *given, double (*loads)[LANES], double (*roots)[LANES]) {
  Frame frame[LANES];
  double pose[6 * LANES];
  for (int l = 0; l < LANES; l++, given += 6) {
    memcpy(pose + 6 * l, $held, 6 * sizeof(double));
    frame[l] = frame_of(pose + 6 * l);
  }
  memset(loads, 0, LOADS * sizeof(double[LANES]));
$batches
}
""")


# Slopes of the spots' root loads, and then their second derivatives, weighted: of a single one all at once, of several
# when their values have given the weights.
_ROOT_SLOPES = (
    "const double one = 1.0;\n  root_{patch}_hessian(local.x, &one, s, ds[0], d2s);",
    "root_{patch}_gradient(local.x, s, ds[0]);",
)
_ROOT_CURVATURE = (
    "for (int i = 0; i < 36; i++) d2s[i] *= on_root[0];",
    "double summed[6] = {{0}};\n  root_{patch}_hessian(local.x, on_root, s, summed, d2s);",
)


def _anchor(patch: PatchNetworks) -> str:
    return ", ".join(repr(float(a)) for a in patch.anchor_mm)


def _lines(lines: Sequence[str], indent: int) -> str:
    return "\n".join(" " * indent + line for line in lines)


def _patch(
    patch: PatchNetworks, row: int, selection: Array, reference_load: float, space: PoseSpace
) -> tuple[list[Bundle], str]:
    """Networks and functions of one patch, whose spots' root loads begin at `row`; selection (L, 6) picks its wrench
    components into loads."""
    used = [name for k, name in enumerate(WRENCH_NAMES) if selection[:, k].any()]
    ratios = [name for name in used if name != patch.sensitive]
    of_ratios = {f"{name}/N {patch.name}": patch.ratios[name] for name in ratios} if patch.together is None else {}
    if patch.together is not None and ratios:
        network, components = patch.together
        ratios, of_ratios = list(components), {f"{', '.join(components)} by N {patch.name}": network}
    sign = "-" if patch.sign < 0.0 else ""
    columns = None if space.whole else space.free
    bundles = [
        Bundle(f"root_{patch.name}", 6, {f"root {patch.name}": patch.root}, columns),
        Bundle(f"ratios_{patch.name}", 6, of_ratios, columns),
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

    several, symbol = patch.root.outputs > 1, identifier(patch.name)
    code = _PATCH.substitute(
        patch=symbol,
        row=row,
        spots=patch.root.outputs,
        root_slopes=f"  {_ROOT_SLOPES[several].format(patch=symbol)}",
        root_curvature=f"  {_ROOT_CURVATURE[several].format(patch=symbol)}",
        n0=repr(float(reference_load)),
        anchor=_anchor(patch),
        ratio_slopes=_lines([f"gradient_in_pose(&local, d_ratio[{m}]);" for m in range(len(ratios))], 2),
        ratio_sum=_lines([f"phi += c[{m}] * ratio[{m}];" for m in range(len(ratios))], 4),
        loads=_lines(sums("loads[{load}]", f"{sign}normal", "normal * ratio[{m}]"), 2),
        rows=_lines(
            sums(
                "loads_jacobian[{load}][j]",
                f"({sign}d_normal[j])",
                "(ratio[{m}] * d_normal[j] + normal * d_ratio[{m}][j])",
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
    return "given" if space.whole else f"(const double[6]){{{', '.join(entries)}}}", by_free


def patch_kernel(patches: Sequence[PatchNetworks], selection: Array, reference_load: float, space: PoseSpace) -> Kernel:
    """Kernel of loads (selection (L, P, 6) of the patches' wrenches) and of the root loads of every patch's spots;
    networks take the local poses' free columns."""
    held, by_free = _held(space)
    first = [0, *itertools.accumulate(patch.root.outputs for patch in patches)]
    made = [_patch(patch, first[p], selection[:, p], reference_load, space) for p, patch in enumerate(patches)]
    names = [patch.name for patch in patches]
    whole = _KERNEL.substitute(
        held=held,
        patches=len(names),
        spots=first[-1],
        locals=_lines([f"local_of(pose, &frame, {_anchor(patch)}, 0)," for patch in patches], 6),
        roots=_lines([f"root_{name}_value(local[{p}].x, s + {first[p]});" for p, name in enumerate(names)], 2),
        values=_lines([f"{name}_value(local + {p}, s + {first[p]}, loads);" for p, name in enumerate(names)], 2),
        jacobians=_lines(
            [f"{name}_jacobian(pose, &frame, loads, roots, loads_jacobian, roots_jacobian);" for name in names], 2
        ),
        hessians=_lines([f"{name}_hessian(pose, &frame, loads_weight, roots_weight, hessian);" for name in names], 2),
        batches=_lines([f"{name}_batch(pose, frame, loads, roots);" for name in names], 2),
    )
    most = max(1, *(sum(net.outputs for net in bundles[1].networks.values()) for bundles, _ in made))
    code = [
        c_text("pose.h"),
        c_text("patch.h", __package__),
        f"#define RATIOS {most}\n",
        *(code for _, code in made),
        by_free,
        whole,
    ]
    return Kernel([bundle for bundles, _ in made for bundle in bundles], "\n".join(code))
