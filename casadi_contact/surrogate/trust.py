"""How far a surrogate can be trusted at a pose: validity in 0..1 and the expected error of every load.

Every cause of distrust is an excess u_i, below zero inside what was sampled and above zero outside:

    sharpness·(E - edge),   E = -log Σ_j exp(-|z - c_j|²/2h²)    smooth squared distance from the sampled poses
    (s_p - high_p)/margin_p - 2,  (low_p - s_p)/margin_p - 2     root load of patch p beyond the sampled range
    those of `distrust`                                          insensitive pose parameter beyond the sampled range,
                                                                 beside the pose space, dropped samples, contact that is
                                                                 not confirmed
    that of `error_classifier`                                   where the surrogate was found wrong

with z the pose over its scales and c_j centres spread over the sampled poses. A scale belongs to a parameter's whole
sampled range: too coarse to tell depth, which the root loads tell, but no pose far away counts as known because a
network there happens to give a known load. Together, and smooth to every order:

    u = log Σ_i exp(u_i),   validity = ½(1 - u/√(1 + u²))

which is 0.9 at u = -4/3, 0.1 at u = 4/3, and far outside falls with a slope that leads an optimiser back (a logistic
function is flat there). As a constraint 1/validity <= 2 is best: it grows with the square of u.

The expected error of a load adds what grows without end outside to a bound fitted to the errors of held-back samples
and of other valid poses:

    e = level·(θ_0 + θ_1·ρ + θ_2·ρ² + Σ_p θ_p·r_p + θ_λ·λ) + growth·g(u - u_0)·usual load,   all θ >= 0

level: weighted mean of the errors around each centre of `states` (in files of before: around c_j);
ρ = log(1 + exp(D - D0)), D the smooth squared distance from centres as dense as the samples;
r_p = (s_p + √(s_p² + s_b²))/2, smooth where the patch lifts off, s_b the root of the boundary load (an error of s
counts 2·N0·s times in the load); λ = 12 s_b²/(12 s_b² + Σ_p r_p²), for errors under light loads, which the others,
that grow with loads, hold too low (θ_λ is zero in files of before); g(v) = max(v, 0)³/(1 + v²), twice continuously
differentiable and zero where validity is above 0.9 (a half, in files of before).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import logsumexp

from casadi_contact.core.conventions import Array
from casadi_contact.surrogate.cut_off import cut_off, cut_off_expression
from casadi_contact.surrogate.distrust import Border, Box, Confirmation, OffSpace
from casadi_contact.surrogate.error_classifier import ErrorClassifier
from casadi_contact.surrogate.gaussian_kernels import kernel_expressions, soft_distance, weighted_mean
from casadi_contact.surrogate.states import States

SURELY_VALID, VALID, SURELY_INVALID = 0.9, 0.5, 0.1  # validities
SURE = 4.0 / 3.0  # excess at a validity of `SURELY_INVALID`; its negative at `SURELY_VALID`
KEPT = 0.99  # of right poses, that a learned cause of distrust, a border or a classifier, leaves a validity above 0.9
_POSITIVE = (
    *("scales", "bandwidth", "sharpness", "margin_low", "margin_high", "dense_bandwidth", "boundary_root"),
    *("box/margin", "states/scale", "states/root_scale", "states/bandwidth", "classifier/scale"),
)
_NOT_NEGATIVE = ("levels", "shares", "usual_loads", "growth", "light_shares")
LIGHT_LOADS = 12.0  # boundary loads: at so much on one patch λ is a half


@dataclass(frozen=True)
class Trust:
    """Plain numbers of the formulas above; L loads in the order of the surrogate's load_names, P patches.

    scales (6,) [mm, rad]; centres (K, 6) and bandwidth, sharpness, edge of the tube; root_low, root_high and their
    margins (P,); levels [N, N·mm], a row for each centre of states (without: of the tube); dense_centres (M, 6),
    dense_bandwidth and dense_start D0; boundary_root s_b; shares θ (L, 3 + P); usual_loads (L,) [N, N·mm]. What follows
    is None in files of before: states; classifier (also where none is needed); box, border and confirmation (only for a
    structure whose loads do not come from its root loads); growth (L,) and growth_start u_0; light_shares θ_λ (L,).
    off_space follows from the scene: a surrogate puts it in, and no file holds it.
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
    box: Box | None = None
    border: Border | None = None
    confirmation: Confirmation | None = None
    growth: Array | None = None
    growth_start: float | None = None
    light_shares: Array | None = None
    states: States | None = None
    classifier: ErrorClassifier | None = None
    off_space: OffSpace | None = None

    def __post_init__(self) -> None:
        for name, numbers in self.numbers().items():
            if not np.isfinite(numbers).all():
                raise ValueError(f"trust: {name} holds numbers that are not finite")
            if name in _NOT_NEGATIVE and np.any(numbers < 0.0):
                raise ValueError(f"trust: {name} holds a negative number, which would promise errors below zero")
            if name in _POSITIVE and np.any(numbers <= 0.0):
                raise ValueError(f"trust: {name} is not above zero")
            if name.endswith("/columns") and not np.isin(numbers, range(6)).all():
                raise ValueError(f"trust: {name} are {numbers}, expected columns of a pose, 0 to 5")

    def numbers(self) -> dict[str, Array]:
        """All that is given and not the scene's, by name; the numbers of parts as "box/low"."""
        given: dict[str, Array] = {}
        for field in (field for field in fields(self) if field.name != "off_space"):
            value = getattr(self, field.name)
            if is_dataclass(value):
                inner = {f"{field.name}/{part.name}": getattr(value, part.name) for part in fields(value)}
                given |= {name: np.asarray(array) for name, array in inner.items()}
            elif value is not None:
                given[field.name] = np.asarray(value)
        return given

    def scaled(self, poses: Array) -> Array:
        """z (n, 6) of poses (n, 6)."""
        return cut_off(poses / self.scales)

    def excess(self, poses: Array, roots: Array, claims: Array | None = None) -> Array:
        """u (n,) of poses (n, 6) with root loads (n, P); claims (n, P): normal loads N of a structure whose loads do
        not come from the root loads."""
        tube = self.sharpness * (soft_distance(self.scaled(poses), self.centres, self.bandwidth) - self.edge)
        causes = [
            tube[:, None],
            (roots - self.root_high) / self.margin_high - 2.0,
            (self.root_low - roots) / self.margin_low - 2.0,
        ]
        if self.box is not None:
            causes.append(self.box.excess(poses))
        if self.off_space is not None:
            causes.append(self.off_space.excess(poses))
        if self.border is not None:
            causes.append(self.border.excess(poses, roots))
        if self.classifier is not None:
            causes.append(self.classifier.excess(poses, roots))
        if self.confirmation is not None and claims is not None:
            causes.append(self.confirmation.excess(roots, claims))
        return np.asarray(logsumexp(np.column_stack(causes), axis=1))

    def validity(self, poses: Array, roots: Array, claims: Array | None = None) -> Array:
        """Validity (n,) in 0..1."""
        u = self.excess(poses, roots, claims)
        return np.asarray(0.5 - 0.5 * u / np.sqrt(1.0 + u * u))

    def features(self, poses: Array, roots: Array) -> Array:
        """1, ρ, ρ², r_1, ..., r_P, λ of each pose (n, 4 + P)."""
        dense = soft_distance(self.scaled(poses), self.dense_centres, self.dense_bandwidth)
        rare = np.logaddexp(0.0, dense - self.dense_start)
        pressed = 0.5 * (roots + np.sqrt(roots**2 + self.boundary_root**2))
        light = self.light_square / (self.light_square + (pressed**2).sum(axis=1))
        return np.column_stack([np.ones_like(rare), rare, rare**2, pressed, light])

    def level(self, poses: Array, roots: Array) -> Array:
        """Mean of the error levels around each pose (n, L) [N, N·mm]."""
        if self.states is not None:
            return self.states.mean(poses, roots, self.levels)
        return weighted_mean(self.scaled(poses), self.centres, self.bandwidth, self.levels)

    def expected_errors(self, poses: Array, roots: Array, claims: Array | None = None) -> Array:
        """e (n, L) [N, N·mm]."""
        outside = self.outside(self.excess(poses, roots, claims))
        inside = self.level(poses, roots) * (self.features(poses, roots) @ self.all_shares.T)
        return inside + outside[:, None] * self.growth_loads

    @property
    def light_square(self) -> float:
        """12 s_b²."""
        return LIGHT_LOADS * self.boundary_root**2

    @property
    def all_shares(self) -> Array:
        """θ (L, 4 + P), that of λ last."""
        light = np.zeros(len(self.shares)) if self.light_shares is None else self.light_shares
        return np.column_stack([self.shares, light])

    def outside(self, excess: Array) -> Array:
        """g of an excess u (n,)."""
        return np.asarray(_growth(np.maximum(excess - (self.growth_start or 0.0), 0.0)))

    @property
    def growth_loads(self) -> Array:
        """What `outside` is multiplied by (L,) [N, N·mm]."""
        return self.usual_loads if self.growth is None else self.growth * self.usual_loads

    def expressions(self, pose: ca.MX, roots: ca.MX, claims: ca.MX | None = None) -> tuple[ca.MX, ca.MX]:
        """Validity (1) and expected errors (L) as CasADi expressions of pose (6), root loads and claims (P)."""
        z = cut_off_expression(pose / ca.DM(self.scales))
        distance, weights = kernel_expressions(z, self.centres, self.bandwidth)
        causes = [
            self.sharpness * (distance - self.edge),
            (roots - ca.DM(self.root_high)) / ca.DM(self.margin_high) - 2.0,
            (ca.DM(self.root_low) - roots) / ca.DM(self.margin_low) - 2.0,
        ]
        if self.box is not None:
            causes.append(self.box.expression(pose))
        if self.off_space is not None:
            causes.append(self.off_space.expression(pose))
        if self.border is not None:
            causes.append(self.border.expression(pose, roots))
        if self.classifier is not None:
            causes.append(self.classifier.expression(pose, roots))
        if self.confirmation is not None and claims is not None:
            causes.append(self.confirmation.expression(roots, claims))
        excess = ca.logsumexp(ca.vertcat(*causes))
        dense, _ = kernel_expressions(z, self.dense_centres, self.dense_bandwidth)
        rare = ca.logsumexp(ca.vertcat(0.0, dense - self.dense_start))
        pressed = 0.5 * (roots + ca.sqrt(roots**2 + self.boundary_root**2))
        light = self.light_square / (self.light_square + ca.sumsqr(pressed))
        features = ca.vertcat(1.0, rare, rare**2, pressed, light)
        if self.states is None:
            level = ca.mtimes(ca.DM(self.levels.T), weights)
        else:
            level = self.states.mean_expression(pose, roots, self.levels)
        inside = level * ca.mtimes(ca.DM(self.all_shares), features)
        errors = inside + _growth(ca.fmax(excess - (self.growth_start or 0.0), 0.0)) * ca.DM(self.growth_loads)
        return 0.5 - 0.5 * excess / ca.sqrt(1.0 + excess * excess), errors


def _growth(out: Any) -> Any:
    """g = u³/(1 + u²) of u >= 0, an array or an expression."""
    return out * (out * out / (1.0 + out * out))
