"""Loads with the wrong sign: those on the moving body instead of the fixed one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.touch import ways_of_pressing
from casadi_contact.conventions import Array, pose_text

_POSES = 5
_PRESSED_MM, _MOVED_MM = 0.3, 0.1
_CLEARLY = 0.01  # more than this share: noise of a model is less


def refuse_reversed_loads(model: ContactModel, touching: Array, wanted: Mapping[str, Array]) -> None:
    """Raise ValueError for a model whose contacts carry less where they are pressed on.

    A force F on the fixed body grows as the moving one goes its way: |F(t + δ·F/|F|)| > |F(t - δ·F/|F|)|. Asked are up
    to 5 of the poses (n, 6) at the first touch, pressed by 0.3 mm; a model is refused where each patch that carries
    load there loses more than 1 % of it over 2δ = 0.2 mm. wanted: loads (n,) by name, as `first_touch` takes them.
    """
    wrenches = getattr(model, "wrenches", None)
    if wrenches is None or not len(touching):
        return
    chosen = np.unique(np.linspace(0, len(touching) - 1, _POSES).astype(int))
    poses = touching[chosen]
    poses[:, :3] += _PRESSED_MM * ways_of_pressing(model, len(touching), wanted)[chosen]
    forces = wrenches(poses)[..., :3]
    size = np.linalg.norm(forces, axis=2)
    rows, patches = np.nonzero(size > 0.0)
    if not len(rows):
        return

    def carried(way_mm: float) -> Array:
        moved = poses[rows]
        moved[:, :3] += way_mm * forces[rows, patches] / size[rows, patches, None]
        return np.asarray(np.linalg.norm(wrenches(moved)[np.arange(len(rows)), patches, :3], axis=1))

    behind, ahead = carried(-_MOVED_MM), carried(_MOVED_MM)
    if (ahead < (1.0 - _CLEARLY) * behind).all():
        force = ", ".join(f"{value:.4g}" for value in forces[rows[0], patches[0]])
        raise ValueError(
            f"the contact model's loads are those on the moving body: its force ({force}) N of patch "
            f"{model.patch_names[patches[0]]} at {pose_text(poses[rows[0]], model.patch_names)} is {behind[0]:.4g} N "
            f"0.1 mm behind and {ahead[0]:.4g} N 0.1 mm ahead, expected more ahead: return -wrenches, the loads on the "
            "fixed body"
        )
