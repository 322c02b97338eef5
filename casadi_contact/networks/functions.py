"""CasADi functions of contact models: loads and root loads of a pose, with their own first and second derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array, check_loads, whole_number
from casadi_contact.networks.names import check_name


def checked_batch(batch: int | None) -> int | None:
    """The number of poses of a function; raises ValueError unless it is a whole number of 1 or more, or None."""
    return None if batch is None else whole_number("batch", batch, 1)


class ContactFunctions(ABC):
    """Functions of a pose that differ in what they give, made by one method, `_function`, of the model."""

    load_names: tuple[str, ...]

    def check_loads(self, loads: Iterable[str] | None) -> tuple[str, ...]:
        """The loads asked for (None: all); ValueError for one that the model does not give."""
        return check_loads(self.load_names, loads)

    def check_roots(self) -> None:
        """Raise ValueError where the model cannot give root loads."""
        return

    @abstractmethod
    def _function(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        """casadi.Function pose (6) -> outputs, some of "loads" and "roots"; batch: number of poses, checked."""

    def _parametric(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, parameters: Iterable[str]
    ) -> ca.Function:
        """casadi.Function pose (6), parameters (m) -> outputs; ValueError for a model that has no parameters."""
        raise ValueError(f"{self!r} takes no parameters, expected a foundation (cc.foundation)")

    def _moving(self, name: str, loads: Sequence[str], compiled: bool, parameters: Iterable[str]) -> ca.Function:
        """casadi.Function pose (6), velocity (6), and parameters (m) where there are any -> loads; ValueError for a
        model whose loads do not depend on velocities."""
        raise ValueError(f"{self!r} takes no velocity, expected an elastic foundation (cc.foundation)")

    def _made(
        self,
        name: str,
        loads: Iterable[str] | None,
        outputs: Sequence[str],
        compiled: bool,
        batch: int | None,
        parameters: Iterable[str],
        velocity: bool = False,
    ) -> ca.Function:
        names, frames = self.check_loads(loads), checked_batch(batch)
        if velocity:
            function = self._moving(check_name(name), names, compiled, parameters)
            return function if frames is None else function.map(frames)
        if "roots" in outputs:
            self.check_roots()
        if not parameters:
            return self._function(name, names if "loads" in outputs else (), outputs, compiled, frames)
        function = self._parametric(name, names, outputs, compiled, parameters)
        return function if frames is None else function.map(frames)

    def function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads",
        *,
        compiled: bool = True,
        batch: int | None = None,
        parameters: Iterable[str] = (),
        velocity: bool = False,
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L) with derivatives; batch: (6 x batch) -> (L x batch), in one call.

        Zero load has zero slope: an optimiser that lost contact stays there. Use `ContactInOpti`.
        Works in ``map`` and in nlpsol. compiled: whether to take a kernel in C where the model has one, compiled once
        and kept in the user's cache folder; where that fails, one warning and the slower form. A kernel has no third
        derivatives, and no file carries it (the library lies in the cache).
        A function of several poses at once has the name ``name_of_frames``.
        parameters: of a foundation some of `contact.symbolic.PARAMETERS`, a last input (m) in their order: the
        layer's material, and where the fixed body lies in the scene's frame, which pose and loads then refer to.
        velocity: of a foundation, a second input (6): the time derivative of the pose, tx..rz [mm/s, rad/s], with which
        loads hold the scene's friction and dissipation (`contact.friction`). Its coefficients then are parameters too.
        Raises ValueError for an unknown load or parameter and for a batch that is no whole number of 1 or more.
        """
        return self._made(name, loads, ("loads",), compiled, batch, parameters, velocity)

    def root_function(
        self,
        name: str = "contact_roots",
        *,
        compiled: bool = True,
        batch: int | None = None,
        parameters: Iterable[str] = (),
    ) -> ca.Function:
        """casadi.Function pose (6) -> signed root load of every patch (P); the rest as for `function`."""
        return self._made(name, None, ("roots",), compiled, batch, parameters)

    def load_and_root_function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads_and_roots",
        *,
        compiled: bool = True,
        batch: int | None = None,
        parameters: Iterable[str] = (),
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L), roots (P): both for the price of the loads; as `function`."""
        return self._made(name, loads, ("loads", "roots"), compiled, batch, parameters)


def _empty(name: str, like: ca.MX) -> ca.MX:
    """CasADi hands a Jacobian also the outputs it belongs to; they are not needed here, so they hold no entries."""
    return ca.MX.sym(name, ca.Sparsity(*like.shape))


def _attached(jacobian: ca.Function) -> dict[str, Any]:
    """Options that make CasADi use a Jacobian for every derivative; never inlined, so that it stays attached."""
    return {"custom_jacobian": jacobian, "jac_penalty": 0, "never_inline": True}


_NO_SEEDS = {"enable_forward": False, "enable_reverse": False}  # not through the graph either


def function_with_derivatives(name: str, pose: ca.MX, outputs: Mapping[str, tuple[ca.MX, ca.MX, ca.MX]]) -> ca.Function:
    """Function pose (6) -> outputs that carries its Jacobian, which in turn carries its own.

    outputs gives by name value (m), Jacobian (m x 6) and second derivatives (m x 36, see `Output`), best as three
    graphs that share nothing that is not needed. Every derivative CasADi asks for, forward or reverse, through
    ``map`` and in nlpsol, is then a product with one of them: no seeds are pushed through the networks.
    """
    check_name(name)
    outs: list[Any] = [_empty(f"out_{key}", value) for key, (value, _, _) in outputs.items()]
    jac_outs: list[Any] = [_empty(f"out_jac_{key}", jacobian) for key, (_, jacobian, _) in outputs.items()]
    out_names = [f"out_{key}" for key in outputs]
    jac_names = [f"jac_{key}_pose" for key in outputs]

    # Jacobian of the Jacobian: a row for each entry of its stacked columns. With (m x 36) stacked by columns of
    # 6 x 6 blocks, that is a relabelling. It does not depend on the empty outputs.
    seconds, second_names = [], []
    for jac_name, (_, jacobian, second) in zip(jac_names, outputs.values(), strict=True):
        seconds.append(ca.reshape(second, jacobian.numel(), 6))
        second_names.append(f"jac_{jac_name}_pose")
        for out, out_name in zip(outs, out_names, strict=True):
            seconds.append(ca.MX(jacobian.numel(), out.numel()))
            second_names.append(f"jac_{jac_name}_{out_name}")
    second_function = ca.Function(
        f"jac_jac_{name}",
        [pose, *outs, *jac_outs],
        seconds,
        ["pose", *out_names, *(f"out_{jac_name}" for jac_name in jac_names)],
        second_names,
    )
    jacobian_function = ca.Function(
        f"jac_{name}",
        [pose, *outs],
        [jacobian for _, jacobian, _ in outputs.values()],
        ["pose", *out_names],
        jac_names,
        _attached(second_function) | _NO_SEEDS,
    )
    values: list[Any] = [value for value, _, _ in outputs.values()]
    options = _attached(jacobian_function)
    graph = ca.Function(name, [pose], values, ["pose"], list(outputs), options | _NO_SEEDS)

    # `Function.factory` differentiates a function's own graph, under that function's options: with the networks in it,
    # or without seeds, that would be slow or fail. This one's graph is a call, which has the Jacobian.
    given = ca.MX.sym("pose", 6)
    return ca.Function(name, [given], graph.call([given]), ["pose"], list(outputs), options)


def as_weights(weights: ArrayLike, count: int, loads: Sequence[str]) -> Array:
    """Weights (count, L), from as many or (L,); raises ValueError for another shape."""
    given = np.asarray(weights, dtype=float)
    if given.shape not in ((len(loads),), (count, len(loads))):
        raise ValueError(
            f"weights has shape {given.shape}, expected ({len(loads)},) or ({count}, {len(loads)}): {', '.join(loads)}"
        )
    return np.ascontiguousarray(np.broadcast_to(given, (count, len(loads))))


def hessian_function(function: ca.Function) -> ca.Function:
    """pose (6), weights (L) -> second derivatives (6 x 6) of Σ weights·loads, of a function pose (6) -> loads (L), as
    nlpsol builds them."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    hessian, _ = ca.hessian(ca.dot(weights, function(pose)), pose)
    return ca.Function("hessian", [pose, weights], [ca.densify(hessian)])


def weighted_hessians(hessian: ca.Function, poses: Array, weights: Array) -> Array:
    """Second derivatives (n, 6, 6) by a `hessian_function`, for poses (n, 6) and weights (n, L)."""
    rows = [hessian(pose, of_pose).full() for pose, of_pose in zip(poses, weights, strict=True)]
    return np.stack(rows) if rows else np.empty((0, 6, 6))
