"""A user's own function of poses as a contact model."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.approach import first_crossing
from casadi_contact.contact.model import WrenchLoads, overlaps_without_load, signed_roots
from casadi_contact.core.conventions import Array, angular_velocity_map, batched, check_above_zero, pose_text, rotation
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene


class CallableModel(WrenchLoads):
    """A user's own ``wrenches(poses) -> (n, patches, 6)`` as a contact model.

    Derivatives are central differences (steps in mm and rad). gaps, if given, is the user's ``gaps(poses) -> (n,
    patches)`` [mm], positive out of contact. The user's functions get a copy of the poses. Without gaps the gap of a
    patch that carries no load is the way of the moving body along the patch's direction of pressing until the patch
    loads: in steps of approach_mm as far as reach_mm, then by bisection. A normal load without a direction (the
    magnitude of a force) needs gaps. What these functions raise goes on, with a note of the pose. Raises ValueError for
    steps and a reach that are not finite and above 0.
    """

    def __init__(
        self,
        scene: Scene,
        wrenches: Callable[[Array], Array],
        gaps: Callable[[Array], Array] | None = None,
        *,
        step_mm: float = 1e-4,
        step_rad: float = 1e-5,
        approach_mm: float = 0.25,
        reach_mm: float = 15.0,
    ) -> None:
        check_above_zero(step_mm=step_mm, step_rad=step_rad, approach_mm=approach_mm, reach_mm=reach_mm)
        super().__init__(scene)
        self._wrenches, self._gaps = wrenches, gaps
        self._steps = np.repeat([step_mm, step_rad], 3)
        self._approach_mm, self._reach_mm = approach_mm, reach_mm
        self._last: tuple[Array, Array, Array] | None = None  # poses, their wrenches, and the slopes of these

    @batched
    def wrenches(self, poses: Array) -> Array:
        """Wrench of each patch (n, patches, 6), NaN for the function's infinities; ValueError for another shape."""
        wrenches = self._call_user_function("wrenches", self._wrenches, poses, (len(self.patch_names), 6))
        return np.where(np.isfinite(wrenches), wrenches, np.nan)

    def _call_user_function(
        self, what: str, function: Callable[[Array], ArrayLike], poses: Array, columns: tuple[int, ...]
    ) -> Array:
        """Real numbers (n, *columns) that a user's function returns for a copy of the poses (n, 6).

        An exception of the function goes on with a note of the poses. Raises ValueError for another shape.
        """
        try:
            array = function(poses.copy())
        except Exception as error:
            first = f", the first at {pose_text(poses[0], self.patch_names)}" if len(poses) else ""
            error.add_note(f"raised by the contact model's {what}(poses) for {len(poses)} poses{first}")
            raise
        numbers = np.asarray(array, dtype=float)
        if numbers.shape != (len(poses), *columns):
            shape = (len(poses), *columns)
            raise ValueError(f"the contact model returned {what} of shape {numbers.shape}, expected {shape}")
        return numbers

    def _differences(self, function: Callable[[Array], Array], poses: Array) -> Array:
        """Central differences (n, ..., 6) of a function (n, ...) of poses (n, 6)."""
        moves = np.vstack([np.diag(self._steps), -np.diag(self._steps)])
        shifted = function((poses[:, None, :] + moves).reshape(-1, 6))
        plus, minus = np.split(shifted.reshape(len(poses), 12, *shifted.shape[1:]), 2, axis=1)
        return np.moveaxis(plus - minus, 1, -1) / (2.0 * self._steps)

    @batched
    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their central-difference derivatives by the pose (n, patches, 6, 6).

        The last ones are kept: `jacobian` and `root_loads` at the same poses evaluate the user's function once.
        """
        last = self._last
        if last is None or not np.array_equal(last[0], poses):
            last = self._last = poses.copy(), self.wrenches(poses), self._differences(self.wrenches, poses)
        return last[1].copy(), last[2].copy()

    @batched
    def gaps(self, poses: Array) -> Array:
        """Gaps (n, patches) [mm] by the user's function, else as the class says: 0 in contact, reach_mm if farther.

        Raises ValueError for another shape or gaps that are not finite; if there is no such function, for a normal load
        without direction and for patches that pull where they touch.
        """
        if self._gaps is not None:
            gaps = self._call_user_function("gaps", self._gaps, poses, (len(self.patch_names),))
            if len(lost := np.argwhere(~np.isfinite(gaps))):
                said = self._gap_text(poses, gaps, *lost[0])
                raise ValueError(
                    f"the contact model returned the {said}, expected a finite number, 20 where nothing is near"
                )
            return gaps
        directions = self._directions()
        free = normal_forces(self.scene.normal_loads, self.wrenches(poses)) <= 0.0
        rows, patches = np.nonzero(free)
        pressed = partial(self._carries_load, poses[rows], patches, directions[patches])
        travel = np.zeros(free.shape)
        travel[free] = first_crossing(pressed, len(rows), self._approach_mm, self._reach_mm)
        return travel

    def _carries_load(
        self, poses: Array, patches: np.ndarray, along: Array, which: np.ndarray, way: Array
    ) -> np.ndarray:
        """Whether patches (n,) by number, of rows which (k,), carry load after a way (k,) [mm] along directions."""
        moved, patch = poses[which], patches[which]
        moved[:, :3] += way[:, None] * along[which]
        wrenches, at = self.wrenches(moved), (np.arange(len(which)), patch)
        normal = normal_forces(self.scene.normal_loads, wrenches)[at]
        size = np.linalg.norm(wrenches[at][:, :3], axis=1)
        pulls = normal < -np.maximum(0.5 * size, self.scene.boundary_load)
        if pulls.any() and not (normal > 0.0).any():
            row = int(pulls.argmax())
            where = f"patch {self.patch_names[patch[row]]} pulls at {pose_text(moved[row], self.patch_names)}"
            raise ValueError(
                f"the contact model's {where}, expected pressing: return -wrenches, loads on the fixed body"
            )
        return np.asarray(normal > 0.0)

    def _gap_text(self, poses: Array, gaps: Array, row: int, patch: int) -> str:
        """A gap and where it is."""
        at = pose_text(poses[row], self.patch_names)
        return f"gap {gaps[row, patch]:g} mm of {self.patch_names[patch]} at {at}"

    def _directions(self) -> Array:
        """Unit vectors (patches, 3) along which each patch is pressed."""
        directions = [load.direction for load in self.scene.normal_loads if load.direction is not None]
        if len(directions) < len(self.patch_names):
            cure = "CallableModel(scene, wrenches, gaps)"
            raise ValueError(f"scene {self.scene.name}: a normal load without direction needs gaps: {cure}")
        return np.stack(directions)

    def _wrenches_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """Raises ValueError for `overlaps_without_load`, naming the pose."""
        wrenches, jacobian = self.wrench_jacobian(poses)

        def gaps(rows: np.ndarray) -> tuple[Array, Array]:
            found, by_pose = self.gap_jacobian(poses[rows])
            if len(wrong := np.argwhere(overlaps_without_load(wrenches[rows], found))):
                said = self._gap_text(poses[rows], found, *wrong[0])
                raise ValueError(f"the contact model returned the {said}, where it returned no load, expected above 0")
            return found, by_pose

        return wrenches, jacobian, *signed_roots(self.scene, wrenches, jacobian, gaps)

    def gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps, with differences of the user's, else by the motion of the anchors."""
        gaps = self.gaps(poses)
        if self._gaps is not None:
            return gaps, self._differences(self.gaps, poses)
        # The gap of a patch closes with the motion of its anchor, so a turn of the body closes it too.
        along = np.broadcast_to(self._directions(), (len(poses), len(self.patch_names), 3))
        arms = np.einsum("nij,pj->npi", rotation(poses[:, 3:]), self.scene.anchors_mm)
        return gaps, -np.concatenate([along, np.cross(arms, along) @ angular_velocity_map(poses[:, 3:])], axis=2)
