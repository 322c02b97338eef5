"""Friction and dissipation of a surrogate, from what its networks know of a patch at rest: its wrench.

The wrench (F, T) of a patch has N = |F| and the normal n = -F/N; its axis meets the fixed surface in the centre of
pressure c. There `contact.friction` holds at four points, each of which bears a quarter of the wrench,

    c ± s_1·e_1,   c ± s_2·e_2,   s_k = exp(α_k)·N^κ_k,   e_1 across n nearest to the patch's own axis, e_2 = n × e_1

so that they slide as the patch slides, leans and spins. Networks stay as they are: coefficients are inputs. The fixed
surface is a quadric fitted to its elements, x'A x + b·x + d = 0 with outward unit gradients; α, κ and the patch's axis
are those of pressures on elements in the poses about which the surrogate was calibrated, s_k·√(1/2) being the standard
deviation of where the pressure lies. Where a patch is free its wrench is zero, and so is what is made of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.foundation_source import C_FOLDER, definitions
from casadi_contact.contact.friction import coefficients_of, friction_factor, motions, whole_pressure
from casadi_contact.core.conventions import Array, load_selection
from casadi_contact.geometry.elements import ElementGrid
from casadi_contact.networks.kernel.source import Kernel, c_of_functions, c_text, guards, table
from casadi_contact.scenes.scene import Scene


def fitted_quadric(elements: ElementGrid) -> tuple[Array, Array, float]:
    """A (3, 3), b (3,) and d of the quadric through the elements' centres that has their normals as gradients."""
    c, n = elements.centres_mm, elements.normals
    i, j = np.triu_indices(3)
    size = max(float(np.abs(c).max()), 1.0)  # [mm], so that what is fitted counts alike
    values = np.hstack([c[:, i] * c[:, j], size * c, np.full((len(c), 1), size**2)]) / size**2
    unit = np.eye(3)
    slopes = unit[i][None] * c[:, j, None] + unit[j][None] * c[:, i, None]
    slopes = np.concatenate([slopes / size, np.broadcast_to(unit, (len(c), 3, 3)), np.zeros((len(c), 1, 3))], 1)
    rows = np.vstack([values, slopes.transpose(0, 2, 1).reshape(-1, 10)])
    found = np.linalg.lstsq(rows, np.concatenate([np.zeros(len(c)), n.ravel()]), rcond=None)[0]
    A = np.zeros((3, 3))
    A[i, j] = found[:6] / size
    return 0.5 * (A + A.T), found[6:9], size * float(found[9])


def measured_spreads(model: ElasticFoundation, poses: Array) -> Array:
    """Of each patch A, b, d of its surface, its axis, α and κ (patches, 20), from pressures at poses (n, 6); raises
    ValueError for a patch that three of them do not press."""
    seen: list[list[tuple[float, Array]]] = [[] for _ in model.patch_names]
    for found in map(model.pressure_maps, poses):
        for p, patch in enumerate(found):
            if patch.centre_mm is not None:
                off = patch.centres_mm - patch.centre_mm
                total = patch.forces_n.sum()
                seen[p].append((total, np.einsum("m,mi,mj->ij", patch.forces_n, off, off) / total))
    spreads = []
    for name, elements, rows in zip(model.patch_names, model.scene.elements(model.grid), seen, strict=True):
        if len(rows) < 3:
            raise ValueError(f"{len(rows)} calibration poses press the patch {name}, expected 3 or more for friction")
        force, moments = (np.array(column) for column in zip(*rows, strict=True))
        axes = np.linalg.eigh(moments.mean(axis=0))[1]
        across = np.stack([np.einsum("i,nij,j->n", axes[:, k], moments, axes[:, k]) for k in (2, 1)], 1)
        power, level = np.polyfit(np.log(force), 0.5 * np.log(2.0 * np.maximum(across, 1e-6)), 1)
        A, b, d = fitted_quadric(elements)
        spreads.append(np.concatenate([A.ravel(), b, [d], axes[:, 2], level, power]))
    return np.array(spreads)


class Steps(list[tuple[ca.SX, ca.SX]]):
    """Symbols that stand for steps of a formula, in turn. Derivatives are products of those of steps, half as long as
    what CasADi finds through the whole formula."""

    def __call__(self, expression: Any) -> ca.SX:
        """A symbol (m) in place of an expression (m)."""
        self.append((ca.SX.sym("step", expression.numel()), expression))
        return self[-1][0]

    def derivatives(self, value: Any, by: Any) -> list[Any]:
        """Value (1) by symbols (n): it, its gradient (n), its Hessian (n × n), without the steps."""
        H, gradient = ca.hessian(value, x := ca.vertcat(by, *(symbol for symbol, _ in self)))
        for symbol, expression in reversed(self):
            m = x.numel() - symbol.numel()
            x, of = x[:m], gradient[m:]
            J, bend = ca.jacobian(expression, x), ca.hessian(ca.dot(symbol, expression), x)[0]
            half = J.T @ (H[m:, :m] + 0.5 * H[m:, m:] @ J)
            H = ca.triu2symm(ca.triu(H[:m, :m] + half + half.T + ca.substitute(bend, symbol, of)))
            gradient = gradient[:m] + J.T @ of
        symbols, expressions = map(list, zip(*self, strict=True))
        return ca.substitute_inplace(symbols, expressions, [value, gradient, H])[1]


@cache
def law_functions(size: int) -> list[ca.Function]:
    """The law of one patch as three functions of its motion m (11, `motion_functions`), its wrench at rest w (6),
    numbers (20) of `measured_spreads`, and weights λ (6). law_value gives the wrench F (6). law_first gives F, and its
    derivatives by the first `size` numbers of m and by w. law_second gives the derivatives of λ·F by m, w, m and m, w
    and m, w and w."""
    motion, wrench, numbers, weights = (ca.SX.sym("given", count) for count in (11, 6, 20, 6))
    A, b, d, axis, level, power = ca.vertsplit(numbers, np.cumsum([0, 9, 3, 1, 3, 2, 2]).tolist())
    A, step = ca.reshape(A, 3, 3), Steps()
    force = step(ca.sqrt(ca.sumsqr(wrench[:3]) + 2.0**-40))
    n = step(-wrench[:3] / force)
    foot, lean = step(ca.cross(wrench[3:] / force, n)), step(ca.dot(axis, n))
    steep, left = step(ca.dot(2.0 * A @ foot + b, n)), step(ca.dot(foot, A @ foot + b) + d)
    under = step(ca.bilin(A, n, n))
    drop = step(2.0 * left / (steep + ca.sqrt(ca.fmax(steep**2 - 4.0 * under * left, 1e-6))))
    across = step(ca.sumsqr(axis - lean * n))
    reach = step(ca.exp(level + power * ca.log(force)) / ca.sqrt(across + 1e-12))
    centre = step(foot - drop * n)
    first, second = step(reach[0] * (axis - lean * n)), step(reach[1] * ca.cross(n, axis))
    pressed, total = step(ca.dot(weights, wrench)), ca.SX(0.0)
    for c in (centre + first, centre - first, centre + second, centre - second):
        c = step(c)
        w, pull = (step(way[:3] + ca.cross(way[3:6], c)) for way in (motion, weights))
        approach = step(-ca.dot(n, w))
        square, dragged = step(ca.sumsqr(w) - approach**2), step(ca.dot(pull, w + approach * n))
        f = step(friction_factor(ca.vertsplit(motion[6:]), square, ca)[0])
        whole = step(whole_pressure(1.0 + motion[10] * approach, ca)[0])
        total += 0.25 * whole * (pressed + (force - 2.0**-40 / force) * f * dragged)  # nothing where the patch is free
    _, gradient, H = step.derivatives(total, ca.vertcat(motion, wrench, weights))
    L, of, given = slice(0, size), slice(11, 17), [motion, wrench, numbers, weights]
    # The wrench is the gradient by the weights, whatever these are.
    moved, slopes = ca.substitute([gradient[17:], H[17:, :17]], [weights], [ca.SX.zeros(6)])
    found = {
        "law_value": [moved],
        "law_first": [moved, ca.horzcat(slopes[:, L], slopes[:, of])],
        "law_second": [gradient[L], gradient[of], H[L, L], H[of, L], H[of, of]],
    }
    constant = {"is_diff_in": [True, True, False, False]}
    return [ca.Function(name, given, [*map(ca.densify, ca.cse(parts))], constant) for name, parts in found.items()]


class SlidingPatches:
    """Friction of a surrogate: what was measured of its scene's patches, and `shares` (L,) of Σ μ·N below which 95 % of
    its loads' errors lie where bodies slide, against the same law summed over elements; torques' in N·mm for each N."""

    def __init__(self, scene: Scene, poses: Array) -> None:
        self.patch_names = scene.patch_names
        rough = {"static_friction": 1.0, "dynamic_friction": 1.0, "transition_velocity": 0.1, "dissipation": 0.0}
        sliding = scene.with_overrides(**rough)
        model = ElasticFoundation(sliding, sliding.grids["settle"])
        self.spreads = measured_spreads(model, poses)
        rates = np.random.default_rng(0).normal(size=poses.shape) * [30.0, 30.0, 30.0, 1.0, 1.0, 1.0]
        still, moving, coefficients = (
            model.wrenches(poses),
            model.wrenches(poses, rates),
            coefficients_of(sliding.friction),
        )
        at_rest, motion = ca.MX.sym("at_rest", still[0].size), ca.MX.sym("motion", 11)
        law = ca.Function("law", [at_rest, motion], [self.wrenches(at_rest, motion)])
        loads = load_selection(scene.load_names, scene.patch_names).reshape(len(scene.load_names), -1)
        made = np.asarray(law(still.reshape(len(poses), -1).T, motions(poses, rates, coefficients)[0].T)).T
        force = np.linalg.norm(still[..., :3], axis=2).sum(axis=1)
        missed = np.abs((made - moving.reshape(made.shape)) @ loads.T)[force > scene.boundary_load]
        self.shares = np.quantile(missed / force[force > scene.boundary_load, None], 0.95, axis=0)

    def wrenches(self, at_rest: Any, motion: Any) -> Any:
        """Wrenches (6·P) of the patches, from those at rest, of a twist about the origin and coefficients (11)."""
        law, parts = law_functions(6)[0], zip(self.spreads, ca.vertsplit(at_rest, 6), strict=True)
        return ca.vertcat(*(law(motion, own, spread, 0.0) for spread, own in parts))

    def function(self, still: ca.Function, name: str, loads: Sequence[str], motion: ca.Function) -> ca.Function:
        """casadi.Function x -> loads, from that of the wrenches at rest and that of the motion of x."""
        given = ca.MX.sym("x", motion.numel_in(0))
        selection = ca.sparsify(ca.DM(load_selection(loads, self.patch_names).reshape(len(loads), -1)))
        moving = self.wrenches(still(given[:6]), motion(given))
        return ca.Function(name, [given], [selection @ moving], ["x"], ["loads"])

    def sources(self, still: Kernel, loads: Sequence[str], motion: Sequence[ca.Function]) -> tuple[str, str]:
        """C of the same, from the kernel of the wrenches at rest: `moving_guarded_value` and its like; and of the law,
        which it calls, the same for all scenes."""
        patches, inputs = len(self.patch_names), motion[0].numel_in(0)
        sizes = {"PATCHES": patches, "MOVED": len(loads), "MOVING": 1, "VARIABLES": inputs, "LOCALS": inputs - 6}
        code = [
            table("selection", load_selection(loads, self.patch_names).swapaxes(0, 1)),
            table("spreads", self.spreads),
            c_of_functions(motion),
            c_text("moving.h", C_FOLDER),
            c_text("sliding.h", __package__),
            guards("moving_", loads="MOVED", roots="0", inputs="VARIABLES"),
        ]
        beside = Kernel([], "\n".join(code))
        whole = [*definitions(sizes), still.source(loads=6 * patches, roots=0, beside=beside)]
        return "\n".join(whole), c_of_functions(law_functions(inputs - 6), "")
