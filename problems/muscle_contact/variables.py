"""Variables of a muscle problem over all frames, and what follows from them: forces, cost, start and bounds."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.muscle import ForceCapacity, MuscleParameters
from problems.muscle_contact.dynamics import tension_bounds


class Variables(NamedTuple):
    """Variables of n frames, as `MuscleContact` says: together (k, n), the rows of each kind, and by kind."""

    together: ca.MX
    rows: list[slice]
    activations: ca.MX
    pose: ca.MX
    reserves: ca.MX
    soleus: ca.MX
    tensions: ca.MX
    patella: ca.MX

    @classmethod
    def of(cls, frames: int, sizes: Sequence[int]) -> Variables:
        """sizes: how many of each kind a frame has."""
        ends = [0, *itertools.accumulate(sizes)]
        together = ca.MX.sym("variables", ends[-1], frames)
        kinds = [slice(*pair) for pair in itertools.pairwise(ends)]
        return cls(together, kinds, *ca.vertsplit(together, ends))

    def forces(self, muscles: MuscleParameters, capacity: ForceCapacity) -> ca.MX:
        """Forces along the tendons (m, n) [N]: linear in the activations, or their tensions where tendons are
        compliant."""
        if self.tensions.numel():
            return ca.repmat(ca.DM(muscles.max_isometric_force_n), 1, self.tensions.shape[1]) * self.tensions
        return ca.DM(capacity.active_n.T) * self.activations + ca.DM(capacity.passive_n.T)

    def cost(self, muscles: MuscleParameters, exponent: float, by_volume: bool) -> ca.MX:
        """Σ w·a^p + Σ (r/size)², soleus among the activations at the weight 1."""
        volumes = muscles.max_isometric_force_n * muscles.optimal_fibre_length_m
        weights = volumes / volumes.mean() if by_volume else np.ones(len(volumes))
        effort = ca.dot(ca.DM(weights), ca.sum2(self.activations**exponent))
        return effort + ca.sum2(ca.sum1(self.soleus**exponent)) + ca.sumsqr(self.reserves)

    def start_and_bounds(
        self,
        knee: ContactFrames,
        poses: Array,
        muscles: MuscleParameters,
        capacity: ForceCapacity,
        least_activation: float,
    ) -> Array:
        """Where they begin, at poses (n, 6) of the knee, their lower and their upper bounds (3, n, k)."""
        activations, pose, reserves, soleus, tensions, patella = self.rows
        start, lower, upper = table = np.zeros((3, len(poses), self.together.shape[0]))
        for driven in (activations, soleus):
            start[:, driven], lower[:, driven] = max(0.05, least_activation), least_activation
        upper[:, activations], upper[:, soleus] = 1.0, np.inf
        for part, values in zip(table, (knee.variables(poses), knee.lower, knee.upper), strict=True):
            part[:, pose] = values.reshape(len(poses), -1)
        for free in (reserves, patella):
            lower[:, free], upper[:, free] = -np.inf, np.inf
        if self.tensions.numel():
            least, most = tension_bounds()
            lower[:, tensions], upper[:, tensions] = least, most
            begun = (0.05 * capacity.active_n + capacity.passive_n) / muscles.max_isometric_force_n
            start[:, tensions] = np.clip(begun, 10.0 * least, most)
        return table
