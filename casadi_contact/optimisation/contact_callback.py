"""The total contact wrench as a CasADi function: a model's own, or the model called back with its Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact import ContactModel, SymbolicContact
from casadi_contact.conventions import Array
from casadi_contact.optimisation.total_wrench import total_selection


class ContactCallback(ca.Callback):
    """Pose (6) -> total wrench on the fixed body (6) [N, N·mm], with the model's analytic Jacobian.

    Values and Jacobians pass through CasADi's buffers without a copy. CasADi does not keep a callback alive: hold
    on to it while functions that call it are used. ``values`` and ``jacobians`` count the model's evaluations.
    """

    def __init__(self, model: ContactModel, name: str = "contact_wrench") -> None:
        super().__init__()
        self.values = 0
        self.jacobians = 0
        self._model = model
        self._total = total_selection(model.load_names)
        self._jacobian: _JacobianCallback | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        """One input: the pose."""
        return 1

    def get_n_out(self) -> int:
        """One output: the wrench."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Six dense numbers."""
        return ca.Sparsity.dense(6, 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Six dense numbers."""
        return ca.Sparsity.dense(6, 1)

    def has_eval_buffer(self) -> bool:
        """Numbers pass without a copy."""
        return True

    def eval_buffer(self, arg: Sequence[Any], res: Sequence[Any]) -> int:
        """CasADi's call: pose in arg[0], wrench into res[0]."""
        self.values += 1
        pose = np.frombuffer(arg[0], dtype=np.float64)
        np.frombuffer(res[0], dtype=np.float64)[:] = self._total @ self._model(pose[None])[0]
        return 0

    def has_jacobian(self) -> bool:
        """The model has its own."""
        return True

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> ca.Function:
        """The model's analytic Jacobian, kept alive here."""
        self._jacobian = _JacobianCallback(self, name, opts)
        return self._jacobian

    def wrench_jacobian(self, pose: Array) -> Array:
        """d wrench / d pose (6, 6) at a pose (6)."""
        self.jacobians += 1
        return np.asarray(self._total @ self._model.jacobian(pose[None])[1][0])


class _JacobianCallback(ca.Callback):
    """Pose (6), wrench (not needed) -> d wrench / d pose (6, 6)."""

    def __init__(self, of: ContactCallback, name: str, options: Any) -> None:
        super().__init__()
        self._of = of
        self.construct(name, options)

    def get_n_in(self) -> int:
        return 2

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity(6, 1) if i else ca.Sparsity.dense(6, 1)  # no entries: the wrench is not evaluated for it

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(6, 6)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arg: Sequence[Any], res: Sequence[Any]) -> int:
        """CasADi's call: pose in arg[0], Jacobian, column by column, into res[0]."""
        pose = np.frombuffer(arg[0], dtype=np.float64)
        np.frombuffer(res[0], dtype=np.float64)[:] = self._of.wrench_jacobian(pose).ravel("F")
        return 0


def wrench_function(model: ContactModel, name: str = "contact_wrench") -> ca.Function:
    """casadi.Function pose (6) -> total contact wrench on the fixed body (6), about its origin [N, N·mm].

    A surrogate or foundation gives its own compiled function with exact derivatives; any other contact model is called
    back, with its analytic Jacobian. Raises ValueError where the model lacks a component of the wrench.
    """
    if not isinstance(model, SymbolicContact):
        return ContactCallback(model, name)
    pose = ca.MX.sym("pose", 6)
    loads = model.function(name=f"{name}_loads", compiled=True)(pose)
    return ca.Function(name, [pose], [ca.mtimes(ca.sparsify(ca.DM(total_selection(model.load_names))), loads)])
