"""How large a scene's cells may be: the largest whose errors, against much smaller ones, stay within its tolerances."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation, cell_patches
from casadi_contact.contact.cells.reach import pressed_poses
from casadi_contact.contact.convergence import cheapest, forces_tried
from casadi_contact.conventions import Array, load_selection
from casadi_contact.scenes import Scene

SIZES_MM = (2.4, 1.7, 1.2, 0.85, 0.6)
CONVERGED = Cells(0.6, 0.45)
_POSES = 48
_SUB_POINT_MM = 0.3


def cell_foundation(scene: Scene, *, compiled: bool = True) -> CellFoundation:
    """The foundation in the largest cells that meet the scene's tolerances.

    Over poses that press each patch within its rim from the scene's boundary load to `convergence.LARGEST_LOAD`
    reference loads, errors against `CONVERGED` have an RMS within the tolerance and are nowhere more than
    `convergence.WORST` times it, in proportion to the force where that exceeds the reference load. Along each side
    cells are as large as one of `SIZES_MM`. Raises ValueError where nothing is good enough and where no pose presses
    the patches.
    """
    truth = _Truth(scene)
    models = (CellFoundation(scene, cells, compiled=compiled) for cells in CANDIDATES)
    model = cheapest(scene, models, truth.errors, truth.force_n, model="cubic cells", against=str(CONVERGED))
    model.record |= {
        "cells_mm": [model.cells.u_mm, model.cells.v_mm],
        "sub_points": [model.cells.along_u, model.cells.along_v],
    }
    return model


class _Truth:
    """Poses that press each patch, and the wrenches of converged cells there."""

    def __init__(self, scene: Scene) -> None:
        self.poses, self.wrenches = [], []
        for patch, coarse in zip(cell_patches(scene, CONVERGED), cell_patches(scene, CANDIDATES[0]), strict=True):
            R, t = pressed_poses(coarse, scene.start_pose, forces_tried(scene), _POSES)
            self.poses.append((R, t))
            self.wrenches.append(np.array([patch.wrench(*pose) for pose in zip(R, t, strict=True)]).reshape(-1, 6))
        if not any(len(t) for _, t in self.poses):
            raise ValueError(
                f"scene {scene.name}: the moving body, near its start pose, touches no patch within its rim when it "
                "comes down on it; check the axes and the patches' boxes, or take cc.ElasticFoundation"
            )

        self.force_n = np.linalg.norm(np.concatenate(self.wrenches)[:, :3], axis=1)

    def errors(self, model: CellFoundation) -> Array:
        """Errors of the named loads (poses, loads), each pose with one patch pressed."""
        selection = load_selection(model.load_names, model.patch_names)
        errors = []
        for p, patch in enumerate(model.patches):
            found = np.array([patch.wrench(*pose) for pose in zip(*self.poses[p], strict=True)]).reshape(-1, 6)
            errors.append((found - self.wrenches[p]) @ selection[:, p].T)
        return np.concatenate(errors)


def _sized(u_mm: float, v_mm: float) -> Cells:
    """Cells with sub-points about `_SUB_POINT_MM` apart."""
    u, v = (max(3, round(size / _SUB_POINT_MM)) for size in (u_mm, v_mm))
    return Cells(u_mm, v_mm, u, v)


CANDIDATES = sorted((_sized(u, v) for u in SIZES_MM for v in SIZES_MM), key=lambda cells: -cells.u_mm * cells.v_mm)
