"""How large a scene's cells may be: the largest whose errors, against much smaller ones, stay within its tolerances."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation, cell_patches
from casadi_contact.contact.cells.reach import pressed_poses
from casadi_contact.contact.convergence import WORST, forces_tried
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
    range_n = forces_tried(scene)
    tolerances = np.array([scene.tolerances[name] for name in scene.load_names])
    truth = _Truth(scene, range_n)
    for cells in CANDIDATES:
        errors = truth.errors(cells)
        if truth.misses(errors, tolerances) <= 1.0:
            break
    else:
        worst = int(np.argmax(errors.max(axis=0) / tolerances))
        raise ValueError(
            f"scene {scene.name}: {cells} are wrong by up to {errors[:, worst].max():.3g} in "
            f"{scene.load_names[worst]}, expected less: relax the scene's tolerances, or take cc.ElasticFoundation"
        )
    model = CellFoundation(scene, cells, compiled=compiled)
    model.record = {
        "model": "cubic cells",
        "cells_mm": [cells.u_mm, cells.v_mm],
        "sub_points": [cells.along_u, cells.along_v],
        "against": str(CONVERGED),
        "poses": len(errors),
        "forces_n": list(range_n),
        "rms": dict(zip(scene.load_names, np.sqrt(np.mean(errors**2, axis=0)).tolist(), strict=True)),
        "largest": dict(zip(scene.load_names, errors.max(axis=0).tolist(), strict=True)),
    }
    return model


class _Truth:
    """Poses that press each patch, and the wrenches of converged cells there."""

    def __init__(self, scene: Scene, range_n: tuple[float, float]) -> None:
        self.scene = scene
        self.poses, self.wrenches = [], []
        for patch, coarse in zip(cell_patches(scene, CONVERGED), cell_patches(scene, CANDIDATES[0]), strict=True):
            R, t = pressed_poses(coarse, scene.start_pose, range_n, _POSES)
            self.poses.append((R, t))
            self.wrenches.append(np.array([patch.wrench(*pose) for pose in zip(R, t, strict=True)]).reshape(-1, 6))
        if not any(len(t) for _, t in self.poses):
            raise ValueError(
                f"scene {scene.name}: the moving body, near its start pose, touches no patch within its rim when it "
                "comes down on it; check the axes and the patches' boxes, or take cc.ElasticFoundation"
            )

    def errors(self, cells: Cells) -> Array:
        """Absolute errors of the named loads (poses, loads), each pose with one patch pressed."""
        selection = load_selection(self.scene.load_names, self.scene.patch_names)
        errors = []
        for p, patch in enumerate(cell_patches(self.scene, cells)):
            found = np.array([patch.wrench(*pose) for pose in zip(*self.poses[p], strict=True)]).reshape(-1, 6)
            errors.append(np.abs((found - self.wrenches[p]) @ selection[:, p].T))
        return np.concatenate(errors)

    def misses(self, errors: Array, tolerances: Array) -> float:
        """The largest of RMS over tolerance and of largest error over what a single pose may be wrong by."""
        force = np.linalg.norm(np.concatenate(self.wrenches)[:, :3], axis=1) / self.scene.reference_load
        largest = (errors / np.maximum(force, 1.0)[:, None]).max(axis=0)
        return float((np.maximum(np.sqrt(np.mean(errors**2, axis=0)), largest / WORST) / tolerances).max())


def _sized(u_mm: float, v_mm: float) -> Cells:
    """Cells with sub-points about `_SUB_POINT_MM` apart."""
    u, v = (max(3, round(size / _SUB_POINT_MM)) for size in (u_mm, v_mm))
    return Cells(u_mm, v_mm, u, v)


CANDIDATES = sorted((_sized(u, v) for u in SIZES_MM for v in SIZES_MM), key=lambda cells: -cells.u_mm * cells.v_mm)
