"""CasADi functions of contact models: loads and root loads of a pose, and their second derivatives."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence

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
        """The chosen loads (None: all); ValueError for one that the model does not give."""
        return check_loads(self.load_names, loads)

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
        """casadi.Function pose (6), velocity (6), parameters (m) if any -> loads; ValueError where none depends."""
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
        derivatives, and no file carries it (the library lies in the cache). Of several poses it is ``name_of_frames``.
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


def as_weights(weights: ArrayLike, count: int, loads: Sequence[str]) -> Array:
    """Weights (count, L), from as many or (L,); raises ValueError for another shape."""
    given = np.asarray(weights, dtype=float)
    if given.shape not in ((len(loads),), (count, len(loads))):
        raise ValueError(f"weights has shape {given.shape}, expected ({len(loads)},) or ({count}, {len(loads)})")
    return np.ascontiguousarray(np.broadcast_to(given, (count, len(loads))))


def hessian_function(function: ca.Function) -> ca.Function:
    """pose (6), weights (L) -> second derivatives (6 x 6) of Σ weights·loads of a function pose (6) -> loads (L)."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    hessian, _ = ca.hessian(ca.dot(weights, function(pose)), pose)
    return ca.Function("hessian", [pose, weights], [ca.densify(hessian)])


def weighted_hessians(hessian: ca.Function, poses: Array, weights: Array) -> Array:
    """Second derivatives (n, 6, 6) by a `hessian_function`, for poses (n, 6) and weights (n, L)."""
    rows = [hessian(pose, of_pose).full() for pose, of_pose in zip(poses, weights, strict=True)]
    return np.stack(rows) if rows else np.empty((0, 6, 6))
