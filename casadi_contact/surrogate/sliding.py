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
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.friction import coefficients_of, friction_factor, twist_about_origin, whole_pressure
from casadi_contact.core.compiler import CompilerError, shared_library, warn_once
from casadi_contact.core.conventions import Array, load_selection
from casadi_contact.geometry.elements import ElementGrid
from casadi_contact.networks.frames import angular_velocity_map
from casadi_contact.scenes.material import Friction
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


class Spread(NamedTuple):
    """Of one patch: its fixed surface (A, b, d), its axis (3,), α (2,) and κ (2,); arrays, or CasADi's symbols."""

    surface: tuple[Any, Any, Any]
    axis: Any
    level: Any
    power: Any

    @property
    def numbers(self) -> Array:
        """All of it (20,), one after another."""
        return np.concatenate([np.ravel(part) for part in (*self.surface, self.axis, self.level, self.power)])

    def points(self, wrench: Any) -> tuple[Any, Any, Any]:
        """N, n (3) and the four points (3 x 4) of a wrench (6)."""
        force, (A, b, d) = wrench[:3], self.surface
        square = ca.sumsqr(force) + 1e-12
        size = ca.sqrt(square)
        n, foot = -force / size, ca.cross(force, wrench[3:]) / square
        steep = ca.dot(2.0 * ca.mtimes(A, foot) + b, n)
        left = ca.dot(foot, ca.mtimes(A, foot) + b) + d
        under = ca.fmax(steep**2 - 4.0 * ca.bilin(A, n, n) * left, 1e-6)
        centre = foot - 2.0 * left / (steep + ca.sqrt(under)) * n
        across = self.axis - n * ca.dot(self.axis, n)
        first = across / ca.sqrt(ca.sumsqr(across) + 1e-12)
        reach = [ca.exp(self.level[k]) * size ** self.power[k] for k in range(2)]
        ways = [side * way for way in (reach[0] * first, reach[1] * ca.cross(n, first)) for side in (1.0, -1.0)]
        return size, n, ca.horzcat(*(centre + way for way in ways))


def measured_spreads(model: ElasticFoundation, poses: Array) -> list[Spread]:
    """Of each patch, from pressures at poses (n, 6); raises ValueError for a patch that three of them do not press."""
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
        spreads.append(Spread(fitted_quadric(elements), axes[:, 2], level, power))
    return spreads


@cache
def sliding_law(*, compiled: bool) -> ca.Function:
    """casadi.Function (twist about the origin (6), wrench at rest (6), coefficients (5)) of one patch, numbers of its
    `Spread` (20) -> its wrench (6). Compiled: C that CasADi writes of it and of its derivatives, once for all scenes;
    without a compiler, with one warning, CasADi runs it."""
    x, numbers = ca.SX.sym("x", 17), ca.SX.sym("numbers", 20)
    twist, wrench, coefficients = x[:6], x[6:12], x[12:]
    A, b, d, axis, level, power = ca.vertsplit(numbers, np.cumsum([0, 9, 3, 1, 3, 2, 2]).tolist())
    size, n, points = Spread((ca.reshape(A, 3, 3), b, d), axis, level, power).points(wrench)
    total = 0.0
    for c in ca.horzsplit(points):
        w = twist[:3] + ca.cross(twist[3:], c)
        approach = -ca.dot(n, w)
        slide = w + approach * n
        f = friction_factor(ca.vertsplit(coefficients), ca.sumsqr(slide), ca)[0]
        whole = whole_pressure(1.0 + coefficients[4] * approach, ca)[0]
        total += 0.25 * whole * (wrench + size * f * ca.vertcat(slide, ca.cross(c, slide)))
    constant: dict[str, Any] = {"is_diff_in": [True, False]}
    law = ca.Function("sliding", [x, numbers], [total], constant)
    if not compiled:
        return law
    generator, adjoint = ca.CodeGenerator("sliding"), law.reverse(1)
    for each in (law, law.jacobian(), adjoint, adjoint.jacobian()):
        generator.add(each)
    try:
        library = shared_library(generator.dump(), "friction of surrogates, some seconds")
    except CompilerError as error:
        warn_once(f"{error}; friction of surrogates runs in CasADi, which is slower")
        return law
    # Forward sensitivities are products with the Jacobian, which is in the library.
    return ca.external("sliding", str(library), constant | {"enable_forward": False, "jac_penalty": -1.0})


class SlidingPatches:
    """Friction of a surrogate: what was measured of its scene's patches, and `shares` (L,) of Σ μ·N below which 95 % of
    its loads' errors lie where bodies slide, against the same law summed over elements; torques' in N·mm for each N."""

    def __init__(self, scene: Scene, poses: Array) -> None:
        self.patch_names = scene.patch_names
        sliding = scene.with_overrides(
            static_friction=1.0, dynamic_friction=1.0, transition_velocity=0.1, dissipation=0.0
        )
        model = ElasticFoundation(sliding, sliding.grids["settle"])
        self.spreads = measured_spreads(model, poses)
        rates = np.random.default_rng(0).normal(size=poses.shape) * [30.0, 30.0, 30.0, 1.0, 1.0, 1.0]
        still, moving = model.wrenches(poses), model.wrenches(poses, rates)
        twists, coefficients = twist_about_origin(poses, rates)[0], coefficients_of(sliding.friction)
        at_rest, found = ca.MX.sym("at_rest", still[0].size), ca.MX.sym("twist", 6)
        law = ca.Function("law", [at_rest, found], [self.wrenches(at_rest, found, ca.DM(coefficients))])
        loads = load_selection(scene.load_names, scene.patch_names).reshape(len(scene.load_names), -1)
        made = np.asarray(law(still.reshape(len(poses), -1).T, twists.T)).T
        force = np.linalg.norm(still[..., :3], axis=2).sum(axis=1)
        missed = np.abs((made - moving.reshape(made.shape)) @ loads.T)[force > scene.boundary_load]
        self.shares = np.quantile(missed / force[force > scene.boundary_load, None], 0.95, axis=0)

    def wrenches(self, at_rest: Any, twist: Any, coefficients: Any, *, compiled: bool = False) -> Any:
        """Wrenches (6·P) of the patches, from those at rest."""
        law, parts = sliding_law(compiled=compiled), zip(self.spreads, ca.vertsplit(at_rest, 6), strict=True)
        return ca.vertcat(*(law(ca.vertcat(twist, own, coefficients), spread.numbers) for spread, own in parts))

    def function(
        self, still: ca.Function, name: str, loads: Sequence[str], size: int, friction: Friction, *, compiled: bool
    ) -> ca.Function:
        """casadi.Function pose, its rates, and with size 17 coefficients -> loads, from one of the wrenches at rest."""
        x, given = ca.SX.sym("x", 12), ca.MX.sym("x", size)
        turn = ca.mtimes(angular_velocity_map(x[3:6]), x[9:])
        twist = ca.Function("twist", [x], [ca.vertcat(x[6:9] - ca.cross(turn, x[:3]), turn)])(given[:12])
        coefficients = given[12:] if size > 12 else ca.DM(coefficients_of(friction))
        moving = self.wrenches(still(given[:6]), twist, coefficients, compiled=compiled)
        selection = ca.sparsify(ca.DM(load_selection(loads, self.patch_names).reshape(len(loads), -1)))
        return ca.Function(name, [given], [selection @ moving], ["x"], ["loads"])
