"""Polar quadrature asked against elements: rays see one spot within the rim, and more rays see no more of it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.contact.convergence import Errors, NotGoodEnoughError, cure_of
from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.core.conventions import Array, load_selection
from casadi_contact.scenes.scene import Scene

ELEMENTS, _HALF = (320, 160), (160, 80)  # of a patch
_MOST_APART = 0.02  # of the poses: a few of a wide draw are no reason against a model that is right in all others


def share_apart(scene: Scene, pressed: list[tuple[Array, Array, Array]]) -> float:
    """The share of poses in which some load differs from that of `ELEMENTS` by more than one pose may be wrong
    (`convergence.Errors`) and twice what elements half as fine differ by.

    pressed: of each patch rotations (m, 3, 3), translations (m, 3) and wrenches (m, 6) by rays. Raises
    NotGoodEnoughError where the share is more than a few.
    """
    fine, half = (ElasticFoundation(scene, grid) for grid in (ELEMENTS, _HALF))
    selection = load_selection(scene.load_names, scene.patch_names)
    apart: list[np.ndarray] = []
    for p, (R, t, wrench) in enumerate(pressed):
        if not len(t):
            continue
        poses = np.column_stack([t, Rotation.from_matrix(R).as_euler("XYZ")])
        wanted, rough = (model.wrenches(poses)[:, p] for model in (fine, half))
        forces_n = np.linalg.norm(wanted[:, :3], axis=1)
        off, unsure = (np.abs((found - wanted) @ selection[:, p].T) for found in (wrench, rough))
        errors = Errors(scene, np.maximum(off - 2.0 * unsure, 0.0), forces_n, np.zeros(len(t), dtype=bool))
        apart.append(np.any(errors.of_allowed > 1.0, axis=1))
    share = float(np.mean(np.concatenate(apart))) if apart else 0.0
    if share > _MOST_APART:
        raise NotGoodEnoughError(
            f"scene {scene.name}: rays and {grid_text(ELEMENTS)} elements differ by more than its tolerances allow in "
            f"{share:.0%} of the poses that were tried, because contact is more than one spot there: {cure_of(scene)}"
        )
    return share
