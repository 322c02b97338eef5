"""Poses on a contact model itself, each frame settled alone: from its own pose, its neighbours', the middle of a range.

Settling knows the model's exact Jacobian and no bounds, so that it goes where a surrogate cannot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact import ContactModel
from casadi_contact.conventions import Array, pose_index
from casadi_contact.motion.load_cycle import LoadCycle
from casadi_contact.statics import settle
from problems.pose_estimation.problem import FREE

_TOLERANCE_N = 0.01  # torques over 25 mm


@dataclass(frozen=True)
class Settled:
    """Of each frame: pose (n, 6), found or the nearest; found (n,); starts tried (n,); why it is not found (n,)."""

    poses: Array
    found: np.ndarray
    starts: np.ndarray
    reason: np.ndarray


def search(
    model: ContactModel, cycle: LoadCycle, poses: Array, solved: np.ndarray, wanted: np.ndarray, middle: Array | None
) -> Settled:
    """Settle the wanted frames (n,) of a cycle under its loads, beginning at poses (n, 6).

    Frames not found begin again at the pose of each neighbour that is solved (n,) or found, outwards; then at middle
    poses (n, 6), pressed together first, if there are any, and outwards again.
    """
    attempts = _Attempts(model, cycle, poses, solved, wanted)
    attempts.settle(np.flatnonzero(wanted), poses)
    attempts.outwards()
    left = np.flatnonzero(wanted & ~attempts.found)
    if middle is not None and len(left):
        forces = {"Fy_med": cycle.fy_med[left], "Fy_lat": cycle.fy_lat[left]}
        begin = middle.copy()
        begin[left], _ = settle(model, middle[left], ("ty", "rx"), forces, tolerance=1.0)
        attempts.settle(left, begin)
        attempts.outwards()
    return Settled(attempts.poses, attempts.found, attempts.starts, attempts.reason)


class _Attempts:
    """The best of what was tried for each frame so far, as in `Settled`."""

    def __init__(
        self, model: ContactModel, cycle: LoadCycle, poses: Array, solved: np.ndarray, wanted: np.ndarray
    ) -> None:
        self.poses, self.found = poses.copy(), solved.copy()
        self.starts = np.zeros(len(cycle), dtype=int)
        self.reason = np.full(len(cycle), "", dtype=object)
        self._model, self._cycle, self._targets, self._wanted = model, cycle, cycle.targets(), wanted
        self._residual = np.full(len(cycle), np.inf)
        self._tried: set[tuple[int, int]] = set()

    def settle(self, rows: np.ndarray, begin: Array) -> None:
        """Settle frames from their rows of begin (n, 6), and keep what is nearer than before."""
        if not len(rows):
            return
        start = begin[rows]
        start[:, pose_index("ry")], start[:, pose_index("rz")] = self._cycle.ry[rows], self._cycle.rz[rows]
        targets = {name: curve[rows] for name, curve in self._targets.items()}
        poses, report = settle(self._model, start, FREE, targets, tolerance=_TOLERANCE_N)
        self.starts[rows] += 1
        nearer = report.residual < self._residual[rows]
        kept = rows[nearer]
        self.poses[kept], self._residual[kept] = poses[nearer], report.residual[nearer]
        self.found[kept], self.reason[kept] = report.converged[nearer], report.reason[nearer]

    def outwards(self) -> None:
        """Settle frames from neighbours that are found, once from each, until no new one is found."""
        while pairs := self._pairs():
            self._tried |= set(pairs.items())
            begin = self.poses.copy()
            begin[list(pairs)] = self.poses[list(pairs.values())]
            self.settle(np.array(list(pairs)), begin)

    def _pairs(self) -> dict[int, int]:
        """Each frame not found that has a neighbour to begin at, and the neighbour."""
        sides = [(k, j) for k in np.flatnonzero(self._wanted & ~self.found).tolist() for j in (k - 1, k + 1)]
        inside = [(k, j) for k, j in sides if 0 <= j < len(self.found)]
        return {k: j for k, j in inside if self.found[j] and (k, j) not in self._tried}
