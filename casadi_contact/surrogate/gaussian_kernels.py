"""Gaussian kernels around centres: k_j(z) = -|z - c_j|²/2h², in NumPy and in CasADi."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial.distance import cdist
from scipy.special import logsumexp, softmax

from casadi_contact.core.conventions import Array

_ROWS = 2000  # rows worked on at once


def thinned(points: Array, cell: float) -> Array:
    """One point of each cell of a grid so wide: spread evenly over the region, however densely it was sampled."""
    _, first = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def spread_centres(points: Array, count: int) -> Array:
    """At most `count` centres (K, d) of points (n, d) by k-means, the same for the same points."""
    distinct = np.unique(points, axis=0)
    if len(distinct) < len(points):  # k-means divides by the distance of the first centres
        points = distinct
    if len(points) <= count:
        return points
    centres, member = kmeans2(points, _first_centres(points, count), iter=20, minit="matrix")
    return np.asarray(centres[np.bincount(member, minlength=count) > 0])


def _first_centres(points: Array, count: int) -> Array:
    """Centres (K, d) among the points to begin k-means with: each drawn with a chance that grows with the square of its
    distance from those before (k-means++, Arthur and Vassilvitskii 2007), as `kmeans2` draws them; it measures the
    distances from all centres before anew for each one, which takes K/2 times as long."""
    rng = np.random.default_rng(0)
    chosen, nearest = [int(rng.integers(len(points)))], np.full(len(points), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, cdist(points[chosen[-1:]], points, "sqeuclidean")[0])
        chosen.append(int(np.searchsorted((nearest / nearest.sum()).cumsum(), rng.uniform())))
    return points[chosen]


def _blocks(points: Array, centres: Array, bandwidth: float) -> Iterator[Array]:
    for start in range(0, max(len(points), 1), _ROWS):
        block = points[start : start + _ROWS, None]
        yield -0.5 * ((block - centres) ** 2).sum(axis=2) / bandwidth**2


def soft_distance(points: Array, centres: Array, bandwidth: float) -> Array:
    """E (n,) = -log Σ_j exp k_j of points (n, 6): smooth; of the size |z - nearest centre|²/2h²."""
    return np.concatenate([-logsumexp(k, axis=1) for k in _blocks(points, centres, bandwidth)])


def weighted_mean(points: Array, centres: Array, bandwidth: float, values: Array) -> Array:
    """Σ_j w_j·values_j (n, L) with w = softmax(k), for values (K, L)."""
    return np.concatenate([softmax(k, axis=1) @ values for k in _blocks(points, centres, bandwidth)])


def kernel_expressions(z: ca.MX, centres: Array, bandwidth: float) -> tuple[ca.MX, ca.MX]:
    """E (1) and the weights w (K) of a point z (6).

    |z - c|² is written out: derivatives of 2·c·z are matrix products, and |z|²/2h² is common to all kernels.
    """
    h2 = bandwidth**2
    kernels = ca.mtimes(ca.DM(centres), z) / h2 - ca.DM((centres**2).sum(axis=1) / (2.0 * h2))
    total = ca.logsumexp(kernels)
    return 0.5 * ca.sumsqr(z) / h2 - total, ca.exp(kernels - total)
