"""The patch structure (docs/method.md) as CasADi expressions of the pose, with both derivatives written out.

    N = N0·max(s, 0)²,  dN = 2·N0·max(s, 0)·ds,  d²N = 2·N0·([s > 0]·dsᵀds + max(s, 0)·d²s)
    W_k = N·ρ_k,        dW_k = ρ_k·dN + N·dρ_k,  d²W_k = ρ_k·d²N + dNᵀdρ_k + dρ_kᵀdN + N·d²ρ_k

Values and gradients are continuous at liftoff and every order is exactly zero outside contact.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import WRENCH_NAMES, Array
from casadi_contact.networks.graph import Expressions, NetworkValue, Output, network_value, network_values
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.surrogate.patch.local_pose import LocalPose, local_pose_expressions
from casadi_contact.surrogate.patch.networks import PatchNetworks


def _normal(s: NetworkValue, reference_load: float, order: int) -> NetworkValue:
    """N and its derivatives in the local pose."""
    contact = ca.fmax(s.value, 0)
    slope = 2 * reference_load * contact
    value, gradient, hessian = reference_load * (contact * contact), ca.MX(), ca.MX()
    if order > 0:
        gradient = slope * s.gradient
    if order > 1:
        touching = (2 * reference_load) * (s.value > 0)
        hessian = ca.mtimes((touching * s.gradient).T, s.gradient) + slope * s.hessian
    return NetworkValue(value, gradient, hessian)


def _ratios(patch: PatchNetworks, x: ca.MX, components: Sequence[str], order: int) -> dict[str, NetworkValue]:
    """Ratios ρ_pk of these components at a local pose x."""
    if patch.ratios is None or not components:
        return {}
    outputs = [patch.components.index(k) for k in components]
    return dict(zip(components, network_values(patch.ratios, x, order, outputs), strict=True))


def _times(normal: NetworkValue, ratio: NetworkValue, order: int) -> NetworkValue:
    """N·ρ and its derivatives in the local pose."""
    value, gradient, hessian = normal.value * ratio.value, ca.MX(), ca.MX()
    if order > 0:
        gradient = ratio.value * normal.gradient + normal.value * ratio.gradient
    if order > 1:
        mixed = ca.mtimes(normal.gradient.T, ratio.gradient)
        hessian = ratio.value * normal.hessian + mixed + mixed.T + normal.value * ratio.hessian
    return NetworkValue(value, gradient, hessian)


def _sensitive_component(sign: float, normal: NetworkValue) -> NetworkValue:
    if sign > 0.0:
        return normal
    return NetworkValue(-normal.value, -normal.gradient, -normal.hessian)


def patch_expressions(
    patches: Sequence[PatchNetworks],
    selection: Array,
    reference_load: float,
    pose: ca.MX,
    order: int,
    space: PoseSpace,
) -> Expressions:
    """Root loads and loads = Σ S·wrench with derivatives up to order 0, 1 or 2.

    selection S has shape (L, P, 6); ratios that S does not touch are left out of the graph.
    """
    roots, loads = [], []
    on_space = pose if space.unconstrained else ca.mtimes(ca.sparsify(ca.DM(space.matrix)), pose) + ca.DM(space.offset)
    at_patches = local_pose_expressions(on_space, np.array([patch.anchor_mm for patch in patches]))
    for p, (patch, local) in enumerate(zip(patches, at_patches, strict=True)):
        used = [k for k in range(6) if selection[:, p, k].any()]
        components = [WRENCH_NAMES[k] for k in used if WRENCH_NAMES[k] != patch.sensitive]
        s = network_value(patch.root, local.x, order)
        ratios = _ratios(patch, local.x, components, order)
        roots.append(_in_pose(local, [s], order))
        if not used:
            continue
        normal = _normal(s, reference_load, order)
        wrench = []
        for k in used:
            component = WRENCH_NAMES[k]
            if component == patch.sensitive:
                wrench.append(_sensitive_component(patch.sign, normal))
            else:
                wrench.append(_times(normal, ratios[component], order))
        pick = ca.MX(ca.sparsify(ca.DM(selection[:, p, used])))
        loads.append([ca.mtimes(pick, part) for part in _in_pose(local, wrench, order)])
    summed = [sum(parts[1:], parts[0]) for parts in zip(*loads, strict=True)]
    return Expressions(
        roots=_by_given([ca.vertcat(*parts) for parts in zip(*roots, strict=True)], space),
        loads=_by_given(summed, space) if loads else Output(ca.MX(0, 1)),
    )


def _by_given(parts: Sequence[ca.MX], space: PoseSpace) -> Output:
    """Derivatives by the pose M·q + c become derivatives by q: J·M, and (MᵀHM) row by row, that is H·(M ⊗ M)."""
    matrix = ca.sparsify(ca.DM(space.matrix))
    factors = [None, matrix, ca.kron(matrix, matrix)]
    pairs = zip(parts, factors[: len(parts)], strict=True)
    return Output(
        *(part if factor is None or space.unconstrained else ca.mtimes(part, factor) for part, factor in pairs)
    )


def _in_pose(local: LocalPose, values: Sequence[NetworkValue], order: int) -> list[ca.MX]:
    """Stacked values (m), Jacobian (m x 6), second derivatives (m x 36) with respect to the pose, up to the order."""
    parts = [ca.vertcat(*(v.value for v in values))]
    if order > 0:
        rows = ca.vertcat(*(v.gradient for v in values))
        parts.append(local.pull_back(rows))
    if order > 1:
        parts.append(local.pull_back_second(rows, [v.hessian for v in values]))
    return parts
