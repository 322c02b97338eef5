"""Causes of distrust besides distance from the samples: each an excess, below zero where all is well (see `trust`).

    Box             (x_i - high_i)/margin_i - 2, (low_i - x_i)/margin_i - 2   beyond the sampled range
    Border          -κ·φ(x, s)                                                where no sample stands for the pose
    OffSpace        8·(Σ ((x_i - (M·x + c)_i)/δ)² - 1)                        beside the scene's pose space, δ = 0.001
    Confirmation    min(4·(N_p/τ_p - 1), (m_p - s_p)/w_p), rounded off        contact that no root load confirms

x are the insensitive pose parameters (those that the scene locks or ties, in OffSpace), s the root loads, N the normal
loads of a structure whose loads come from other networks than its root loads: it claims more than τ_p where no sample
without contact had so large a root load.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.scenes.pose_space import OFF_SPACE, PoseSpace
from casadi_contact.surrogate.cubic_logistic import cubic_expression, cubic_terms
from casadi_contact.surrogate.cut_off import cut_off, cut_off_expression

STEEPNESS = 8.0  # of `OffSpace`: on the space its cause is next to nothing, exp(-8)


@dataclass(frozen=True)
class Box:
    """Sampled range low..high of the pose's columns (k,) [mm, rad]: validity is a half two margins beyond it."""

    columns: Array
    low: Array
    high: Array
    margin: Array

    def excess(self, poses: Array) -> Array:
        """Two columns for each pose parameter (n, 2k)."""
        x = cut_off(poses[:, self.columns.astype(int)])
        return np.hstack([(x - self.high) / self.margin, (self.low - x) / self.margin]) - 2.0

    def expression(self, pose: ca.MX) -> ca.MX:
        """The same (2k) of a pose (6)."""
        x = cut_off_expression(pose[[int(c) for c in self.columns]])
        above, below = (x - ca.DM(self.high)) / ca.DM(self.margin), (ca.DM(self.low) - x) / ca.DM(self.margin)
        return ca.vertcat(above, below) - 2.0


@dataclass(frozen=True)
class OffSpace:
    """Locked and tied columns (k,) of the pose, their rows (k, 6) of the space's M and their offset (k,) [mm, rad].

    Validity is a half `OFF_SPACE` beside the space, and below 0.001 from twice as far on: loads are those of another
    pose there.
    """

    columns: Array
    rows: Array
    offset: Array

    @classmethod
    def of(cls, space: PoseSpace) -> OffSpace | None:
        """That of a scene's poses; None where all parameters are free."""
        columns = [k for k in range(6) if k not in space.free]
        return (
            None if space.whole else cls(np.array(columns, dtype=float), space.matrix[columns], space.offset[columns])
        )

    def excess(self, poses: Array) -> Array:
        """One column (n, 1)."""
        x = cut_off(poses)
        off = (x[:, self.columns.astype(int)] - x @ self.rows.T - self.offset) / OFF_SPACE
        return STEEPNESS * ((off**2).sum(axis=1, keepdims=True) - 1.0)

    def expression(self, pose: ca.MX) -> ca.MX:
        """The same (1) of a pose (6)."""
        x = cut_off_expression(pose)
        held = ca.mtimes(ca.sparsify(ca.DM(self.rows)), x) + ca.DM(self.offset)
        return STEEPNESS * (ca.sumsqr((x[[int(c) for c in self.columns]] - held) / OFF_SPACE) - 1.0)


@dataclass(frozen=True)
class Border:
    """Between kept and lost poses: κ (terms,) of the variables (x, s) over centre and scale (k + P,).

    Lost are those that were dropped, and those that press towards a side that was never sampled.
    In these coordinates the border, such as contact that reaches the rim of an insert, is a smooth surface; in the
    sensitive pose parameters it would have to be resolved to microns.
    """

    columns: Array
    centre: Array
    scale: Array
    coefficients: Array

    def excess(self, poses: Array, roots: Array) -> Array:
        """One column (n, 1)."""
        x = cut_off(poses[:, self.columns.astype(int)])
        scaled = (np.hstack([x, roots]) - self.centre) / self.scale
        return -(cubic_terms(scaled) @ self.coefficients)[:, None]

    def expression(self, pose: ca.MX, roots: ca.MX) -> ca.MX:
        """The same (1) of a pose (6) and root loads (P)."""
        x = cut_off_expression(pose[[int(c) for c in self.columns]])
        scaled = (ca.vertcat(x, roots) - ca.DM(self.centre)) / ca.DM(self.scale)
        return -ca.dot(ca.DM(self.coefficients), cubic_expression(scaled))


@dataclass(frozen=True)
class Confirmation:
    """tolerance τ [N], root m and width w of each patch (P,)."""

    tolerance: Array
    root: Array
    width: Array

    def excess(self, roots: Array, claims: Array) -> Array:
        """One column for each patch (n, P) of root loads (n, P) and claimed normal loads (n, P) [N]."""
        claimed, apart = 4.0 * (claims / self.tolerance - 1.0), (self.root - roots) / self.width
        return -np.logaddexp(-claimed, -apart)

    def expression(self, roots: ca.MX, claims: ca.MX) -> ca.MX:
        """The same (P) of root loads (P) and claims (P)."""
        claimed = 4.0 * (claims / ca.DM(self.tolerance) - 1.0)
        apart = (ca.DM(self.root) - roots) / ca.DM(self.width)
        return ca.vertcat(*(-ca.logsumexp(ca.vertcat(-claimed[p], -apart[p])) for p in range(len(self.root))))
