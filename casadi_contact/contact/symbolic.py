"""Contact models without a kernel as CasADi functions with their own Jacobian; CasADi differences it for Hessians."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import casadi as ca
import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array, check_loads, pose_or_poses
from casadi_contact.networks.functions import ContactFunctions
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


class SymbolicContact(ContactModel, Protocol):
    """A `ContactModel` with CasADi functions: a surrogate, a foundation (`cc.foundation`), or `symbolic` of any other.

    record: plain values, with the learned range of poses as "pose_range" where there is one.
    """

    record: dict[str, Any]

    def __call__(self, poses: Array, loads: Iterable[str] | None = None) -> Array:
        """Named loads (n, loads) [N, N·mm], all or those asked for."""

    def check_loads(self, loads: Iterable[str] | None) -> tuple[str, ...]:
        """The loads asked for (None: all); ValueError for one that the model does not give."""

    def function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads",
        *,
        compiled: bool | None = None,
        batch: int | None = None,
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L); batch: (6 x batch) -> (L x batch)."""

    def load_and_root_function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads_and_roots",
        *,
        compiled: bool | None = None,
        batch: int | None = None,
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L), signed root loads (P)."""


def symbolic(model: ContactModel) -> SymbolicContact:
    """The model itself where it has CasADi functions, else called back from CasADi, with differenced Hessians."""
    return model if isinstance(model, ContactFunctions) else CallbackContact(model)


class CallbackContact(ContactFunctions, ContactModel):
    """Any contact model with CasADi functions that call it back, through Python, with its own Jacobian."""

    def __init__(self, model: ContactModel) -> None:
        self.model, self.scene = model, model.scene
        self.load_names, self.patch_names = model.load_names, model.patch_names
        self.record: dict[str, Any] = {}
        self.has_wrenches, self.has_gaps = model.has_wrenches, model.has_gaps

    def __repr__(self) -> str:
        return f"symbolic({self.model!r})"

    @pose_or_poses
    def __call__(self, poses: Array, loads: Iterable[str] | None = None) -> Array:
        """Named loads (n, loads) [N, N·mm], all or those asked for."""
        return self.model(poses)[:, [self.load_names.index(name) for name in self.check_loads(loads)]]

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """The model's loads and Jacobian."""
        return self.model.jacobian(poses)

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """The model's signed root loads and their derivatives."""
        return self.model.root_loads(poses)

    def wrenches(self, poses: Array) -> Array:
        """The model's wrenches (n, patches, 6)."""
        return self.model.wrenches(poses)

    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """The model's wrenches and their derivatives (n, patches, 6, 6)."""
        return self.model.wrench_jacobian(poses)

    def gaps(self, poses: Array) -> Array:
        """The model's gaps (n, patches) [mm]."""
        return self.model.gaps(poses)

    def at_edge(self, poses: Array) -> np.ndarray:
        """Where contact reaches a rim of the model (n, patches)."""
        return self.model.at_edge(poses)

    def check_loads(self, loads: Iterable[str] | None) -> tuple[str, ...]:
        """The loads asked for (None: all); ValueError where one is not the scene's."""
        return check_loads(self.load_names, loads)

    def _function(
        self, name: str, loads: Sequence[str], wanted: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        return model_callback(self.model, name, loads, wanted, batch)  # there is nothing to compile
