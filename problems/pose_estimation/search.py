"""Poses on a contact model itself, frame by frame: settled from the frame's own pose or the middle of a range, or
followed from a neighbouring frame that has one.

Settling knows the model's exact Jacobian and no bounds, so that it goes where a surrogate cannot. Near the rim it needs
a start that is close: there a neighbour's equilibrium is followed while loads and rotations change to the frame's own,
in steps halved where one fails.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.continuity import follow
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array, pose_index
from problems.pose_estimation.problem import PoseEstimation
from problems.pose_estimation.wanted import ROUGHLY_N


@dataclass(frozen=True)
class Found:
    """Of each frame: pose (n, 6), as given where none is found; found (n,); starts tried (n,); why not found (n,)."""

    poses: Array
    found: np.ndarray
    starts: np.ndarray
    reason: np.ndarray


def search(
    model: ContactModel,
    problem: PoseEstimation,
    poses: Array,
    solved: np.ndarray,
    asked: np.ndarray,
    middle: Array | None,
    *,
    roughly: bool = False,
) -> Found:
    """Find poses of the frames asked for (n,) of a problem's cycle, beginning at poses (n, 6).

    Frames not found are followed from each neighbour that is solved (n,) or found, outwards; then they begin at middle
    poses (n, 6), pressed together first, if there are any, and outwards again. Frames stay as they are where centres of
    pressure are wanted without the forces that they belong to. roughly: to `ROUGHLY_N` under any load.
    """
    settled_n = np.full(len(poses), ROUGHLY_N) if roughly else problem.wanted.settled_n
    attempts = _Attempts(model, problem, poses, solved, asked, settled_n)
    attempts.settle(np.flatnonzero(asked), poses)
    attempts.outwards()
    left = np.flatnonzero(asked & ~attempts.found)
    if middle is not None and len(left):
        forces = {name: curve[left] for name, curve in problem.wanted.pressing.items()}
        begin, sensitive = middle.copy(), problem.model.scene.sensitive_pose
        if forces and set(sensitive) <= set(problem.free):
            begin[left], _ = settle(model, middle[left], sensitive, forces, tolerance=1.0)
        attempts.settle(left, begin)
        attempts.outwards()
    return Found(attempts.poses, attempts.found, attempts.starts, attempts.reason)


class _Attempts:
    """What was tried for each frame so far, as in `Found`."""

    def __init__(
        self,
        model: ContactModel,
        problem: PoseEstimation,
        poses: Array,
        solved: np.ndarray,
        asked: np.ndarray,
        settled_n: Array,
    ) -> None:
        self.poses, self.found = poses.copy(), solved.copy()
        self.starts = np.zeros(len(poses), dtype=int)
        self.reason = np.full(len(poses), "", dtype=object)
        self._model, self._free, self._targets = model, problem.free, problem.wanted.targets()
        self._asked = asked if self._targets else np.zeros(len(poses), dtype=bool)
        self._settled_n = settled_n
        self._measured = {pose_index(name): curve for name, curve in problem.measured.items()}
        self._tried: set[tuple[int, int]] = set()

    def settle(self, rows: np.ndarray, begin: Array) -> None:
        """Settle frames from their rows of begin (n, 6)."""
        rows = rows[self._asked[rows]]
        for settled_n in np.unique(self._settled_n[rows]):
            self._settle(rows[self._settled_n[rows] == settled_n], begin, settled_n)

    def _settle(self, rows: np.ndarray, begin: Array, settled_n: float) -> None:
        start = begin[rows]
        for column, curve in self._measured.items():
            start[:, column] = curve[rows]
        targets = {name: curve[rows] for name, curve in (self._targets or {}).items()}
        poses, report = settle(self._model, start, self._free, targets, tolerance=settled_n)
        good = report.converged
        self.poses[rows[good]], self.found[rows[good]] = poses[good], True
        self.starts[rows] += 1
        self.reason[rows] = report.reason

    def outwards(self) -> None:
        """Follow frames from neighbours that are found, once from each, until no new one is found."""
        while pairs := self._pairs():
            self._tried |= set(pairs)
            for frame, neighbour in pairs:
                if not self.found[frame]:
                    self._follow(frame, neighbour)

    def _pairs(self) -> list[tuple[int, int]]:
        """Frames not found, each with a neighbour to be followed from."""
        missing = np.flatnonzero(self._asked & ~self.found).tolist()
        pairs = {(k, j) for k in missing for j in (k - 1, k + 1) if 0 <= j < len(self.found) and self.found[j]}
        return sorted(pairs - self._tried)

    def _follow(self, frame: int, neighbour: int) -> None:
        to = self.poses[frame].copy()
        for column, curve in self._measured.items():
            to[column] = curve[frame]
        now, then = ({name: v[at] for name, v in (self._targets or {}).items()} for at in (neighbour, frame))
        pose, share = follow(self._model, self.poses[neighbour], to, self._free, now, then, self._settled_n[frame])
        self.starts[frame] += 1
        if share == 1.0:
            self.poses[frame], self.found[frame], self.reason[frame] = pose, True, ""
        else:
            self.reason[frame] = f"followed from frame {neighbour} it ends {share:.0%} of the way"
