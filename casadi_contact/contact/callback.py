"""Contact models without a kernel as CasADi functions with their own Jacobian; CasADi differences it for Hessians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.networks.names import check_name

Output = tuple[str, int, Callable[[Array], tuple[Array, Array]]]  # name, rows m, poses -> (n, m), (n, m, 6)
_KEPT: list[ca.Callback] = []  # CasADi does not keep the Python side of a callback alive


def contact_callback(name: str, outputs: Sequence[Output], size: int = 6) -> ca.Function:
    """casadi.Function pose (6) -> outputs by name, through Python; derivatives as the outputs give them.

    size: numbers of the input, for more than a pose.
    """
    callback = _Values(check_name(name), outputs, size)
    _KEPT.append(callback)
    return callback


def model_callback(
    model: ContactModel, name: str, loads: Sequence[str], wanted: Sequence[str], batch: int | None = None
) -> ca.Function:
    """casadi.Function pose (6) -> the wanted ones of "loads", "roots" of a contact model; batch: of so many poses."""
    rows = [model.load_names.index(load) for load in loads]

    def some_loads(poses: Array) -> tuple[Array, Array]:
        values, slopes = model.jacobian(poses)
        return values[:, rows], slopes[:, rows]

    outputs = {"loads": (len(loads), some_loads), "roots": (len(model.patch_names), model.root_loads)}
    function = contact_callback(name, [(key, *outputs[key]) for key in wanted])
    return function if batch is None else function.map(batch)


class _Values(ca.Callback):
    def __init__(self, name: str, outputs: Sequence[Output], size: int) -> None:
        super().__init__()
        self._outputs, self._size = outputs, size
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_name_in(self, i: int) -> str:
        return "pose"

    def get_name_out(self, i: int) -> str:
        return self._outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._size, 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._outputs[i][1], 1)

    def eval(self, arg: Sequence[Any]) -> list[Array]:
        """CasADi's call; NaN for a pose that is not finite."""
        pose = np.array(arg[0], dtype=float).reshape(1, self._size)
        if not np.isfinite(pose).all():
            return [np.full(rows, np.nan) for _, rows, _ in self._outputs]
        return [model(pose)[0][0] for _, _, model in self._outputs]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> ca.Function:
        jacobian = _Jacobians(name, self._outputs, self._size, opts)
        _KEPT.append(jacobian)
        return jacobian


class _Jacobians(ca.Callback):
    def __init__(self, name: str, outputs: Sequence[Output], size: int, options: Any) -> None:
        super().__init__()
        self._outputs, self._size = outputs, size
        self.construct(name, {**options, "enable_fd": True, "fd_method": "central"})

    def get_n_in(self) -> int:
        return 1 + len(self._outputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        if i == 0:
            return ca.Sparsity.dense(self._size, 1)
        return ca.Sparsity(self._outputs[i - 1][1], 1)  # an output, which is not needed

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._outputs[i][1], self._size)

    def eval(self, arg: Sequence[Any]) -> list[Array]:
        """CasADi's call; NaN for a pose that is not finite."""
        pose = np.array(arg[0], dtype=float).reshape(1, self._size)
        if not np.isfinite(pose).all():
            return [np.full((rows, self._size), np.nan) for _, rows, _ in self._outputs]
        return [model(pose)[1][0] for _, _, model in self._outputs]
