"""Neighbouring frames whose poses lie apart: where several equilibria carry the same loads, each may have its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_IN_MM, Array, loads_of_total, pose_index


def leaps(
    poses: Array, *, least_mm: float = 2.0, least_deg: float = 3.0, times: float = 4.0, beside: int = 2
) -> np.ndarray:
    """True (n - 1, 6) where a pose parameter of poses (n, 6) leaps from one frame to the next.

    A leap is a step of more than least_mm or least_deg that is also more than `times` the median of the steps beside it
    (so many before and behind). Where the next step leads back, that is compared with what is left of both, and the
    median of all.
    """
    moves = np.diff(poses, axis=0)
    steps = np.abs(moves)
    padded = np.pad(steps, ((beside, beside), (0, 0)), constant_values=np.nan)
    count = len(steps)
    others = np.stack([padded[at : at + count] for at in range(2 * beside + 1) if at != beside])
    alone = np.isnan(others).all(axis=0)  # two frames: no step is usual
    usual = np.nanmedian(np.where(alone, np.inf, others), axis=0)
    least = np.array([least_mm] * 3 + [np.radians(least_deg)] * 3)
    left = np.abs(moves[1:] + moves[:-1])  # of one step and the next
    back = np.full_like(steps, np.inf)
    back[:-1] = left
    back[1:] = np.minimum(back[1:], left)
    back = np.maximum(back, np.median(steps, axis=0)) if count else back
    return np.asarray((steps > least) & (steps > times * np.minimum(usual, back)))


@dataclass(frozen=True)
class Motion:
    """Frames to be carried by a contact model: free pose parameters, target loads (n,) by name, how closely these are
    settled (n,) [N]. usable (n,): frames that have a pose to find; low, high (6,): bounds of poses."""

    model: ContactModel
    free: Sequence[str]
    targets: Mapping[str, Array]
    tolerance_n: Array
    usable: np.ndarray
    low: Array = field(default_factory=lambda: np.full(6, -np.inf))
    high: Array = field(default_factory=lambda: np.full(6, np.inf))
    price_mm: float = 1.0  # of an unstable pose, which has a stiffness below minus these two:
    unstable_share: float = 1e-3  # of the largest
    unstable_n_per_mm: float = 1.0
    passes: int = 5  # of following what leaps, and choosing the way
    same_mm: float = 1e-2  # poses of one frame nearer than that are the same

    @property
    def columns(self) -> list[int]:
        """Those of the free pose parameters."""
        return [pose_index(name) for name in self.free]

    def leaping(self, poses: Array, solved: np.ndarray) -> np.ndarray:
        """True (n - 1,) where a free pose parameter leaps between two solved (n,) neighbours of poses (n, 6)."""
        return np.asarray(leaps(poses)[:, self.columns].any(axis=1) & solved[1:] & solved[:-1])

    def unstable(self, poses: Array) -> np.ndarray:
        """True (n,) where target forces along free translations leave the body in an unstable equilibrium in poses
        (n, 6): the least eigenvalue of their stiffness is below zero. False throughout without such a force."""
        forces = {
            pose_index(name): names
            for name in self.free
            if name[0] == "t"
            and (names := loads_of_total(f"F{name[1]}", [*self.targets], self.model.scene.patch_names))
        }
        if not forces or not len(poses):
            return np.zeros(len(poses), dtype=bool)
        _, jacobian = self.model.jacobian(poses)
        rows = [jacobian[:, [self.model.load_names.index(each) for each in names]].sum(1) for names in forces.values()]
        stiffness = np.stack(rows, axis=1)[:, :, list(forces)]
        values = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.transpose(0, 2, 1)))
        least = np.maximum(self.unstable_share * np.abs(values).max(axis=1), self.unstable_n_per_mm)
        return np.asarray(values[:, 0] < -least)

    def without_leaps(self, poses: Array, solved: np.ndarray) -> Array:
        """Poses (n, 6), of which some are solved (n,), with others that carry the target loads where the motion then
        leaps less, and is shorter; also of frames that were not solved, where a neighbour leads there."""
        leaping = self.leaping(poses, solved)
        known = [[pose] if ready else [] for pose, ready in zip(poses, solved, strict=True)]
        for _ in range(self.passes):
            if not (before := leaping.sum()):
                break
            self._follow_leaps(poses, leaping, known)
            poses = self._shortest_way(known, poses)
            leaping = self.leaping(poses, np.array([bool(of_frame) for of_frame in known]))
            if leaping.sum() >= before:
                break
        return poses

    def _follow_leaps(self, poses: Array, leaping: np.ndarray, known: list[list[Array]]) -> None:
        """Add to the known poses (6,) of each frame those that both sides of each leap lead to."""
        for k in np.flatnonzero(leaping).tolist():
            for begin, ahead in ((k, 1), (k + 1, -1)):
                pose, frame = poses[begin], begin
                while 0 <= (to := frame + ahead) < len(poses) and self.usable[to]:
                    now, then = ({name: curve[at] for name, curve in self.targets.items()} for at in (frame, to))
                    pose, share = follow(self.model, pose, poses[to], self.free, now, then, self.tolerance_n[to])
                    inside = ((pose >= self.low) & (pose <= self.high))[self.columns].all()
                    near = any(self._mm(other - pose) < self.same_mm for other in known[to])
                    if share < 1.0 or not inside or near:
                        break
                    known[to].append(pose)
                    frame = to

    def _mm(self, steps: Array) -> Array:
        """Size (...) of steps (..., 6) of the free pose parameters [mm]."""
        return np.asarray(np.linalg.norm((steps * POSE_IN_MM)[..., self.columns], axis=-1))

    def _shortest_way(self, known: list[list[Array]], poses: Array) -> Array:
        """Poses (n, 6): of each frame with known ones that on the shortest way, of every other one what it has."""
        way, frames = poses.copy(), [k for k, of_frame in enumerate(known) if of_frame]
        layers = [np.array(known[k]) for k in frames]
        prices = [self.price_mm * self.unstable(layer) for layer in layers]
        cost, before = prices[0], []
        for last, layer, price in zip(layers, layers[1:], prices[1:], strict=False):
            through = cost[:, None] + self._mm(layer[None] - last[:, None])
            before.append(through.argmin(axis=0))
            cost = through.min(axis=0) + price
        chosen = int(cost.argmin())
        for at in range(len(frames) - 1, -1, -1):
            way[frames[at]] = layers[at][chosen]
            chosen = int(before[at - 1][chosen]) if at else 0
        return way


def follow(
    model: ContactModel,
    pose: Array,
    to: Array,
    free: Sequence[str],
    begin: Mapping[str, float],
    end: Mapping[str, float],
    tolerance_n: float,
    *,
    smallest_step: float = 0.125,
    max_iterations: int = 30,
) -> tuple[Array, float]:
    """A pose (6,) followed in steps while loads change from those of the beginning to those of the end, and what is not
    free to that of another pose (6,): the pose where that ends, and the share of the way; 1 where it comes through."""
    fixed = [column for column in range(6) if column not in [pose_index(name) for name in free]]
    first, pose, share, step = pose, pose.copy(), 0.0, 1.0
    while share < 1.0 and step >= smallest_step:
        ahead = min(share + step, 1.0)
        pose[fixed] = (1.0 - ahead) * first[fixed] + ahead * to[fixed]
        targets = {name: np.array([(1.0 - ahead) * load + ahead * end[name]]) for name, load in begin.items()}
        tried, report = settle(model, pose[None], free, targets, tolerance=tolerance_n, max_iterations=max_iterations)
        if report.converged[0]:
            pose, share = tried[0], ahead
        else:
            step *= 0.5
    return pose, share
