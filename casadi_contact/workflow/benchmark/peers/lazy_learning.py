"""Lazy learning: local linear regression on the nearest stored samples; where they are no good, the EF is asked.

    F(x) = β_0,   β = argmin Σ_i w_i |F_i - β_0 - β_1ᵀ(z_i - z)|²,   w_i = (1 - (d_i/d_max)³)³

over the nearest neighbours in scaled poses. The contact model is asked, and its answer stored, where the neighbours
lie farther than stored samples lie from each other, or where the local plane misses them by more than a multiple of
the scene's tolerances (the paper's introduction on lazy learning).
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.workflow.benchmark.candidate import Candidate, Stopwatch
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from casadi_contact.workflow.benchmark.timing import one_thread

FAMILY = "lazy learning"
NEIGHBOURS = 28  # four for each of the plane's seven coefficients
FAR_SHARE = 0.99  # farther than this share of the stored samples have their own neighbours: too far
TOLERANCE_MULTIPLES = (1.0, 10.0, 100.0)
TRIAL_POSES = 500
RIDGE = 1e-9
FIRST_ROOM = 64


class LazyLearner:
    """Loads (L) from a store that grows; ``asked`` counts the calls of the contact model since the last `reset`.

    Every call with an array of poses begins from the training samples again, so that it does not depend on earlier
    ones.
    """

    def __init__(self, data: TrainingSet, model: ContactModel, tolerance_multiple: float) -> None:
        if len(data) <= NEIGHBOURS:
            raise ValueError(f"lazy learning needs more than {NEIGHBOURS} training samples, got {len(data)}")
        self.load_names, self._model = data.load_names, model
        self._columns = [model.load_names.index(name) for name in data.load_names]
        self._centre, self._inverse = data.centre, 1.0 / data.spread
        self._stored, self._loads = (data.poses - self._centre) * self._inverse, data.loads
        self._tree = cKDTree(self._stored)
        some = self._stored[:: max(1, len(data) // 2000)]
        self._far = float(np.quantile(self._tree.query(some, NEIGHBOURS + 1)[0][:, -1], FAR_SHARE))
        scene = data.scene
        tolerances = [scene.tolerances.get(name, scene.boundary_load) for name in data.load_names]
        self._squared_limit = (tolerance_multiple * np.array(tolerances)) ** 2
        self._limits = data.limits
        self.reset()

    def reset(self) -> None:
        """Forget every answer of the contact model."""
        self.asked = 0
        self._new, self._new_loads = np.empty((FIRST_ROOM, 6)), np.empty((FIRST_ROOM, len(self.load_names)))

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L) of poses taken in order, beginning from the training samples alone."""
        self.reset()
        return np.stack([self.one(pose) for pose in as_poses(poses)])

    def one(self, pose: Array) -> Array:
        """Loads (L) of one pose; may ask the contact model and remember its answer."""
        z = (pose - self._centre) * self._inverse
        distances, rows = self._tree.query(z, NEIGHBOURS)
        points, loads = self._stored[rows] - z, self._loads[rows]
        if self.asked:
            added = self._new[: self.asked] - z
            squares = np.einsum("ij,ij->i", added, added)
            near = np.flatnonzero(squares < distances[-1] ** 2)
            if len(near):
                distances = np.concatenate([distances, np.sqrt(squares[near])])
                nearest = np.argsort(distances)[:NEIGHBOURS]
                distances = distances[nearest]
                points = np.concatenate([points, added[near]])[nearest]
                loads = np.concatenate([loads, self._new_loads[near]])[nearest]
        if distances[-1] > self._far:
            return self._ask(pose, z)
        weights = 1.0 - (distances / (1.001 * distances[-1] + 1e-12)) ** 3
        weights = weights * weights * weights
        plane = np.empty((len(points), 7))
        plane[:, 0], plane[:, 1:] = 1.0, points
        weighted = plane.T * weights
        normal = weighted @ plane
        normal.flat[::8] += RIDGE * normal[0, 0]
        fit = np.linalg.solve(normal, weighted @ loads)
        off = loads - plane @ fit
        # Mean squared miss of the neighbours, corrected for the seven coefficients that they had to give.
        miss = weights @ (off * off) / (weights.sum() * (1.0 - 7.0 / NEIGHBOURS))
        if (miss > self._squared_limit).any():
            return self._ask(pose, z)
        return self._limits.hold(fit[0])

    def _ask(self, pose: Array, z: Array) -> Array:
        loads: Array = self._model(pose[None])[0, self._columns]
        if self.asked == len(self._new):
            self._new = np.concatenate([self._new, np.empty_like(self._new)])
            self._new_loads = np.concatenate([self._new_loads, np.empty_like(self._new_loads)])
        self._new[self.asked], self._new_loads[self.asked] = z, loads
        self.asked += 1
        return loads


def _calls_in_order(model: LazyLearner) -> Stopwatch:
    """Single calls that begin from the training samples: what was learned in the last measurement is forgotten."""

    def measure(poses: Array) -> float:
        with one_thread():
            model.reset()
            start = time.perf_counter()
            for pose in poses:
                model.one(pose)
            return (time.perf_counter() - start) / len(poses)

    return measure


def lazy_learning(data: TrainingSet) -> Iterator[Candidate]:
    """Lazy learners that ask the scene's fine EF, by how much they tolerate; a tree is all their training."""
    foundation = ElasticFoundation(data.scene, data.scene.grids["fine"])
    for multiple in TOLERANCE_MULTIPLES:
        began = time.process_time()
        model = LazyLearner(data, foundation, multiple)
        took = time.process_time() - began
        trial = data.validation_poses[:TRIAL_POSES]
        counted = "no validation poses to count on"
        if len(trial):
            model(trial)
            counted = f"asked the EF for {model.asked} of {len(trial)} validation poses"
        yield Candidate(
            f"{FAMILY} {multiple:g}× tolerance",
            FAMILY,
            model,
            time_value=_calls_in_order(model),
            samples=len(data),
            training_seconds=took,
            parameters=data.poses.size + data.loads.size,
            remark=f"{NEIGHBOURS} neighbours, {counted}; no batch: each answer may teach the next; not differentiable",
        )
