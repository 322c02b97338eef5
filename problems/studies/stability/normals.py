"""Normal loads from named loads: peers and surrogates know no wrenches."""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.scenes.normal_load import NormalLoad


def patch_wrench(model: Any, normal: NormalLoad, loads: Array) -> Array:
    """Named loads (n, L, ...) that a normal load is made of, in their places of a wrench (n, 6, ...) of zeros."""
    columns = [model.load_names.index(name) for name in normal.loads]
    wrench = np.zeros((len(loads), 6, *loads.shape[2:]))
    wrench[:, slice(0, 3) if normal.index is None else [normal.index]] = loads[:, columns]
    return wrench


def normal_of(model: Any, loads: Array) -> Array:
    """Normal load (n, patches) of named loads (n, L), below zero where a patch pulls."""
    return np.stack([normal.of(patch_wrench(model, normal, loads)) for normal in model.scene.normal_loads], axis=1)
