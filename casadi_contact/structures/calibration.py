"""Fit a surrogate's `Trust` to samples: centres and ranges on the training rows, limits on the validation rows.

Test rows take no part: the coverage reported on them, and on an unseen walking sequence, is what a user may expect.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, eye, hstack
from scipy.spatial import cKDTree

from casadi_contact.conventions import Array
from casadi_contact.dataset import DOMAINS, TEST, TRAIN, VALIDATION, Samples
from casadi_contact.structures.base import Surrogate
from casadi_contact.structures.gaussian_kernels import soft_distance
from casadi_contact.structures.trust import Trust

COVERAGE = 0.95  # share of held-out errors below the expected error
INSIDE = 0.995  # share of held-out poses near enough to the samples for a validity above 0.9
CENTRES, DENSE_CENTRES = 256, 64
BANDWIDTH, DENSE_BANDWIDTH = 0.5, 0.4  # of the scales, the deviation of an even spread over the sampled range
SHARPNESS = 1.8
MARGIN = 0.2  # of the sampled root loads: so far outside their range validity is below 0.06, half as far 0.5
NEIGHBOURS = 60  # samples around a centre that its error level comes from
_LEAST_RANGE = 1e-3  # [mm, rad] of a pose parameter that the samples never vary
_LEAST_LEVEL = 0.05  # of the level over all samples: no error bound is zero
_EXCESS = 4.0 / 3.0  # at a validity of 0.1; its negative at 0.9


def with_trust(surrogate: Surrogate, samples: Samples) -> Surrogate:
    """The surrogate with validity and expected error, and their coverage on test rows in its record.

    Raises ValueError for samples of another scene or without training or validation rows, and for a surrogate
    without root loads.
    """
    if samples.scene.digest != surrogate.scene.digest:
        raise ValueError("the samples belong to another scene than the surrogate (digests differ): draw them anew")
    training, held_out = samples.select(role=TRAIN), samples.select(role=VALIDATION)
    for what, part in (("training", training), ("validation", held_out)):
        if not len(part):
            raise ValueError(f"samples hold no {what} rows, expected some: draw samples with a validation share")
    trust = _tube(surrogate, training, held_out)
    trust = _bounded(trust, surrogate, samples.select(role=(TRAIN, VALIDATION)), held_out)
    kind = type(surrogate)
    trusted = kind(surrogate.scene, surrogate.networks, surrogate.record, trust)
    coverage = trust_coverage(trusted, samples.select(role=TEST))
    return kind(surrogate.scene, surrogate.networks, {**surrogate.record, "coverage": coverage}, trust)


def _tube(surrogate: Surrogate, training: Samples, held_out: Samples) -> Trust:
    """All that validity needs; error levels and shares are still zero."""
    scene, loads = surrogate.scene, training.loads(surrogate.load_names)
    scales = np.maximum(np.ptp(training.poses, axis=0), _LEAST_RANGE) / np.sqrt(12.0)
    points = training.poses / scales
    roots = surrogate.root_loads(training.poses)[0]
    low, high = roots.min(axis=0), roots.max(axis=0)
    boundary_root = float(np.sqrt(scene.boundary_load / scene.reference_load))
    centres, dense = _centres(_thinned(points), CENTRES), _centres(points, DENSE_CENTRES)
    distance = soft_distance(held_out.poses / scales, centres, BANDWIDTH)
    patches, count = len(surrogate.patch_names), len(surrogate.load_names)
    return Trust(
        scales=scales,
        centres=centres,
        bandwidth=BANDWIDTH,
        sharpness=SHARPNESS,
        edge=float(np.quantile(distance, INSIDE)) + _EXCESS / SHARPNESS,
        root_low=low,
        root_high=high,
        margin_low=np.maximum(MARGIN * np.abs(low), boundary_root) / 4.0,
        margin_high=np.maximum(MARGIN * np.abs(high), boundary_root) / 4.0,
        levels=np.zeros((len(centres), count)),
        dense_centres=dense,
        dense_bandwidth=DENSE_BANDWIDTH,
        dense_start=float(np.quantile(soft_distance(held_out.poses / scales, dense, DENSE_BANDWIDTH), 0.01)),
        boundary_root=boundary_root,
        shares=np.zeros((count, 3 + patches)),
        usual_loads=np.sqrt(np.mean(loads**2, axis=0)),
    )


def _thinned(points: Array) -> Array:
    """One point of each cell of a grid: spread evenly over the region, however densely it was sampled."""
    _, first = np.unique(np.floor(points / (0.5 * BANDWIDTH)).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def _centres(points: Array, count: int) -> Array:
    """At most `count` centres (K, 6) by k-means, the same for the same points."""
    if len(points) <= count:
        return points
    centres, member = kmeans2(points, count, iter=20, minit="++", rng=np.random.default_rng(0))
    return centres[np.bincount(member, minlength=count) > 0]


def _bounded(trust: Trust, surrogate: Surrogate, known: Samples, held_out: Samples) -> Trust:
    """Error levels from the samples around each centre, shares θ by quantile regression on validation rows.

    Of each load only the rows that carry it count: an error where a patch is lifted off is exactly or nearly zero.
    """
    names = surrogate.load_names
    errors = [np.abs(surrogate(part.poses) - part.loads(names)) for part in (known, held_out)]
    loaded = [part.loads(names) != 0.0 for part in (known, held_out)]
    points = trust.scaled(known.poses)
    levels = np.zeros_like(trust.levels)
    for k in range(len(names)):
        rows = loaded[0][:, k]
        if not rows.any():
            continue
        count = min(NEIGHBOURS, int(rows.sum()))
        _, near = cKDTree(points[rows]).query(trust.centres, k=count)
        own = errors[0][rows, k]
        local = np.quantile(own[near.reshape(-1, count)], COVERAGE, axis=1)
        levels[:, k] = np.maximum(local, _LEAST_LEVEL * np.quantile(own, COVERAGE))
    least = 1e-9 * np.maximum(trust.usual_loads, surrogate.scene.boundary_load)
    trust = replace(trust, levels=np.maximum(levels, least))
    level = trust.level(held_out.poses)
    features = trust.features(held_out.poses, surrogate.root_loads(held_out.poses)[0])
    shares = np.zeros_like(trust.shares)
    for k in range(len(names)):
        rows = loaded[1][:, k]
        shares[k] = _quantile_shares(features[rows], errors[1][rows, k] / level[rows, k]) if rows.any() else 1.0
    return replace(trust, shares=shares)


def _quantile_shares(features: Array, ratios: Array) -> Array:
    """θ >= 0 of the quantile regression ratio ~ features·θ: min Σ q·max(r, 0) + (1 - q)·max(-r, 0), r = ratio -
    features·θ, q = `COVERAGE`, as a linear programme in θ and the parts of r (Koenker and Bassett 1978)."""
    count, columns = features.shape
    cost = np.concatenate([np.zeros(columns), np.full(count, COVERAGE), np.full(count, 1.0 - COVERAGE)])
    parts = hstack([csr_matrix(features), eye(count), -eye(count)]).tocsr()
    answer = linprog(cost, A_eq=parts, b_eq=ratios, bounds=(0.0, None), method="highs")
    if answer.x is None:
        raise ValueError(f"the expected error cannot be fitted ({answer.message}), expected finite errors")
    # All zero would promise no error at all; the constant share keeps the bound above zero.
    shares = np.asarray(answer.x[:columns])
    shares[0] = max(shares[0], 1e-6)
    return shares


def trust_coverage(surrogate: Surrogate, samples: Samples) -> dict[str, dict[str, float]]:
    """By domain: share of poses with validity above 0.9 ("valid") and, by load, share of errors below those
    expected, over the poses that carry the load."""
    result = {}
    for domain in DOMAINS:
        part = samples.select(domain)
        if not len(part):
            continue
        wanted = part.loads(surrogate.load_names)
        below = np.abs(surrogate(part.poses) - wanted) <= surrogate.expected_error(part.poses)
        row = {"valid": float(np.mean(surrogate.validity(part.poses) > 0.9))}
        for load, column, loaded in zip(surrogate.load_names, below.T, (wanted != 0.0).T, strict=True):
            if loaded.any():
                row[load] = float(np.mean(column[loaded]))
        result[domain] = row
    return result
