"""How large a scene's cells may be: as large as its tolerances allow, against a fine element grid."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation, cell_patches
from casadi_contact.contact.cells.quadrature import Quadrature
from casadi_contact.contact.cells.reach import pressed_poses
from casadi_contact.contact.convergence import Errors, forces_tried, not_good_enough
from casadi_contact.contact.elastic_foundation import ElasticFoundation
from casadi_contact.conventions import Array, load_selection, rotation
from casadi_contact.scenes import Scene

SIZES_MM = (2.4, 1.7, 1.2, 0.85, 0.6, 0.45)
CONVERGED = (320, 320)  # elements of a patch
_ROUGH = (40, 40)  # elements that find poses
_MIDDLING = Cells(1.2, 1.2, 4, 4)
_TRIES, _DRAWN, _IN_DOUBT, _AT_RIM = 384, 24, 24, 24  # poses of each patch: tried, and kept at most
_SAFE = 0.5  # of the errors that are allowed: poses that were not tried may be worse
_SUB_POINT_MM = 0.3


def cell_foundation(scene: Scene, *, compiled: bool = True) -> CellFoundation:
    """The foundation in the largest cells that meet the scene's tolerances.

    Over poses that press each patch from the scene's boundary load to `convergence.LARGEST_LOAD` reference loads,
    errors against an element grid of `CONVERGED` are half of what `convergence.Errors.misses` allows, or all of it
    where half cannot be had; how wrong loads are where the rim cuts contact stands in the record. Along each side cells
    are as large as one of `SIZES_MM`: first along v, then along u. Raises ValueError where nothing is good enough, and
    where no pose presses the patches.
    """
    truth = _Truth(scene)
    errors_of = lru_cache(maxsize=None)(truth.errors)

    def misses(cells: Cells) -> float:
        return errors_of(cells).misses

    cells = _largest(misses, _SAFE) or _largest(misses, 1.0)
    if cells is None:
        finest = _sized(SIZES_MM[-1], SIZES_MM[-1])
        raise not_good_enough(f"the foundation in {finest}", errors_of(finest))
    model = CellFoundation(scene, cells, compiled=compiled)
    model.record = errors_of(cells).record(
        model="cubic cells",
        cells_mm=[cells.u_mm, cells.v_mm],
        sub_points=[cells.along_u, cells.along_v],
        against="EF {}×{}".format(*CONVERGED),
    )
    return model


class _Truth:
    """Poses that press each patch, the wrenches of a fine element grid there, and whether the rim cuts contact.

    Half of the poses within the rim are as drawn, half those of all drawn in which cells of middling size are most
    wrong: small fillets, which few poses touch, ask for the smallest cells.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._selection = load_selection(scene.load_names, scene.patch_names)
        tolerances = np.array([scene.tolerances[name] for name in scene.load_names])
        rough, fine = ElasticFoundation(scene, _ROUGH), ElasticFoundation(scene, CONVERGED)
        self.places: list[list[tuple[Array, Array]]] = []
        self.wrenches: list[Array] = []
        cut = []
        for p, patch in enumerate(cell_patches(scene, _MIDDLING)):
            poses = pressed_poses(rough, p, forces_tried(scene), _TRIES)
            places = list(zip(rotation(poses[:, 3:]), poses[:, :3], strict=True))
            wrenches = fine.wrenches(poses)[:, p]
            errors, at_rim = self._errors(p, patch, places, wrenches)
            doubt = (errors / tolerances).max(axis=1)
            inside, outside = np.flatnonzero(~at_rim), np.flatnonzero(at_rim)
            worst = inside[np.argsort(-doubt[inside])]
            kept = np.unique(np.concatenate([inside[:_DRAWN], worst[:_IN_DOUBT], outside[:_AT_RIM]]))
            self.places.append([places[k] for k in kept])
            self.wrenches.append(wrenches[kept])
            cut.append(at_rim[kept])
        self.at_rim = np.concatenate(cut)
        if not len(self.at_rim):
            raise ValueError(
                f"scene {scene.name}: the moving body, near its start pose, touches no patch when it comes down on it; "
                "check the axes and the patches' boxes, or take cc.ElasticFoundation"
            )

    def errors(self, cells: Cells) -> Errors:
        """Of the named loads, each pose with one patch pressed."""
        patches = enumerate(cell_patches(self.scene, cells))
        errors = [self._errors(p, patch, self.places[p], self.wrenches[p])[0] for p, patch in patches]
        forces = np.linalg.norm(np.concatenate(self.wrenches)[:, :3], axis=1)
        return Errors(self.scene, np.concatenate(errors), forces, self.at_rim)

    def _errors(
        self, p: int, patch: Quadrature, places: list[tuple[Array, Array]], wrenches: Array
    ) -> tuple[Array, np.ndarray]:
        """Absolute errors of the named loads (n, L), and whether the rim cuts contact (n,)."""
        found = [patch.wrench_and_cut(*place) for place in places]
        off = np.array([wrench for wrench, _ in found]).reshape(-1, 6) - wrenches
        return np.abs(off @ self._selection[:, p].T), np.array([cut for _, cut in found], dtype=bool)


def _largest(misses: Callable[[Cells], float], most: float) -> Cells | None:
    """The largest cells that miss by no more: first the longest v with the shortest u, then the longest u; or None."""
    finest = SIZES_MM[-1]
    v = bisect_left(SIZES_MM, True, key=lambda v_mm: misses(_sized(finest, v_mm)) <= most)
    if v == len(SIZES_MM):
        return None
    u = bisect_left(SIZES_MM[:-1], True, key=lambda u_mm: misses(_sized(u_mm, SIZES_MM[v])) <= most)
    return _sized(SIZES_MM[u], SIZES_MM[v])


def square_cells(size_mm: float) -> Cells:
    """Cells as long as wide."""
    return _sized(size_mm, size_mm)


def _sized(u_mm: float, v_mm: float) -> Cells:
    """Cells with sub-points about `_SUB_POINT_MM` apart."""
    u, v = (max(3, round(size / _SUB_POINT_MM)) for size in (u_mm, v_mm))
    return Cells(u_mm, v_mm, u, v)
