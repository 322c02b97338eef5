"""The expected error's numbers in a `Trust`: error levels, their shares and what grows outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import cKDTree

from casadi_contact.core.conventions import Array, Progress
from casadi_contact.samples.samples import Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.gaussian_kernels import spread_centres, thinned
from casadi_contact.surrogate.states import States, state_columns
from casadi_contact.surrogate.trust import SURE, Trust

COVERAGE = 0.95  # share of unseen errors that shall lie below the expected error
LEAST_COVERAGE = 0.94  # share of each domain, and of each kind of other poses
CENTRES = 256
BANDWIDTH = 0.5  # of the scales, the deviation of an even spread over the sampled range
ROOT_SCALE = 0.15  # of a root load's range, over which its scale as a state's coordinate is that of a pose parameter
NEIGHBOURS = 60  # samples around a centre that its error level comes from
LEAST_LEVEL = 0.05  # of the level over all samples: no error bound is zero
LEAST_ROWS = 40  # of fewer no quantile is taken
_FEW_ROWS = 25  # of unseen poses, the least of which the largest ratio bounds a share `COVERAGE`: fewer tell no error
FOLDS = 10  # of the unseen poses, of which each is bounded by a formula of the others
_LEAST_GROWTH = 1.0


def with_error_bounds(
    trust: Trust,
    surrogate: Surrogate,
    training: Samples,
    unseen: Sequence[Samples],
    progress: Progress | None = None,
) -> Trust:
    """Error levels from the samples around each centre, shares θ by quantile regression on unseen poses, growth from
    those of them that are not valid.

    unseen: the held-back samples, then other poses with the contact model's loads, of which the valid ones give shares.
    Of each load only the rows that carry it count: an error where a patch is lifted off is exactly or nearly zero. A
    load that is carried in fewer than `_FEW_ROWS` of their poses may be as wrong as it is large. The valid rows of each
    of the others count as much as all held-back samples, and these as they are; each domain and each of the others has
    its coverage. progress: called as (loads done, all).
    """
    names = surrogate.load_names
    rows_of = np.repeat(np.arange(len(unseen)), [len(part) for part in unseen])
    every = reduce(Samples.join_samples, unseen)
    roots = surrogate.trust_roots(every.poses)
    excess = trust.excess(every.poses, roots, surrogate.trust_claims(every.poses))
    wanted = every.loads(names)
    errors, loaded = np.abs(surrogate(every.poses) - wanted), wanted != 0.0
    # Where levels know a row's own error, its share of them looks too small: each half is fitted on levels from the
    # other.
    used, fold = (excess < -SURE) | (rows_of == 0), _folds(every.poses)
    half = fold % 2 == 0
    group = np.where(rows_of == 0, every.domain, -rows_of.astype(int))
    level, features = np.zeros_like(errors), trust.features(every.poses, roots)
    for rows in (half, ~half):
        others = _levelled(trust, surrogate, training.join_samples(every.rows(used & ~rows)))
        level[rows] = others.level(every.poses[rows], roots[rows])
    trust = _levelled(trust, surrogate, training.join_samples(every.rows(used)))
    shares = np.zeros_like(trust.all_shares)
    for k in range(len(names)):
        rows = loaded[:, k] & used
        if len(np.unique(every.poses[rows], axis=0)) < _FEW_ROWS:
            trust.levels[:, k] = level[:, k] = trust.usual_loads[k]
            shares[k, 0] = max(1.0, float((errors[rows, k] / trust.usual_loads[k]).max(initial=0.0)))
        else:
            counts = np.bincount(rows_of[rows], minlength=len(unseen))
            weights = np.where(rows_of == 0, 1.0, (counts[0] / np.maximum(counts, 1))[rows_of])
            ratios = errors[:, k] / level[:, k]
            shares[k] = _bounding_shares(*(part[rows] for part in (features, ratios, weights, group, fold)))
        if progress is not None:
            progress(k + 1, len(names))
    trust = replace(trust, shares=shares[:, :-1], light_shares=shares[:, -1])
    return replace(trust, growth=_growth(trust, errors - level * (features @ shares.T), loaded, excess))


def _growth(trust: Trust, missing: Array, loaded: np.ndarray, excess: Array) -> Array:
    """Growth (L,) of the bounds outside, such that a share `COVERAGE` of the errors there lies below.

    missing (n, L) [N, N·mm]: by how much errors exceed the bound that holds inside.
    """
    outside = trust.outside(excess)
    growth = np.full(missing.shape[1], _LEAST_GROWTH)
    for k, usual_load in enumerate(trust.usual_loads):
        rows = loaded[:, k] & (outside > 1e-3)
        if rows.sum() >= LEAST_ROWS:
            growth[k] = max(growth[k], float(np.quantile(missing[rows, k] / (outside[rows] * usual_load), COVERAGE)))
    return growth


def _folds(poses: Array) -> np.ndarray:
    """Number (n,) of the fold that each row belongs to, drawn at random; rows of one pose belong to one."""
    _, number = np.unique(poses, axis=0, return_inverse=True)
    number = number.reshape(-1)  # NumPy 2.0 gives it another axis
    return np.asarray(np.random.default_rng(0).permutation(len(poses))[number] % FOLDS)


def quantile_of_unseen(ratios: Array) -> float:
    """What a share q = `LEAST_COVERAGE` of further ratios of the same kind lies below, in five of six cases; 0 of none.

    Of n ratios the one at q·(n + 1)/n, for the largest of a few is not the largest there is (conformal prediction, Vovk
    et al. 2005), and higher by the standard deviation √(q·(1 - q)/n) of such a share.
    """
    if not (count := len(ratios)):
        return 0.0
    deviation = np.sqrt(LEAST_COVERAGE * (1.0 - LEAST_COVERAGE) / count)
    return float(np.quantile(ratios, min(1.0, LEAST_COVERAGE * (count + 1) / count + deviation)))


def _levelled(trust: Trust, surrogate: Surrogate, known: Samples) -> Trust:
    """Centres spread over the states of the known poses, and around each the quantile of the nearest ones' errors."""
    scene, names, columns = surrogate.scene, surrogate.load_names, state_columns(surrogate.scene)
    sqrt_12 = np.sqrt(12.0)  # range over deviation of an even spread
    states = States(
        columns=np.array(columns, dtype=float),
        scale=trust.scales[columns],
        root_scale=np.maximum(ROOT_SCALE * trust.root_high, trust.boundary_root) / sqrt_12,
        centres=np.zeros((0, len(columns) + len(trust.root_high))),
        bandwidth=BANDWIDTH,
    )
    points = states.points(known.poses, surrogate.trust_roots(known.poses))
    states = replace(states, centres=spread_centres(thinned(points, 0.5 * BANDWIDTH), CENTRES))
    wanted = known.loads(names)
    errors, loaded = np.abs(surrogate(known.poses) - wanted), wanted != 0.0
    levels = np.zeros((len(states.centres), len(names)))
    for k in range(len(names)):
        rows = loaded[:, k]
        if not rows.any():
            continue
        count = min(NEIGHBOURS, int(rows.sum()))
        _, near = cKDTree(points[rows]).query(states.centres, k=count)
        own = errors[rows, k]
        local = np.quantile(own[near.reshape(-1, count)], COVERAGE, axis=1)
        levels[:, k] = np.maximum(local, LEAST_LEVEL * np.quantile(own, COVERAGE))
    least = 1e-9 * np.maximum(trust.usual_loads, scene.boundary_load)
    return replace(trust, states=states, levels=np.maximum(levels, least))


def _bounding_shares(features: Array, ratios: Array, weights: Array, group: np.ndarray, fold: np.ndarray) -> Array:
    """θ of `_quantile_shares`, raised.

    One formula for all groups may give to one what another lacks: none has less than its share, of rows that the
    formula does not know, because it passes through a few of those that it is fitted to.
    """
    bound = np.zeros(len(ratios))
    for one in range(FOLDS):
        others = fold != one
        bound[~others] = features[~others] @ _quantile_shares(features[others], ratios[others], weights[others])
    of_groups = [quantile_of_unseen((ratios / bound)[group == one]) for one in np.unique(group)]
    return _quantile_shares(features, ratios, weights) * max(1.0, *of_groups)


def _quantile_shares(features: Array, ratios: Array, weights: Array) -> Array:
    """θ >= 0 of the quantile regression ratio ~ features·θ: min Σ w·(q·max(r, 0) + (1 - q)·max(-r, 0)), r = ratio -
    features·θ, q = `COVERAGE` (Koenker and Bassett 1978).

    θ are the multipliers of its dual, max ratio·a with featuresᵀ·a <= 0 and (q - 1)·w <= a <= q·w: a linear programme
    of as many rows as there are shares.
    """
    bounds = np.stack([(COVERAGE - 1.0) * weights, COVERAGE * weights], -1)
    answer = linprog(-ratios, A_ub=features.T, b_ub=np.zeros(features.shape[1]), bounds=bounds, method="highs")
    if answer.x is None:
        raise ValueError(f"the expected error cannot be fitted ({answer.message}), expected finite errors")
    # All zero would promise no error at all; the constant share keeps the bound above zero.
    shares = np.maximum(-answer.ineqlin.marginals, 0.0)  # HiGHS keeps their sign to a tolerance
    shares[0] = max(shares[0], 1e-6)
    return shares
