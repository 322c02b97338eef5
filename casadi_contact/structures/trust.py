"""How far a surrogate can be trusted at a pose: validity in 0..1 and the expected error of every load.

Every cause of distrust is an excess u_i, below zero inside what was sampled and above zero outside:

    u_0 = sharpness·(E - edge),   E = -log Σ_j exp(-|z - c_j|²/2h²)    smooth squared distance from the sampled poses
    u_p = (s_p - high_p)/margin_p - 2,  (low_p - s_p)/margin_p - 2     root load of patch p beyond the sampled range

with z the pose over its scales and c_j centres spread over the sampled poses. A scale belongs to a parameter's whole
sampled range: too coarse to tell depth, which the root loads tell, but no pose far away counts as known because a
network there happens to give a known load. Together, and smooth to every order:

    u = log Σ_i exp(u_i),   validity = ½(1 - u/√(1 + u²))

which is 0.9 at u = -4/3, 0.1 at u = 4/3, and far outside falls with a slope that leads an optimiser back (a logistic
function is flat there: IPOPT, kept by validity >= 1/2, then solved none of the cases of which it now solves most).

The expected error of a load adds what grows without end outside to a bound fitted to the errors of held-out samples:

    e = level·(θ_0 + θ_1·ρ + θ_2·ρ² + Σ_p θ_p·r_p) + g(u)·usual load,   all θ >= 0

level: weighted mean of the errors around each centre c_j; ρ = log(1 + exp(D - D0)), D the smooth squared distance
from centres as dense as the samples; r_p = (s_p + √(s_p² + s_b²))/2, smooth where the patch lifts off, s_b the root of
the boundary load (an error of s counts 2·N0·s times in the load); g = max(u, 0)³/(1 + u²), twice continuously
differentiable and zero where validity is above a half.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca
import numpy as np
from scipy.special import logsumexp

from casadi_contact.conventions import Array
from casadi_contact.structures.gaussian_kernels import kernel_expressions, soft_distance, weighted_mean

_FAR = 1e8  # scaled pose parameters are cut off here, so that the square of any finite pose is finite
_POSITIVE = ("scales", "bandwidth", "sharpness", "margin_low", "margin_high", "dense_bandwidth")
_NOT_NEGATIVE = ("levels", "shares", "usual_loads", "boundary_root")


@dataclass(frozen=True)
class Trust:
    """Plain numbers of the formulas above; L loads in the order of the surrogate's load_names, P patches.

    scales (6,) [mm, rad]; centres (K, 6) and bandwidth, sharpness, edge of the tube; root_low, root_high and their
    margins (P,); levels (K, L) [N, N·mm]; dense_centres (M, 6), dense_bandwidth and dense_start D0; boundary_root s_b;
    shares θ (L, 3 + P); usual_loads (L,) [N, N·mm].
    """

    scales: Array
    centres: Array
    bandwidth: float
    sharpness: float
    edge: float
    root_low: Array
    root_high: Array
    margin_low: Array
    margin_high: Array
    levels: Array
    dense_centres: Array
    dense_bandwidth: float
    dense_start: float
    boundary_root: float
    shares: Array
    usual_loads: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            numbers = np.asarray(getattr(self, field.name))
            if not np.isfinite(numbers).all():
                raise ValueError(f"trust: {field.name} holds numbers that are not finite")
            if field.name in _NOT_NEGATIVE and np.any(numbers < 0.0):
                raise ValueError(f"trust: {field.name} holds a negative number, which would promise errors below zero")
            if field.name in _POSITIVE and np.any(numbers <= 0.0):
                raise ValueError(f"trust: {field.name} is not above zero")

    def scaled(self, poses: Array) -> Array:
        """z (n, 6) of poses (n, 6)."""
        return np.clip(poses / self.scales, -_FAR, _FAR)

    def excess(self, poses: Array, roots: Array) -> Array:
        """u (n,) of poses (n, 6) with root loads (n, P)."""
        tube = self.sharpness * (soft_distance(self.scaled(poses), self.centres, self.bandwidth) - self.edge)
        deep = (roots - self.root_high) / self.margin_high - 2.0
        far = (self.root_low - roots) / self.margin_low - 2.0
        return np.asarray(logsumexp(np.column_stack([tube, deep, far]), axis=1))

    def validity(self, poses: Array, roots: Array) -> Array:
        """Validity (n,) in 0..1."""
        u = self.excess(poses, roots)
        return np.asarray(0.5 - 0.5 * u / np.sqrt(1.0 + u * u))

    def features(self, poses: Array, roots: Array) -> Array:
        """1, ρ, ρ², r_1, ..., r_P of each pose (n, 3 + P)."""
        dense = soft_distance(self.scaled(poses), self.dense_centres, self.dense_bandwidth)
        rare = np.logaddexp(0.0, dense - self.dense_start)
        pressed = 0.5 * (roots + np.sqrt(roots**2 + self.boundary_root**2))
        return np.column_stack([np.ones_like(rare), rare, rare**2, pressed])

    def level(self, poses: Array) -> Array:
        """Mean of the error levels around each pose (n, L) [N, N·mm]."""
        return weighted_mean(self.scaled(poses), self.centres, self.bandwidth, self.levels)

    def expected_errors(self, poses: Array, roots: Array) -> Array:
        """e (n, L) [N, N·mm]."""
        out = np.maximum(self.excess(poses, roots), 0.0)
        growth = out * (out * out / (1.0 + out * out))
        inside = self.level(poses) * (self.features(poses, roots) @ self.shares.T)
        return inside + growth[:, None] * self.usual_loads

    def expressions(self, pose: ca.MX, roots: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Validity (1) and expected errors (L) as CasADi expressions of pose (6) and root loads (P)."""
        z = ca.fmin(ca.fmax(pose / ca.DM(self.scales), -_FAR), _FAR)
        distance, weights = kernel_expressions(z, self.centres, self.bandwidth)
        tube = self.sharpness * (distance - self.edge)
        deep = (roots - ca.DM(self.root_high)) / ca.DM(self.margin_high) - 2.0
        far = (ca.DM(self.root_low) - roots) / ca.DM(self.margin_low) - 2.0
        excess = ca.logsumexp(ca.vertcat(tube, deep, far))
        out = ca.fmax(excess, 0.0)
        growth = out * (out * out / (1.0 + out * out))
        dense, _ = kernel_expressions(z, self.dense_centres, self.dense_bandwidth)
        rare = ca.logsumexp(ca.vertcat(0.0, dense - self.dense_start))
        pressed = 0.5 * (roots + ca.sqrt(roots**2 + self.boundary_root**2))
        features = ca.vertcat(1.0, rare, rare**2, pressed)
        inside = ca.mtimes(ca.DM(self.levels.T), weights) * ca.mtimes(ca.DM(self.shares), features)
        return 0.5 - 0.5 * excess / ca.sqrt(1.0 + excess * excess), inside + growth * ca.DM(self.usual_loads)
