"""Contact models that are CasADi functions too: what optimisation problems take, whatever is behind it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import casadi as ca
import numpy as np

from casadi_contact.contact.callback import model_callback
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array, check_loads, pose_or_poses
from casadi_contact.networks.functions import ContactFunctions


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
