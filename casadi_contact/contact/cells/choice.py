"""How large a scene's cells may be: as large as its tolerances allow, against a fine element grid."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation, cell_patches
from casadi_contact.contact.cells.patches import patch_charts
from casadi_contact.contact.cells.pressing_poses import PressingPoses
from casadi_contact.contact.cells.quadrature import Quadrature
from casadi_contact.contact.convergence import Errors, NotGoodEnoughError, forces_tried, not_good_enough, remedy
from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.pressures import SHARP_SHARE, share_at_sharp_edges
from casadi_contact.core.conventions import Array, load_selection, rotation
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class CellChoice:
    """Sizes of cells that are tried, elements that they are compared with, and poses that decide."""

    sizes_mm: tuple[float, ...] = (2.4, 2.0, 1.7, 1.4, 1.2, 1.0, 0.85, 0.7, 0.6, 0.52, 0.45)
    usual_mm: float = 30.0  # length of patches with these sizes; of smaller patches they are smaller in proportion
    sub_point_mm: float = 0.3
    elements: tuple[int, int] = (320, 320)  # of a patch
    half: tuple[int, int] = (160, 160)
    rough: tuple[int, int] = (40, 40)  # that find poses
    middling_mm: float = 1.2  # cells that find the most wrong poses
    tries: int = 384  # poses of each patch; of them are kept: as drawn, the most wrong, and at the rim
    drawn: int = 24
    worst: int = 24
    at_rim: int = 24
    sharp_share: float = SHARP_SHARE  # of the load at sharp edges, from which a pose counts as at the rim
    safe: float = 0.3  # of the errors that are allowed: poses that were not tried are up to three times as wrong

    def sizes_of(self, scene: Scene) -> tuple[float, ...]:
        """Sides of cells from large to small, in proportion to the scene's smallest patch where that is a small one."""
        longest = min(float(np.max(chart.high - chart.low)) for chart in patch_charts(scene))
        return tuple(size * min(1.0, longest / self.usual_mm) for size in self.sizes_mm)

    def cells(self, u_mm: float, v_mm: float) -> Cells:
        """Cells with sub-points about `sub_point_mm` apart."""
        return Cells(u_mm, v_mm, *(max(3, round(size / self.sub_point_mm)) for size in (u_mm, v_mm)))

    def ladder(self, scene: Scene) -> list[Cells]:
        """Square cells from large to small, to be shown beside one another."""
        return [self.cells(size, size) for size in self.sizes_of(scene)[::2]]

    def largest(self, misses: Callable[[Cells], float], sizes_mm: tuple[float, ...]) -> Cells | None:
        """The largest cells that miss by 1 at most: the longest v for the shortest u, then the longest u; or None."""
        finest = sizes_mm[-1]
        v = bisect_left(sizes_mm, True, key=lambda v_mm: misses(self.cells(finest, v_mm)) <= 1.0)
        if v == len(sizes_mm):
            return None
        u = bisect_left(sizes_mm[:-1], True, key=lambda u_mm: misses(self.cells(u_mm, sizes_mm[v])) <= 1.0)
        return self.cells(sizes_mm[u], sizes_mm[v])


def cell_foundation(scene: Scene, *, compiled: bool = True, choice: CellChoice | None = None) -> CellFoundation:
    """The foundation in the largest cells that meet the scene's tolerances: first along v, then along u.

    Over poses that press each patch from the scene's boundary load to 2.5 reference loads,
    errors against an element grid of `CellChoice.elements` are 0.3 of what `Tolerance` allows, or all of it where
    that cannot be had; where the rim cuts contact, and where sharp edges of the moving mesh bear, their RMS is what it
    allows, or as it comes where that cannot be had. Raises ValueError where nothing is good enough, and where no pose
    presses the patches.
    """
    choice = choice or CellChoice()
    truth, sizes_mm = _Truth(scene, choice), choice.sizes_of(scene)
    errors_of = lru_cache(maxsize=None)(truth.errors)

    def misses(cells: Cells, share: float, at_rim: bool) -> float:
        errors = errors_of(cells)
        return max(errors.ratio / share, errors.ratio_at_rim if at_rim else 0.0)

    bars = ((choice.safe, True), (1.0, True), (choice.safe, False), (1.0, False))
    found = (choice.largest(partial(misses, share=share, at_rim=at_rim), sizes_mm) for share, at_rim in bars)
    cells = next((cells for cells in found if cells is not None), None)
    if cells is None:
        finest = choice.cells(sizes_mm[-1], sizes_mm[-1])
        raise not_good_enough(f"the foundation in {finest}", errors_of(finest))
    model = CellFoundation(scene, cells, compiled=compiled)
    model.record = errors_of(cells).record(
        model="cubic cells",
        cells_mm=[cells.u_mm, cells.v_mm],
        sub_points=[cells.along_u, cells.along_v],
        against=f"EF {grid_text(choice.elements)}",
        elements_unsure=truth.unsure,
    )
    return model


class _Truth:
    """Poses that press each patch, the wrenches of a fine element grid there, and whether it is at a rim: whether the
    fixed surface's rim cuts contact, of the cells or of the grid, whose elements may reach around it, or more than
    `CellChoice.sharp_share` of the load lies at sharp edges of the moving mesh, which its field rounds off for both.

    Half of the poses within the rim are as drawn, half those of all drawn in which cells of middling size are most
    wrong: small fillets, which few poses touch, ask for the smallest cells. Some more sit as the start pose does. Poses
    in which the grid is off from one of half as many elements a side by more than cells may be, as on sharp edges, tell
    nothing: `unsure` is their share.
    """

    def __init__(self, scene: Scene, choice: CellChoice) -> None:
        self.scene, self._charts, poses_of = scene, patch_charts(scene), PressingPoses()
        self._selection = load_selection(scene.load_names, scene.patch_names)
        tolerances = scene.tolerances_of()
        rough, half, fine = (ElasticFoundation(scene, grid) for grid in (choice.rough, choice.half, choice.elements))
        self.places: list[list[tuple[Array, Array]]] = []
        self.wrenches: list[Array] = []
        cut, unsure = [], []
        for p, patch in enumerate(
            cell_patches(scene, choice.cells(choice.middling_mm, choice.middling_mm), self._charts)
        ):
            drawn = poses_of.pressed(rough, p, forces_tried(scene), choice.tries)
            poses = np.vstack([drawn, poses_of.seated(rough, p, forces_tried(scene))])
            places = list(zip(rotation(poses[:, 3:]), poses[:, :3], strict=True))
            wrenches = fine.wrenches(poses)[:, p]
            errors, cut_off = self._errors(p, patch, places, wrenches)
            at_rim = cut_off | fine.at_edge(poses)[:, p] | (share_at_sharp_edges(half, poses) > choice.sharp_share)
            relative = (errors / tolerances).max(axis=1)
            between = np.abs((half.wrenches(poses)[:, p] - wrenches) @ self._selection[:, p].T)
            of_allowed = Errors(scene, between, np.linalg.norm(wrenches[:, :3], axis=1), at_rim).of_allowed
            known = (of_allowed <= 1.0).all(axis=1)
            seats = np.arange(len(poses)) >= len(drawn)
            inside, outside = np.flatnonzero(known & ~at_rim & ~seats), np.flatnonzero(known & at_rim & ~seats)
            worst, always = inside[np.argsort(-relative[inside])], np.flatnonzero(known & seats)
            kept = np.unique(
                np.concatenate([inside[: choice.drawn], worst[: choice.worst], outside[: choice.at_rim], always])
            )
            self.places.append([places[k] for k in kept])
            self.wrenches.append(wrenches[kept])
            cut.append(at_rim[kept])
            unsure.append(~known)
        self.at_rim = np.concatenate(cut)
        tried = np.concatenate(unsure)
        self.unsure = float(tried.mean()) if len(tried) else 0.0
        if len(tried) and not len(self.at_rim):
            raise NotGoodEnoughError(
                f"scene {scene.name}: elements of {choice.half} and {choice.elements} differ by more than its "
                f"tolerances allow in every pose that was tried, so that no cells can be chosen: {remedy(scene)}"
            )
        if not len(self.at_rim):
            raise ValueError(
                f"scene {scene.name}: the moving body, near its start pose, touches no patch when it comes down on it; "
                "check the axes and the patches' boxes, or take cc.ElasticFoundation"
            )

    def errors(self, cells: Cells) -> Errors:
        """Of the named loads, each pose with one patch pressed."""
        patches = enumerate(cell_patches(self.scene, cells, self._charts))
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
