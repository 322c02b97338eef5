"""Balance of some coordinates of an `Assembly` in one frame of a motion, with derivatives fast enough for IPOPT.

Free are some coordinates x and their rates v; the others, their rates and all accelerations come from a motion. With d
the direction that multipliers λ of the balanced coordinates span, the Lagrangian of the balance is

    ℓ = λᵀ·forces = r(x, v, λ) + φ(c, ∂c/∂q·u, ∂c/∂q·d, muscles),       φ = - Σ T·dL - Σ Q(pose, wrench)·dpose

where r is the virtual work of gravity, inertia, springs and loads, c(x) are lengths of paths, straight where a network
adds what wrapping does, the points that it depends on, and poses of contacts. c and r are functions of scalars, sparse
in every derivative; φ holds networks and contact, and is block diagonal. With μ = ∇φ and B = ∂c, the chain rule joins

    ∇²ℓ = ∇²(r + μᵀc) + Bᵀ·∇²φ·B,

some 20 times faster than CasADi's colouring of the whole function, and as exact.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network
from casadi_contact.optimisation.assembly.assembly import Assembly, Loaded
from casadi_contact.optimisation.assembly.paths import Wrap, tensions
from casadi_contact.optimisation.assembly.settling import pseudo_transient
from casadi_contact.optimisation.joint_mechanics import generalised_forces


class FrameBalance:
    """Functions of one frame, for ``map``. Inputs: drive (m), x and v (f) of the free coordinates, multipliers (b) for
    ``hessian`` alone, then q, u, udot (n) of the motion, whose free entries are passed over, and loads (6 x bodies).

    forces: -> (b) [N, N·m] on the balanced coordinates; jacobian: -> (b x m+2f), by (drive, x, v);
    hessian: -> (m+2f x m+2f) of λᵀ·forces. Drive: muscles' forces [N], or activations where by_force is False.
    """

    def __init__(
        self,
        assembly: Assembly,
        balanced: Sequence[str],
        free: Sequence[str],
        loaded: Sequence[Loaded] = (),
        by_force: bool = True,
    ) -> None:
        self.assembly, self.balanced, self.free = assembly, assembly.rows(balanced), assembly.rows(free)
        n, f, b, m = len(assembly.coordinates), len(self.free), len(self.balanced), len(assembly.muscles)
        x, v, lam, q, u, udot = (ca.SX.sym(*each) for each in zip("xvlqua", (f, f, b, n, n, n), strict=True))
        loads = ca.SX.sym("loads", 6, len(loaded))
        q_all, u_all, udot_all = ca.SX(q), ca.SX(u), ca.SX(udot)
        q_all[self.free], u_all[self.free], udot_all[self.free] = x, v, 0.0
        c, rest = self._geometry(loaded)(q_all, u_all, udot_all, lam, loads)
        motion, z, mu = [q, u, udot, loads], ca.vertcat(x, v, lam), ca.SX.sym("mu", c.numel())
        first = ca.Function("first", [z, *motion], [c, ca.jacobian(c, z), ca.gradient(rest, lam)], {"cse": True})
        second = ca.Function("second", [z, mu, *motion], [ca.hessian(rest + ca.dot(mu, c), z)[0]], {"cse": True})
        slope, curvature = self._outer(by_force)

        drive, X, V, L = (ca.MX.sym(*each) for each in zip("fxvl", (m, f, f, b), strict=True))
        given = [ca.MX.sym(name, *each.shape) for name, each in zip("quaw", motion, strict=True)]

        def whole(multipliers: Any) -> tuple[Any, Any]:
            """Forces, and the Hessian of ℓ by (drive, x, v, λ)."""
            at = ca.vertcat(X, V, multipliers)
            values, B, own = first(at, *given)
            by_values = slope(values, drive)
            D = ca.diagcat(ca.MX.eye(m), B)
            inner = ca.diagcat(ca.MX(m, m), second(at, by_values, *given))
            forces = own + ca.mtimes(B[:, 2 * f :].T, by_values)
            return forces, inner + ca.mtimes(D.T, ca.mtimes(curvature(values, drive), D))

        own, names = m + 2 * f, ["drive", "x", "v", "q", "u", "udot", "loads"]
        forces, hessian = whole(ca.MX(b, 1))
        self.forces = ca.Function("balance", [drive, X, V, *given], [forces], names, ["forces"])
        jacobian = hessian[own:, :own]
        self.jacobian = ca.Function("balance_jacobian", [drive, X, V, *given], [jacobian], names, ["jacobian"])
        names.insert(3, "multipliers")
        hessian = whole(L)[1][:own, :own]
        self.hessian = ca.Function("balance_hessian", [drive, X, V, L, *given], [hessian], names, ["hessian"])

    def settle(
        self, x: Array, drive: Array, motion: Sequence[Array], before: Array | None = None, step_s: float = 1.0
    ) -> tuple[Array, float]:
        """Free coordinates (f) at rest, from x, or moving on from those before within step_s; and the force [N] that is
        left on one, moments over 25 mm. The balanced coordinates must hold the free ones."""
        rows, m, f = [self.balanced.index(i) for i in self.free], len(drive), len(self.free)
        in_mm = np.array([c.in_mm for c in self.assembly.coordinate_table.values()])[self.free]

        def evaluate(at: Array) -> tuple[Array, Array]:
            v = np.zeros(f) if before is None else (at - before) / step_s
            forces, J = (call(drive, at, v, *motion).full() for call in (self.forces, self.jacobian))
            by_x = J[rows, m : m + f] + (0.0 if before is None else J[rows, m + f :] / step_s)
            return 1e3 * forces.ravel()[rows], 1e3 * by_x

        return pseudo_transient(evaluate, x, list(range(f)), in_mm, 1e-3, 300)

    @cached_property
    def energy(self) -> tuple[ca.Function, ca.Function]:
        """Functions of x and q: elastic energy [J] of the contacts, and its Hessian by x. It is the work that contact
        does while a body moves away, against the direction p that it presses in: E = ∫ F·p ds over 2.5 mm."""
        assembly, n = self.assembly, len(self.assembly.coordinates)
        x, q = ca.SX.sym("x", len(self.free)), ca.SX.sym("q", n)
        placed = ca.SX(q)
        placed[self.free] = x
        poses = ca.vec(assembly._poses(placed, 0.0)[0])
        mu = ca.SX.sym("mu", poses.numel())
        first = ca.Function("poses", [x, q], [poses, ca.jacobian(poses, x)])
        second = ca.Function("bent", [x, q, mu], [ca.hessian(ca.dot(mu, poses), x)[0]])
        P, total = ca.MX.sym("poses", poses.numel()), ca.MX(0)
        for i, contact in enumerate(assembly.contacts):
            presses = np.array(contact.model.scene.tables["geometry"].get("pressing", [0.0, -1.0, 0.0]))
            for node, weight in zip(*np.polynomial.legendre.leggauss(6), strict=True):
                away = np.append(-1.25 * (node + 1.0) * presses, np.zeros(3))
                force = assembly._wrench(contact, P[6 * i : 6 * i + 6] + ca.DM(away), ca.MX(6, 1))[:3]
                total += 1.25e-3 * weight * ca.dot(ca.DM(presses), force)
        slopes = ca.Function("energy_of", [P], [total, ca.gradient(total, P), ca.hessian(total, P)[0]])
        X, Q = ca.MX.sym("x", len(self.free)), ca.MX.sym("q", n)
        values, J = first(X, Q)
        _, by_pose, curved = slopes(values)
        hessian = second(X, Q, by_pose) + ca.mtimes(J.T, ca.mtimes(curved, J))
        given = ca.Function("energy_at", [P], [total])(values)
        return ca.Function("energy", [X, Q], [given]), ca.Function("energy_hessian", [X, Q], [hessian])

    def _geometry(self, loaded: Sequence[Loaded]) -> ca.Function:
        """q, u, udot, multipliers, loads -> c with its rates along u and d stacked, and r."""
        assembly = self.assembly
        q, n, chain = assembly._q, len(assembly.coordinates), assembly._chain
        u, udot, loads = ca.SX.sym("u", n), ca.SX.sym("udot", n), ca.SX.sym("loads", 6, len(loaded))
        multipliers, d = ca.SX.sym("multipliers", len(self.balanced)), ca.SX.zeros(n)
        d[self.balanced] = multipliers
        paths = [*assembly.ligaments, *assembly.muscles]
        parts = [p.straight(chain) if isinstance(p.wrap, Wrap) else p.length(chain) for p in paths]
        parts += [p.inputs(chain, p.wrap.body, p.wrap.points) for p in paths if isinstance(p.wrap, Wrap)]
        c = ca.vertcat(*parts, *assembly._pose_list)
        rest: Any = ca.dot(d, assembly._sprung(q, u))
        for body, inertia in assembly.bodies.items():
            t, R = chain.place(body, assembly.ground)
            at = ca.vec(ca.horzcat(R, 1e-3 * t))
            moved = ca.jtimes(at, q, d)
            if not ca.depends_on(moved, multipliers):
                continue
            acceleration = ca.reshape(ca.jtimes(ca.jtimes(at, q, u), ca.vertcat(q, u), ca.vertcat(u, udot)), 3, 4)
            J = ca.DM(inertia.second_moments)
            weight = ca.mtimes(ca.DM(assembly.gravity_m_s2), J[3, :]) - ca.mtimes(acceleration, J)
            rest += ca.dot(ca.vec(weight), moved)
        if loaded:
            rest += ca.dot(multipliers, assembly._applied(self.balanced, loaded)(q, loads))
        stacked = ca.vertcat(c, ca.jtimes(c, q, u), ca.jtimes(c, q, d))
        return ca.Function("geometry", [q, u, udot, multipliers, loads], [stacked, rest])

    def _outer(self, by_force: bool) -> tuple[ca.Function, ca.Function]:
        """Of φ, functions of (c stacked, drive): the gradient by c, and the Hessian by (drive, c)."""
        assembly = self.assembly
        paths, k, m = [*assembly.ligaments, *assembly.muscles], len(assembly.ligaments), len(assembly.muscles)
        wraps = [(i, path.wrap.network) for i, path in enumerate(paths) if isinstance(path.wrap, Wrap)]
        inputs = sum(len(network.input_shift) for _, network in wraps)
        sizes = [len(paths), inputs, 6 * len(assembly.contacts)]
        size, ends = sum(sizes), np.cumsum([0, *sizes]).tolist()
        C, drive = ca.MX.sym("c", 3 * size), ca.MX.sym("drive", m)
        straight, points, poses = ([C[j * size + a : j * size + e] for j in range(3)] for a, e in pairwise(ends))
        at = [ca.MX.sym("points", inputs) for _ in range(3)]
        own = networks_together([network for _, network in wraps])(at[0])
        excess = ca.Function("excess", at, [own, *(ca.jtimes(own, at[0], along) for along in at[1:])])
        scatter = ca.DM.triplet(
            [i for i, _ in wraps], list(range(len(wraps))), [1.0] * len(wraps), len(paths), len(wraps)
        )
        length, rate, moved = (
            s + ca.mtimes(scatter, e) for s, e in zip(straight, excess.call(points, True, False), strict=True)
        )
        strung = tensions(assembly.ligaments, length[:k], rate[:k]) if k else ca.MX(0, 1)
        force = drive if by_force else assembly._muscle_forces(length[k:], rate[k:], drive)
        phi = -1e-3 * ca.dot(ca.vertcat(strung, force), moved)
        for i, contact in enumerate(assembly.contacts):
            pose, pose_rate, along = (each[6 * i : 6 * i + 6] for each in poses)
            phi -= 1e-3 * ca.dot(generalised_forces(pose, assembly._wrench(contact, pose, pose_rate)), along)
        curvature = ca.hessian(phi, ca.vertcat(drive, C))[0]
        return (
            ca.Function("outer_slope", [C, drive], [ca.gradient(phi, C)]),
            ca.Function("outer_curvature", [C, drive], [curvature]),
        )


def networks_together(networks: Sequence[Network]) -> Callable[[Any], Any]:
    """Function of the stacked inputs of networks of one output each -> their outputs (n): one layer of all networks of
    a depth is one sparse product."""
    starts = np.cumsum([0, *(len(network.input_shift) for network in networks)])
    groups: dict[tuple[int, str], list[int]] = {}
    for i, network in enumerate(networks):
        groups.setdefault((len(network.weights), network.activation), []).append(i)

    def evaluate(inputs: Any) -> Any:
        order, parts = [], []
        for (_, activation), members in groups.items():
            own = [networks[i] for i in members]
            rows = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in members]).tolist()
            shift, scale = (np.concatenate([getattr(n, f"input_{key}") for n in own]) for key in ("shift", "scale"))
            a = (inputs[rows] - ca.DM(shift)) / ca.DM(scale)
            layers = list(zip(*([*zip(n.weights, n.biases, strict=True)] for n in own), strict=True))
            for number, layer in enumerate(layers):
                W = ca.diagcat(*(ca.sparsify(ca.DM(weight)) for weight, _ in layer))
                a = ca.mtimes(W, a) + ca.DM(np.concatenate([bias for _, bias in layer]))
                if number < len(layers) - 1:
                    (a,) = activation_of(activation).derivatives(ca, a, 0)
            parts.append(a * ca.DM([float(np.squeeze(n.output_scale)) for n in own]))
            order += members
        return ca.vertcat(*parts)[np.argsort(order).tolist()] if parts else ca.MX(0, 1)

    return evaluate
