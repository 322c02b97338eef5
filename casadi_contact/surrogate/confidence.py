"""How far a surrogate can be relied on at a pose: validity in 0..1 and the expected error of every load.

Two causes make a pose invalid. Each is an excess u_i, below zero inside the learned region and above zero outside:

    u_1 = sharpness·(E - edge),   E = -log Σ_j exp(-|z - c_j|²/2h²)    smooth squared distance to the samples
    u_2 = y_0(x, s)                                                    classifier of wrong poses

z = W·pose are the pose parameters over their sampled ranges, and c_j are centres spread over the samples. A parameter
that is tied to another is first reduced by what it follows from; with that, and with locked ones, z leaves the samples
within micrometres. x are columns of the pose, s the root loads of the patches; y is one network with an output for the
classifier and one for each load. A pose is *wrong* if an error exceeds a few tolerances of the scene (see
`surrogate.calibration`). Distances are too coarse to see the penetration depth; the root loads show it. The classifier
does not extrapolate; the distance does. Both together, smooth to every order:

    u = log(exp(u_1) + exp(u_2)),   validity = ½(1 - u/√(1 + u²))

Validity is 0.9 at u = -4/3 and 0.1 at u = 4/3. Far outside it falls with a slope that leads an optimiser back (a
logistic function is flat there). As a constraint use 1/validity <= 2: it grows with the square of u.

The expected error of load k, below which 95 % of the errors lie, has a part that grows without bound outside:

    e_k = exp(y_k(x, s)) + growth_k·g(u + 4/3),   g(v) = max(v, 0)³/(1 + v²)

g is twice continuously differentiable, and zero where validity is above 0.9.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import logsumexp

from casadi_contact.core.conventions import Array
from casadi_contact.networks.graph import network_value
from casadi_contact.networks.network import Network

SURELY_VALID, VALID = 0.9, 0.5  # validities
SURE = 4.0 / 3.0  # excess at a validity of 0.1; its negative at `SURELY_VALID`
FAR = 1e8  # poses are clipped here, so that their squares are finite (in C: ``confidence.h``)


def clip(values: Array) -> Array:
    """Values within ±`FAR`."""
    return np.clip(values, -FAR, FAR)


@dataclass(frozen=True)
class Confidence:
    """Numbers of the formulas above, for P patches and the L loads of the surrogate's load_names.

    whitening W (6, 6) [1/mm, 1/rad]; centres (K, 6), bandwidth h, sharpness and edge of the distance; columns (k,) of
    the pose, before root loads; network of k + P inputs and 1 + L outputs; growth (L,) [N, N·mm].
    """

    whitening: Array
    centres: Array
    bandwidth: float
    sharpness: float
    edge: float
    columns: Array
    network: Network
    growth: Array

    def __post_init__(self) -> None:
        for name, numbers in self.numbers().items():
            if not np.isfinite(numbers).all():
                raise ValueError(f"confidence: {name} holds numbers that are not finite")
        for name in ("bandwidth", "sharpness"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"confidence: {name} is {getattr(self, name)}, expected a number above zero")
        if np.any(self.growth < 0.0):
            raise ValueError("confidence: growth holds a negative number, expected errors that grow outside")
        if not (np.isin(self.columns, range(6)).all() and np.all(np.diag(self.whitening) > 0.0)):
            raise ValueError("confidence: expected columns of a pose, 0 to 5, and a whitening with a positive diagonal")

    def numbers(self) -> dict[str, Array]:
        """All arrays but those of the network, by name."""
        return {name: np.asarray(value, float) for name, value in vars(self).items() if name != "network"}

    def check_shapes(self, patches: int, loads: int) -> None:
        """Raise ValueError for arrays of other shapes than so many patches and loads have: C would read beyond them."""
        network, centres, columns = self.network, max(len(self.centres), 1), np.size(self.columns)
        found = [np.shape(array) for array in self.numbers().values()]
        expected = [(6, 6), (centres, 6), (), (), (), (columns,), (loads,)]
        found.append((len(network.input_shift), network.outputs))
        expected.append((columns + patches, 1 + loads))
        for name, shape, wanted in zip((*self.numbers(), "network"), found, expected, strict=True):
            if shape != wanted:
                cure = f"for {patches} patches and {loads} loads: calibrate the surrogate again"
                raise ValueError(f"confidence: {name} has shape {shape}, expected {wanted} {cure}")

    @property
    def scales(self) -> Array:
        """Standard deviation (6,) [mm, rad] of an even spread over the sampled range of each pose parameter."""
        return np.asarray(1.0 / np.diag(self.whitening))

    @property
    def centre_poses(self) -> Array:
        """The centres as poses (K, 6)."""
        return np.asarray(np.linalg.solve(self.whitening, self.centres.T).T)

    def distance(self, poses: Array) -> Array:
        """E (n,) of poses (n, 6)."""
        z = clip(poses) @ self.whitening.T
        rows = 2000  # at once, for the size of (rows, K)
        blocks = (z[i : i + rows].T for i in range(0, max(len(z), 1), rows))
        squares = (sum((x[:, None] - c) ** 2 for x, c in zip(block, self.centres.T, strict=True)) for block in blocks)
        return np.concatenate([-logsumexp(-0.5 * s / self.bandwidth**2, axis=1) for s in squares])

    def inputs(self, poses: Array, roots: Array) -> Array:
        """Inputs (n, k + P) of the network at poses (n, 6) with root loads (n, P)."""
        return np.hstack([clip(poses)[:, self.columns.astype(int)], roots])

    def _excess_and_logs(self, poses: Array, roots: Array) -> tuple[Array, Array]:
        """u (n,), and y_1..y_L (n, L)."""
        y = self.network.value(self.inputs(poses, roots))
        return np.logaddexp(self.sharpness * (self.distance(poses) - self.edge), y[:, 0]), y[:, 1:]

    def validity(self, poses: Array, roots: Array) -> Array:
        """Validity (n,) in 0..1 of poses (n, 6) with root loads (n, P)."""
        return np.asarray(_validity(np, self._excess_and_logs(poses, roots)[0]))

    def expected_errors(self, poses: Array, roots: Array) -> Array:
        """e (n, L) [N, N·mm] there."""
        u, logs = self._excess_and_logs(poses, roots)
        return np.exp(logs) + growth_outside(np.maximum(u + SURE, 0.0))[:, None] * self.growth

    def expressions(self, pose: ca.MX, roots: ca.MX) -> dict[str, ca.MX]:
        """validity (1) and expected_error (L) as CasADi expressions of a pose (6) and root loads (P)."""
        clipped = pose / ca.fmax(1.0, ca.fabs(pose) / FAR)  # unlike fmin and fmax of CasADi this keeps NaN
        z = ca.mtimes(ca.sparsify(ca.DM(self.whitening)), clipped)
        # |z - c|² is written out: derivatives of 2·c·z are matrix products, and |z|²/2h² is common to all centres.
        h2 = self.bandwidth**2
        squares = ca.DM((self.centres**2).sum(axis=1) / (2.0 * h2))
        distance = 0.5 * ca.sumsqr(z) / h2 - ca.logsumexp(ca.mtimes(ca.DM(self.centres), z) / h2 - squares)
        x = ca.vertcat(clipped[[int(c) for c in self.columns]], roots)
        y = network_value(self.network, x)
        u = ca.logsumexp(ca.vertcat(self.sharpness * (distance - self.edge), y[0]))
        outside = growth_outside(ca.fmax(u + SURE, 0.0))
        return {
            "validity": _validity(ca, u),
            "expected_error": ca.exp(y[1:]) + outside * ca.DM(self.growth),
        }


def _validity(library: Any, u: Any) -> Any:
    return 0.5 - 0.5 * u / library.sqrt(1.0 + u * u)


def growth_outside(v: Any) -> Any:
    """g = v³/(1 + v²) of v >= 0, an array or an expression."""
    return v * (v * v / (1.0 + v * v))
