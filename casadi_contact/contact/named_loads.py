"""A contact model by other named loads than its scene asks for: those that drive a motion need not be learned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import Array, load_jacobian, load_selection, possible_loads


class NamedLoads:
    """A contact model with these loads (L), made of its patches' wrenches and their derivatives."""

    def __init__(self, model: Any, load_names: Sequence[str]) -> None:
        self.scene, self.patch_names, self.load_names = model.scene, model.patch_names, tuple(load_names)
        self._model, self._selection = model, load_selection(load_names, model.patch_names)

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L) [N, N·mm]."""
        return np.einsum("lpk,npk->nl", self._selection, self._model.wrenches(poses))

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads (n, L) and their derivatives by the pose (n, L, 6)."""
        return load_jacobian(self._selection, *self._model.wrench_jacobian(poses))

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Those of the model: (n, patches), (n, patches, 6)."""
        found: tuple[Array, Array] = self._model.root_loads(poses)
        return found


def with_loads(model: ContactModel, names: Sequence[str]) -> ContactModel:
    """The model, or where it does not give all of these loads, `NamedLoads` of it.

    Raises ValueError for a load that no patch has, or that a model without ``wrench_jacobian`` does not give.
    """
    any_load = hasattr(model, "wrench_jacobian")
    for name in names:
        if name not in model.load_names and not (any_load and name in possible_loads(model.patch_names)):
            possible = possible_loads(model.patch_names) if any_load else model.load_names
            raise ValueError(f"unknown target {name!r}, expected one of {', '.join(possible)}")
    return model if set(names) <= set(model.load_names) else NamedLoads(model, names)
