"""The shape of a scene without geometry: its contact model is the user's own, or a table of samples.

    shape = "own_model"
    [geometry.patches]     each with its anchor on the moving body [mm], the body's origin if left out
    contact = { anchor = [0.0, 0.0, 0.0] }

Such a scene needs neither [material] nor [grids].
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from casadi_contact.conventions import Array

OWN_MODEL = "own_model"
_CURE = "expected [geometry.patches] with a table for each patch, for example contact = { anchor = [0.0, 0.0, 0.0] }"


def check_own_geometry(values: Mapping[str, Any]) -> dict[str, Any]:
    """The [geometry] of such a scene, checked; raises ValueError saying what is expected."""
    patches = values["patches"]
    if not isinstance(patches, Mapping) or not patches:
        raise ValueError(f"scene: geometry.patches = {patches!r}, {_CURE}")
    for name, patch in patches.items():
        anchor = patch.get("anchor", [0.0, 0.0, 0.0]) if isinstance(patch, Mapping) else None
        if not name.isidentifier() or "_" in name or set(patch) - {"anchor"}:
            raise ValueError(f"scene: geometry.patches.{name} = {patch!r}, {_CURE}")
        if not isinstance(anchor, list) or len(anchor) != 3 or not np.isfinite(np.asarray(anchor, dtype=float)).all():
            raise ValueError(f"scene: geometry.patches.{name}.anchor = {anchor!r}, expected three numbers [mm]")
    return dict(values)


def own_anchors(geometry: Mapping[str, Any]) -> Array:
    """Anchors of the patches on the moving body (patches, 3) [mm]."""
    return np.array([patch.get("anchor", [0.0, 0.0, 0.0]) for patch in geometry["patches"].values()], dtype=float)
