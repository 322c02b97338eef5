"""The paper's two stages [EF15 Eqs. 1-7] as CasADi expressions, with both derivatives written out,
and as C (``two_stage.h``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from casadi_contact.networks.graph import Expressions, NetworkValue, network_value, stack
from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.kernel.source import Kernel, c_text, table
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.patch.networks import PatchNetworks


def two_stage_expressions(
    first: Mapping[str, Network],
    second: Mapping[str, Network],
    load_names: Sequence[str],
    reference_load: float,
    smoothing_load: float,
    pose: ca.MX,
    order: int,
) -> Expressions:
    """[EF15 Eqs. 1-7]: sensitive forces f = min(net(pose), 0), every other load net(pose, f); derivatives up to order.

    With u = (pose, f) and U = du/dpose: dF = g·U, d²F = Uᵀ·H·U + Σ_f g_f·d²f.
    """
    raw = {name: network_value(network, pose, order) for name, network in first.items()}
    clamped = {name: _clamp(force) for name, force in raw.items()}
    u = ca.vertcat(pose, *(force.value for force in clamped.values()))
    tangent = None
    if order > 0:
        tangent = ca.vertcat(ca.MX(ca.DM.eye(6)), *(force.gradient for force in clamped.values()))
    loads = []
    for name in load_names:
        if name in clamped:
            loads.append(clamped[name])
            continue
        load = network_value(second[name], u, order, tangent)
        if order > 1:
            g = ca.vertsplit(load.input_gradient.T[6:])
            hessian = load.hessian
            for slope, force in zip(g, clamped.values(), strict=True):
                hessian += slope * force.hessian
            load = NetworkValue(load.value, load.gradient, hessian)
        loads.append(load)
    roots = [_root(force, reference_load, smoothing_load, order) for force in raw.values()]
    return Expressions(roots=stack(roots, order), loads=stack(loads, order))


def _clamp(force: NetworkValue) -> NetworkValue:
    """min(f, 0), zero in every order where the network would pull."""
    pressed = force.value < 0
    return NetworkValue(ca.fmin(force.value, 0), pressed * force.gradient, pressed * force.hessian)


def _root(force: NetworkValue, reference_load: float, smoothing_load: float, order: int) -> NetworkValue:
    """s = n/(n² + e²)^(1/4), n = -f/N0: sign(n)·√|n| with the infinite slope at zero rounded off."""
    n, e2 = force.value / -reference_load, (smoothing_load / reference_load) ** 2
    q = n * n + e2
    fourth = ca.sqrt(ca.sqrt(q))
    slope = (0.5 * (n * n) + e2) / (q * fourth) / -reference_load
    curvature = (-0.25 * (n * n) - 1.5 * e2) * n / (q * q * fourth) / reference_load**2
    hessian = slope * force.hessian
    if order > 1:
        hessian += ca.mtimes((curvature * force.gradient).T, force.gradient)
    return NetworkValue(n / fourth, slope * force.gradient, hessian)


def two_stage_kernel(
    first: Mapping[str, Network],
    second: Mapping[str, Network],
    load_names: Sequence[str],
    reference_load: float,
    smoothing_load: float,
) -> Kernel:
    """Kernel of loads, and of the root load of every first-stage force.

    first and second hold the networks of the two stages by load, first in the order of the second stage's inputs.
    """
    learned = [name for name in load_names if name not in first]
    inputs = 6 + len(first)

    def places(name: str, entries: Sequence[int]) -> str:
        return f"static const int {name}[] = {{{', '.join(map(str, [*entries, -1]))}}};"

    definitions = [
        f"#define FORCES {len(first)}",
        f"#define INPUTS {inputs}",
        f"#define OUTPUTS {len(learned)}",
        f"#define REFERENCE_LOAD {float(reference_load)!r}",
        f"#define ROUNDING {(smoothing_load / reference_load) ** 2!r}",
        "/* Which load each force and each output of the second stage is; -1 for none. */",
        places("LOAD_OF_FORCE", [load_names.index(name) if name in load_names else -1 for name in first]),
        places("LOAD_OF_OUTPUT", [load_names.index(name) for name in learned]),
    ]
    bundles = [Bundle("first", 6, first), Bundle("second", inputs, {name: second[name] for name in learned})]
    return Kernel(bundles, "\n".join([*definitions, "", c_text("two_stage.h", __package__)]))


def root_network_source(parts: Sequence[PatchNetworks], first_parts: Sequence[int]) -> tuple[list[Bundle], str]:
    """Root load networks of the parts, and C function confidence_roots (see `surrogate_kernel`) that evaluates them."""
    bundles = [Bundle(f"part_root_{k}", 6, {f"root {part.name}": part.root}) for k, part in enumerate(parts)]
    anchors = table("part_anchor", np.array([part.anchor_mm for part in parts]))
    first = table("first_root_part", np.array([*first_parts, len(parts)]))
    roots = "\n".join(
        f"  local = local_of(pose, &frame, part_anchor[{k}][0], part_anchor[{k}][1], part_anchor[{k}][2], 0);\n"
        f"  part_root_{k}_value(local.x, s + {k});"
        for k in range(len(parts))
    )
    return (
        bundles,
        f"""\
{c_text("pose.h")}
{anchors}
{first}
INLINE void confidence_roots(const double *pose, const double *parts, double *roots) {{
  const Frame frame = frame_of(pose);
  double s[{len(parts)}];
  Local local;
{roots}
  patch_roots(first_root_part, s, roots, 0);
  (void)parts;
}}
""",
    )
