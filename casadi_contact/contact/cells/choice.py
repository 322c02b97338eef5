"""How large a scene's cells may be: as large as its tolerances allow, against a fine element grid."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from typing import Any

import numpy as np

from casadi_contact.contact.approach import press_until, trace_gap
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation, cell_patches
from casadi_contact.contact.cells.patches import patch_charts
from casadi_contact.contact.cells.quadrature import Quadrature
from casadi_contact.contact.convergence import Errors, NotGoodEnoughError, forces_tried, not_good_enough, remedy
from casadi_contact.contact.elements.foundation import TELLING_SHARE, ElasticFoundation, grid_text, share_at_sharp_edges
from casadi_contact.core.conventions import POSE_NAMES, Array, load_selection, rotation
from casadi_contact.scenes.joint_cycle import scene_cycles
from casadi_contact.scenes.scene import Scene

_TURN_RAD = np.deg2rad([10.0, 15.0, 60.0])  # to both sides, where no motion is told: joints flex about z
_BEYOND_RAD = np.deg2rad(10.0)  # beyond a motion that the scene tells
_LEAN_RAD = np.deg2rad(20.0)
SEATED = 12  # poses of a patch
_SHARE = 0.15  # of the patch's extent, by which the body is shifted to each side
_LIFT_MM = 300.0
_STEPS = 100
_NEAR_MM = 0.01
_ROUNDS = 6
_LEAST_SHARE, _MOST = 0.5, 2.0  # of the force target, in poses that are kept


def pressed_poses(model: ElasticFoundation, patch: int, loads_n: tuple[float, float], count: int) -> Array:
    """Poses (m, 6), m <= count, that press one patch of a model, each found from a random one.

    From the scene's start pose the body is turned about the patch's anchor, as far as the scene's motion and a little
    more where it tells one, and, by turns, shifted and brought down along the patch's mean normal until it touches, or
    brought down along a direction that leans from it; then it presses with forces spread evenly on a logarithmic scale
    between loads_n [N]. Where it comes down beside the patch there is no pose.
    """
    random = np.random.default_rng(0)
    turn, lean, shift = random.random((3, count, 1)) * random.uniform(-1.0, 1.0, (3, count, 3))
    straight = np.arange(count)[:, None] % 2
    target = random.permutation(np.geomspace(*loads_n, count))
    return _pressed(model, patch, turn, (1 - straight) * lean, straight * shift, target)


def seated_poses(model: ElasticFoundation, patch: int, loads_n: tuple[float, float]) -> Array:
    """Poses (m, 6), m <= `SEATED`, that press one patch as the scene's start pose does, brought straight down with
    forces from the least to the largest of loads_n [N]: half of them as it is, half turned from end to end of the
    scene's motion about the axis that it turns about the most. In an embracing patch a body that is shifted or turned
    otherwise hangs on the walls."""
    half, (middle, most) = SEATED // 2, _turns_rad(model.scene)
    turn, still = np.zeros((SEATED, 3)), np.zeros((SEATED, 3))
    turn[:half] = (model.scene.start_pose[3:] - middle) / most
    turn[half:, most.argmax()] = np.linspace(-1.0, 1.0, half)
    return _pressed(model, patch, turn, still, still, np.tile(np.geomspace(*loads_n, half), 2))


def _pressed(model: ElasticFoundation, patch: int, turn: Array, lean: Array, shift: Array, target: Array) -> Array:
    """Poses (m, 6) of bodies turned, leaning and shifted (n, 3), as shares of what `pressed_poses` allows, that press
    the patch with about the forces target (n,) [N]."""
    elements = model.scene.elements(model.grid)[patch]
    points, up = elements.centres_mm, elements.areas_mm2 @ elements.normals
    up /= np.linalg.norm(up)
    away = up + np.tan(_LEAN_RAD) * lean
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    shift = _SHARE * shift * np.ptp(points, axis=0)
    poses = np.tile(model.scene.start_pose, (len(target), 1))
    before = rotation(poses[:, 3:])
    middle, most = _turns_rad(model.scene)
    poses[:, 3:] = middle + most * turn
    poses[:, :3] += (before - rotation(poses[:, 3:])) @ model.scene.anchors_mm[patch]
    poses[:, :3] += shift - (shift @ up)[:, None] * up

    def moved(rows: np.ndarray, lift_mm: Array) -> Array:
        after = poses[rows]
        after[:, :3] += lift_mm[:, None] * away[rows]
        return after

    def gap_at(rows: np.ndarray, travel_mm: Array) -> Array:
        return model.gaps(moved(rows, _LIFT_MM - travel_mm))[:, patch]

    travel, touching = trace_gap(
        gap_at, len(poses), reach_mm=2.0 * _LIFT_MM, touch_mm=_NEAR_MM, share=0.9, most_steps=_STEPS
    )
    poses = moved(np.arange(len(poses)), _LIFT_MM - travel)[touching]
    away, target = away[touching], target[touching]

    def at(depth_mm: Array) -> Array:
        return np.column_stack([poses[:, :3] - depth_mm[:, None] * away, poses[:, 3:]])

    depth, force = press_until(
        lambda depth_mm: np.linalg.norm(model.wrenches(at(depth_mm))[:, patch, :3], axis=1), target, 0.05, _ROUNDS
    )
    return at(depth)[(force > _LEAST_SHARE * target) & (force < _MOST * target)]


def _turns_rad(scene: Scene) -> tuple[Array, Array]:
    """Middle (3,) and half (3,) of the angles rx, ry, rz that the body is turned by."""
    middle, most = scene.start_pose[3:].copy(), _TURN_RAD.copy()
    told = [cycle.pose for cycle in scene_cycles(scene)] if scene.motion else [{}]
    for k, name in enumerate(POSE_NAMES[3:]):
        if name in told[0]:
            angles = np.array([pose[name] for pose in told])
            middle[k] = 0.5 * (angles.min() + angles.max())
            most[k] = 0.5 * np.ptp(angles) + _BEYOND_RAD
    return middle, most


_SIZES_MM = (2.4, 2.0, 1.7, 1.4, 1.2, 1.0, 0.85, 0.7, 0.6, 0.52, 0.45)  # of patches that are `_USUAL_MM` long and more
_USUAL_MM = 30.0
CONVERGED, _HALF = (320, 320), (160, 160)  # elements of a patch
_ROUGH = (40, 40)  # elements that find poses
_MIDDLING = Cells(1.2, 1.2, 4, 4)
_TRIES, _DRAWN, _WORST, _AT_RIM = 384, 24, 24, 24  # poses of each patch: tried, and kept at most
_SAFE = 0.3  # of the errors that are allowed: poses that were not tried are up to three times as wrong
_SUB_POINT_MM = 0.3


def cell_foundation(scene: Scene, *, compiled: bool = True) -> CellFoundation:
    """The foundation in the largest cells that meet the scene's tolerances.

    Over poses that press each patch from the scene's boundary load to `convergence.LARGEST_LOAD` reference loads,
    errors against an element grid of `CONVERGED` are 0.3 of what `Tolerance` allows, or all of it where
    that cannot be had; where the rim cuts contact, and where sharp edges of the moving mesh bear, their RMS is what it
    allows, or as it comes where that cannot be had. Along each side cells are as large as one of `cell_sizes_mm`: first
    along v, then along u. Raises ValueError where nothing is good enough, and where no pose presses the patches.
    """
    truth, sizes_mm = _Truth(scene), cell_sizes_mm(scene)
    errors_of = lru_cache(maxsize=None)(truth.errors)

    def misses(cells: Cells, share: float, at_rim: bool) -> float:
        errors = errors_of(cells)
        return max(errors.ratio / share, errors.ratio_at_rim if at_rim else 0.0)

    bars = ((_SAFE, True), (1.0, True), (_SAFE, False), (1.0, False))
    found = (_largest(partial(misses, share=share, at_rim=at_rim), sizes_mm) for share, at_rim in bars)
    cells = next((cells for cells in found if cells is not None), None)
    if cells is None:
        finest = square_cells(sizes_mm[-1])
        raise not_good_enough(f"the foundation in {finest}", errors_of(finest))
    model = CellFoundation(scene, cells, compiled=compiled)
    model.record = errors_of(cells).record(
        model="cubic cells",
        cells_mm=[cells.u_mm, cells.v_mm],
        sub_points=[cells.along_u, cells.along_v],
        against=f"EF {grid_text(CONVERGED)}",
        elements_unsure=truth.unsure,
    )
    return model


def recorded_cells(scene: Scene, record: Mapping[str, Any], *, compiled: bool = True) -> CellFoundation:
    """The foundation that a record of `cell_foundation` tells of."""
    return CellFoundation(scene, Cells(*record["cells_mm"], *record["sub_points"]), compiled=compiled)


def cell_ladder(scene: Scene) -> Iterator[CellFoundation]:
    """Foundations from large cells to small ones, shown beside one another."""
    return (CellFoundation(scene, square_cells(size_mm)) for size_mm in cell_sizes_mm(scene)[::2])


def cell_sizes_mm(scene: Scene) -> tuple[float, ...]:
    """Sides of cells from large to small, in proportion to the scene's smallest patch where that is a small one."""
    longest = min(float(np.max(chart.high - chart.low)) for chart in patch_charts(scene))
    return tuple(size * min(1.0, longest / _USUAL_MM) for size in _SIZES_MM)


class _Truth:
    """Poses that press each patch, the wrenches of a fine element grid there, and whether it is at a rim: whether the
    fixed surface's rim cuts contact, of the cells or of the grid, whose elements may reach around it, or more than
    `TELLING_SHARE` of the load lies at sharp edges of the moving mesh, which its field rounds off for both.

    Half of the poses within the rim are as drawn, half those of all drawn in which cells of middling size are most
    wrong: small fillets, which few poses touch, ask for the smallest cells. Some more sit as the start pose does. Poses
    in which the grid is off from one of half as many elements a side by more than cells may be, as on sharp edges, tell
    nothing: `unsure` is their share.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self._charts = scene, patch_charts(scene)
        self._selection = load_selection(scene.load_names, scene.patch_names)
        tolerances = scene.tolerances_of()
        rough, half, fine = (ElasticFoundation(scene, grid) for grid in (_ROUGH, _HALF, CONVERGED))
        self.places: list[list[tuple[Array, Array]]] = []
        self.wrenches: list[Array] = []
        cut, unsure = [], []
        for p, patch in enumerate(cell_patches(scene, _MIDDLING, self._charts)):
            drawn = pressed_poses(rough, p, forces_tried(scene), _TRIES)
            poses = np.vstack([drawn, seated_poses(rough, p, forces_tried(scene))])
            places = list(zip(rotation(poses[:, 3:]), poses[:, :3], strict=True))
            wrenches = fine.wrenches(poses)[:, p]
            errors, cut_off = self._errors(p, patch, places, wrenches)
            at_rim = cut_off | fine.at_edge(poses)[:, p] | (share_at_sharp_edges(half, poses) > TELLING_SHARE)
            relative = (errors / tolerances).max(axis=1)
            between = np.abs((half.wrenches(poses)[:, p] - wrenches) @ self._selection[:, p].T)
            of_allowed = Errors(scene, between, np.linalg.norm(wrenches[:, :3], axis=1), at_rim).of_allowed
            known = (of_allowed <= 1.0).all(axis=1)
            seats = np.arange(len(poses)) >= len(drawn)
            inside, outside = np.flatnonzero(known & ~at_rim & ~seats), np.flatnonzero(known & at_rim & ~seats)
            worst, always = inside[np.argsort(-relative[inside])], np.flatnonzero(known & seats)
            kept = np.unique(np.concatenate([inside[:_DRAWN], worst[:_WORST], outside[:_AT_RIM], always]))
            self.places.append([places[k] for k in kept])
            self.wrenches.append(wrenches[kept])
            cut.append(at_rim[kept])
            unsure.append(~known)
        self.at_rim = np.concatenate(cut)
        tried = np.concatenate(unsure)
        self.unsure = float(tried.mean()) if len(tried) else 0.0
        if len(tried) and not len(self.at_rim):
            raise NotGoodEnoughError(
                f"scene {scene.name}: elements of {_HALF} and {CONVERGED} differ by more than its tolerances allow in "
                f"every pose that was tried, so that no cells can be chosen: {remedy(scene)}"
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


def _largest(misses: Callable[[Cells], float], sizes_mm: tuple[float, ...]) -> Cells | None:
    """The largest cells that miss by 1 at most: first the longest v for the shortest u, then the longest u; or None."""
    finest = sizes_mm[-1]
    v = bisect_left(sizes_mm, True, key=lambda v_mm: misses(_sized(finest, v_mm)) <= 1.0)
    if v == len(sizes_mm):
        return None
    u = bisect_left(sizes_mm[:-1], True, key=lambda u_mm: misses(_sized(u_mm, sizes_mm[v])) <= 1.0)
    return _sized(sizes_mm[u], sizes_mm[v])


def square_cells(size_mm: float) -> Cells:
    """Cells as long as wide."""
    return _sized(size_mm, size_mm)


def _sized(u_mm: float, v_mm: float) -> Cells:
    """Cells with sub-points about `_SUB_POINT_MM` apart."""
    u, v = (max(3, round(size / _SUB_POINT_MM)) for size in (u_mm, v_mm))
    return Cells(u_mm, v_mm, u, v)
