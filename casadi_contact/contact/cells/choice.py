"""How large a scene's cells may be: as large as its tolerances allow, against a fine element grid."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from casadi_contact.contact.approach import press_until, trace_gap
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation, cell_patches
from casadi_contact.contact.cells.patches import patch_charts
from casadi_contact.contact.cells.quadrature import Quadrature
from casadi_contact.contact.convergence import Errors, NotGoodEnoughError, forces_tried, not_good_enough, remedy
from casadi_contact.contact.elements.foundation import SHARP_SHARE, ElasticFoundation, grid_text, share_at_sharp_edges
from casadi_contact.core.conventions import POSE_NAMES, Array, load_selection, rotation
from casadi_contact.scenes.cycle import scene_cycles
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class CellChoice:
    """Sizes of cells that are tried, elements that they are compared with, and poses that decide."""

    sizes_mm: tuple[float, ...] = (2.4, 2.0, 1.7, 1.4, 1.2, 1.0, 0.85, 0.7, 0.6, 0.52, 0.45)
    usual_mm: float = 30.0  # length of patches with these sizes; of smaller patches they are smaller in proportion
    large_mm: float = 90.0  # and of larger ones than this, a sole's, larger in proportion
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
        """Sides of cells from large to small, in proportion to the smallest patch where that is small or large."""
        longest = min(float(np.max(chart.high - chart.low)) for chart in patch_charts(scene))
        scale = min(1.0, longest / self.usual_mm) * max(1.0, longest / self.large_mm)
        return tuple(size * scale for size in self.sizes_mm)

    def cells(self, u_mm: float, v_mm: float) -> Cells:
        """Cells with sub-points about `sub_point_mm` apart; larger ones than all `sizes_mm` have 4 along a side."""
        points = (max(3, round(size / self.sub_point_mm)) for size in (u_mm, v_mm))
        large = max(u_mm, v_mm) > max(self.sizes_mm)
        return Cells(u_mm, v_mm, *(min(count, 4) if large else count for count in points))

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


def cell_foundation(
    scene: Scene, *, compiled: bool = True, choice: CellChoice | None = None, poses: Array | None = None
) -> CellFoundation:
    """The foundation in the largest cells that meet the scene's tolerances: first along v, then along u.

    Over poses that press each patch from the scene's boundary load to 2.5 reference loads, and those given (n, 6),
    errors against an element grid of `CellChoice.elements` are 0.3 of what `Tolerance` allows, or all of it where
    that cannot be had; where the rim cuts contact, and where sharp edges of the moving mesh bear, their RMS is what it
    allows, or as it comes. Raises ValueError where nothing is good enough, and where no pose presses the patches.
    """
    choice = choice or CellChoice()
    truth, sizes_mm = _Truth(scene, choice, np.empty((0, 6)) if poses is None else poses), choice.sizes_of(scene)
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


@dataclass(frozen=True)
class PressingPoses:
    """How poses that press a patch are drawn and found."""

    turn_deg: tuple[float, float, float] = (10.0, 15.0, 60.0)  # to both sides, in a scene without a motion
    beyond_deg: float = 10.0  # beyond the motion of a scene that has one
    lean_deg: float = 20.0  # of the direction that the body comes down along
    shift_share: float = 0.15  # of the patch's extent, to each side
    seats: int = 12  # poses of a patch as in the scene's start pose
    lift_mm: float = 300.0  # from where the body comes down
    touch_mm: float = 0.01
    most_steps: int = 100
    rounds: int = 6  # of pressing
    kept: tuple[float, float] = (0.5, 2.0)  # least and largest force of poses that are kept, over the target

    def pressed(self, model: ElasticFoundation, patch: int, loads_n: tuple[float, float], count: int) -> Array:
        """Poses (m, 6), m <= count, that press one patch of a model, each found from a random one.

        From the scene's start pose the body is turned about the patch's anchor, a little farther than in the scene's
        motion if it has one. By turns it is shifted and brought down along the patch's mean normal until it touches, or
        brought down along a direction that leans from it. Then it presses with forces spread evenly on a logarithmic
        scale between loads_n [N]. There is no pose where it comes down beside the patch.
        """
        random = np.random.default_rng(0)
        turn, lean, shift = random.random((3, count, 1)) * random.uniform(-1.0, 1.0, (3, count, 3))
        straight = np.arange(count)[:, None] % 2
        target = random.permutation(np.geomspace(*loads_n, count))
        return self._pressed(model, patch, turn, (1 - straight) * lean, straight * shift, target)

    def seated(self, model: ElasticFoundation, patch: int, loads_n: tuple[float, float]) -> Array:
        """Poses (m, 6), m <= `seats`, that press one patch as the start pose does, with forces between loads_n [N].

        Half of them are not turned, half are turned from end to end of the scene's motion about its main axis. In an
        embracing patch a body that is shifted or turned otherwise hangs on the walls.
        """
        half, (middle, most) = self.seats // 2, self._turns_rad(model.scene)
        turn, still = np.zeros((self.seats, 3)), np.zeros((self.seats, 3))
        turn[:half] = (model.scene.start_pose[3:] - middle) / most
        turn[half:, most.argmax()] = np.linspace(-1.0, 1.0, half)
        return self._pressed(model, patch, turn, still, still, np.tile(np.geomspace(*loads_n, half), 2))

    def _pressed(
        self, model: ElasticFoundation, patch: int, turn: Array, lean: Array, shift: Array, target: Array
    ) -> Array:
        """Poses (m, 6) of bodies turned, leaning, shifted (n, 3), in shares, that press with about target (n,) [N]."""
        elements = model.scene.elements(model.grid)[patch]
        points, up = elements.centres_mm, elements.areas_mm2 @ elements.normals
        up /= np.linalg.norm(up)
        away = up + np.tan(np.deg2rad(self.lean_deg)) * lean
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        shift = self.shift_share * shift * np.ptp(points, axis=0)
        poses = np.tile(model.scene.start_pose, (len(target), 1))
        before = rotation(poses[:, 3:])
        middle, most = self._turns_rad(model.scene)
        poses[:, 3:] = middle + most * turn
        poses[:, :3] += (before - rotation(poses[:, 3:])) @ model.scene.anchors_mm[patch]
        poses[:, :3] += shift - (shift @ up)[:, None] * up

        def moved(rows: np.ndarray, lift_mm: Array) -> Array:
            after = poses[rows]
            after[:, :3] += lift_mm[:, None] * away[rows]
            return after

        def gap_at(rows: np.ndarray, travel_mm: Array) -> Array:
            return model.gaps(moved(rows, self.lift_mm - travel_mm))[:, patch]

        reach_mm, count = 2.0 * self.lift_mm, len(poses)
        travel, touching = trace_gap(
            gap_at, count, reach_mm=reach_mm, touch_mm=self.touch_mm, share=0.9, most_steps=self.most_steps
        )
        poses = moved(np.arange(len(poses)), self.lift_mm - travel)[touching]
        away, target = away[touching], target[touching]

        def force_of(at: Array) -> Array:
            return np.linalg.norm(model.wrenches(at)[:, patch, :3], axis=1)

        pressed, force = press_until(force_of, poses, -away, target, 0.05, self.rounds)
        return pressed[(force > self.kept[0] * target) & (force < self.kept[1] * target)]

    def _turns_rad(self, scene: Scene) -> tuple[Array, Array]:
        """Middle (3,) and half (3,) of the angles rx, ry, rz that the body is turned by."""
        middle, most = scene.start_pose[3:].copy(), np.deg2rad(self.turn_deg)
        cycles = [cycle.pose for cycle in scene_cycles(scene)] if scene.motion else [{}]
        for k, name in enumerate(POSE_NAMES[3:]):
            if name in cycles[0]:
                angles = np.array([pose[name] for pose in cycles])
                middle[k] = 0.5 * (angles.min() + angles.max())
                most[k] = 0.5 * np.ptp(angles) + np.deg2rad(self.beyond_deg)
        return middle, most


class _Truth:
    """Poses that press each patch, the wrenches of a fine element grid there, and whether it is at a rim: whether the
    fixed surface's rim cuts contact, of the cells or of the grid, whose elements may reach around it, or more than
    `CellChoice.sharp_share` of the load lies at sharp edges of the moving mesh, which its field rounds off for both.

    Half of the poses within the rim are as drawn, half those of all drawn in which cells of middling size are most
    wrong: small fillets, which few poses touch, ask for the smallest cells. Some more sit as the start pose does. Poses
    in which a grid of half as many elements a side differs by more than cells may tell nothing: `unsure`, their share.
    """

    def __init__(self, scene: Scene, choice: CellChoice, given: Array) -> None:
        self.scene, self._charts, poses_of = scene, patch_charts(scene), PressingPoses()
        self._selection = load_selection(scene.load_names, scene.patch_names)
        tolerances = scene.tolerances_of()
        rough, half, fine = (ElasticFoundation(scene, grid) for grid in (choice.rough, choice.half, choice.elements))
        self.poses: list[Array] = []
        self.wrenches: list[Array] = []
        cut, unsure = [], []
        middling = cell_patches(scene, choice.cells(choice.middling_mm, choice.middling_mm), self._charts)
        for p, patch in enumerate(middling):
            drawn = poses_of.pressed(rough, p, forces_tried(scene), choice.tries)
            pressing = given[np.linalg.norm(rough.wrenches(given)[:, p, :3], axis=1) > scene.boundary_load]
            poses = np.vstack([drawn, poses_of.seated(rough, p, forces_tried(scene)), pressing])
            wrenches = fine.wrenches(poses)[:, p]
            errors, cut_off = self._errors(p, patch, poses, wrenches)
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
            self.poses.append(poses[kept])
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
            cure = "check axes and the patches' boxes, or take cc.ElasticFoundation"
            raise ValueError(f"scene {scene.name}: from its start pose the moving body comes down on no patch; {cure}")

    def errors(self, cells: Cells) -> Errors:
        """Of the named loads, each pose with one patch pressed."""
        patches = enumerate(cell_patches(self.scene, cells, self._charts))
        errors = [self._errors(p, patch, self.poses[p], self.wrenches[p])[0] for p, patch in patches]
        forces = np.linalg.norm(np.concatenate(self.wrenches)[:, :3], axis=1)
        return Errors(self.scene, np.concatenate(errors), forces, self.at_rim)

    def _errors(self, p: int, patch: Quadrature, poses: Array, wrenches: Array) -> tuple[Array, np.ndarray]:
        """Absolute errors of the named loads (n, L), and whether the rim cuts contact (n,)."""
        found = [patch.wrench_and_cut(*place) for place in zip(rotation(poses[:, 3:]), poses[:, :3], strict=True)]
        off = np.array([wrench for wrench, _ in found]).reshape(-1, 6) - wrenches
        return np.abs(off @ self._selection[:, p].T), np.array([cut for _, cut in found], dtype=bool)
