"""The paper's two stages [EF15 Eqs. 1-7] as CasADi expressions of the pose, with both derivatives written out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from casadi_contact.networks.graph import Expressions, NetworkValue, network_value, stack
from casadi_contact.networks.network import Network


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
