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

from casadi_contact.conventions import POSE_NAMES, Array, pose_index
from casadi_contact.dataset import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes import Scene
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.structures.base import Surrogate
from casadi_contact.structures.coverage import trust_coverage
from casadi_contact.structures.cubic_logistic import cubic_terms, logistic_coefficients
from casadi_contact.structures.distrust import Border, Box, Confirmation, OffSpace
from casadi_contact.structures.gaussian_kernels import soft_distance
from casadi_contact.structures.states import States
from casadi_contact.structures.trust import Trust

COVERAGE = 0.95  # share of unseen errors that shall lie below the expected error
FITTED = 0.96  # share of validation errors that do: of unseen poses, which are spread otherwise, a hundredth fewer
INSIDE = 0.995  # share of held-out poses near enough to the samples for a validity above 0.9
CENTRES, DENSE_CENTRES = 256, 64
BANDWIDTH, DENSE_BANDWIDTH = 0.5, 0.4  # of the scales, the deviation of an even spread over the sampled range
SHARPNESS = 1.8
MARGIN = 0.2  # of the sampled root loads: so far outside their range validity is below 0.06, half as far 0.5
ROOT_SCALE = 0.3  # of a root load's range, over which its scale as a state's coordinate is that of a pose parameter
NEIGHBOURS = 60  # samples around a centre that its error level comes from
_LEAST_RANGE = 1e-3  # [mm, rad] of a pose parameter that the samples never vary
_LEAST_LEVEL = 0.05  # of the level over all samples: no error bound is zero
BOX_MARGIN = 0.015  # of the sampled range of an insensitive pose parameter: twice so far beyond it validity is 0.5
KEPT = 0.99  # share of kept poses that the border to the dropped ones leaves a validity above 0.9
CLAIM_SHARE = 0.1  # of the boundary load: contact of less than this needs no confirmation
_LEAST_DROPPED = 20  # of fewer no border can be learned
_LEAST_ROWS = 40  # of fewer no quantile is taken
_FEW_ROWS = 25  # of unseen poses, the least of which the largest ratio bounds a share `FITTED`: fewer tell no error
_LEAST_GROWTH = 1.0
_LEAST_ROOT = 0.005  # a root load is not known better than this out of contact
_EXCESS = 4.0 / 3.0  # at a validity of 0.1; its negative at 0.9


def with_trust(surrogate: Surrogate, samples: Samples, around: Samples | None = None) -> Surrogate:
    """The surrogate with validity and expected error, and their coverage on test rows in its record.

    around: poses between and beside the sampled ones with the contact model's loads (`sampling.samples_around`), so
    that the expected error holds off equilibrium too.

    Raises ValueError for samples of another scene or without training or validation rows, and for a surrogate
    without root loads.
    """
    around = samples.select(role=()) if around is None else around
    if {samples.scene.digest, around.scene.digest} != {surrogate.scene.digest}:
        raise ValueError("the samples belong to another scene than the surrogate (digests differ): draw them anew")
    kind = type(surrogate)
    surrogate = kind(surrogate.scene, surrogate.networks, surrogate.record)  # NumPy: the same file by any compiler
    training, held_out = samples.select(role=TRAIN), samples.select(role=VALIDATION)
    for what, part in (("training", training), ("validation", held_out)):
        if not len(part):
            raise ValueError(f"samples hold no {what} rows, expected some: draw samples with a validation share")
    trust = _tube(surrogate, training, held_out)
    known = samples.select(role=(TRAIN, VALIDATION))
    trust = _with_border(trust, surrogate, known, around.select(role=VALIDATION))
    trust = _confirmed(trust, surrogate, known.join_samples(around))
    trust = _bounded(trust, surrogate, training, held_out, around.select(role=VALIDATION))
    with_trust = kind(surrogate.scene, surrogate.networks, surrogate.record, trust)
    test = samples.select(role=TEST)
    record = {**surrogate.record, "coverage": trust_coverage(with_trust, test, around.select(role=TEST))}
    if len(test):
        record["valid_share"] = float(np.mean(with_trust.validity(test.poses) > 0.9))
    return kind(surrogate.scene, surrogate.networks, record, trust)


def state_columns(scene: Scene) -> list[int]:
    """Columns of the pose that tell the state of a contact beside its root loads, which stand for as many sensitive
    parameters. Of a ball in a cup, whose three are told by one root load, all six do."""
    told = len(scene.sensitive_pose) <= len(scene.patch_names)
    return [pose_index(name) for name in (scene.insensitive_pose if told else POSE_NAMES)]


def _tube(surrogate: Surrogate, training: Samples, held_out: Samples) -> Trust:
    """What validity needs of the samples themselves; error levels and shares are still zero."""
    scene, loads = surrogate.scene, training.loads(surrogate.load_names)
    scales = np.maximum(np.ptp(training.poses, axis=0), _LEAST_RANGE) / np.sqrt(12.0)
    points = training.poses / scales
    roots = surrogate.trust_roots(training.poses)
    # Of the contact model, since a root load that a network gets wrong would let others like it pass; below zero, where
    # patches are lifted off, there is none.
    low, high = roots.min(axis=0), np.sqrt(_patch_normals(training).max(axis=0) / scene.reference_load)
    boundary_root = float(np.sqrt(scene.boundary_load / scene.reference_load))
    centres, dense = _centres(_thinned(points), CENTRES), _centres(points, DENSE_CENTRES)
    distance = soft_distance(held_out.poses / scales, centres, BANDWIDTH)
    patches, count = len(surrogate.patch_names), len(surrogate.load_names)
    free = [column for column in state_columns(scene) if column in scene.pose_space.free]
    box = training.poses[:, free]
    # A parameter that never varies is far from both of its bounds, or many of them would cost validity together.
    constant = np.where(np.ptp(box, axis=0) == 0.0, _LEAST_RANGE, 0.0)
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
        levels=np.zeros((0, count)),
        dense_centres=dense,
        dense_bandwidth=DENSE_BANDWIDTH,
        dense_start=float(np.quantile(soft_distance(held_out.poses / scales, dense, DENSE_BANDWIDTH), 0.01)),
        boundary_root=boundary_root,
        shares=np.zeros((count, 3 + patches)),
        usual_loads=np.maximum(np.sqrt(np.mean(loads**2, axis=0)), _LEAST_LEVEL * scene.boundary_load),
        box=Box(
            columns=np.array(free, dtype=float),
            low=box.min(axis=0) - constant,
            high=box.max(axis=0) + constant,
            margin=np.where(
                constant > 0.0, 0.25 * _LEAST_RANGE, np.maximum(BOX_MARGIN * np.ptp(box, axis=0), _LEAST_RANGE)
            ),
        )
        if free
        else None,
        off_space=OffSpace.of(scene.pose_space),
        growth=np.ones(count),
        growth_start=-_EXCESS,
    )


def _with_border(trust: Trust, surrogate: Surrogate, known: Samples, around: Samples) -> Trust:
    """The border between kept and dropped poses, where enough were dropped to tell."""
    poses = [known.poses, around.poses, known.dropped.poses, around.dropped.poses]
    count = len(poses[0]) + len(poses[1])
    everything = np.concatenate(poses)
    if len(everything) - count < _LEAST_DROPPED:
        return trust
    columns = state_columns(surrogate.scene)
    x = np.column_stack([everything[:, columns], surrogate.trust_roots(everything)])
    centre, scale = x[:count].mean(axis=0), np.maximum(x[:count].std(axis=0), _LEAST_RANGE)
    # A pose far off says nothing of the border, and its cube would outweigh all others.
    near = (np.abs((x - centre) / scale) < 6.0).all(axis=1)
    terms, kept = cubic_terms((x - centre) / scale)[near], (np.arange(len(x)) < count)[near]
    if (~kept).sum() < _LEAST_DROPPED:
        return trust
    coefficients = logistic_coefficients(terms, kept)
    coefficients[0] += _EXCESS - float(np.quantile(terms[kept] @ coefficients, 1.0 - KEPT))
    return replace(trust, border=Border(np.array(columns, dtype=float), centre, scale, coefficients))


def _confirmed(trust: Trust, surrogate: Surrogate, known: Samples) -> Trust:
    """Above which root load contact counts as confirmed, for a structure whose loads come from other networks: well
    above the largest one where it claimed contact and there was none."""
    claims = surrogate.trust_claims(known.poses)
    if claims is None:
        return trust
    scene = surrogate.scene
    tolerance = np.full(claims.shape[1], CLAIM_SHARE * scene.boundary_load)
    # Elsewhere validity is low anyway, and root loads that extrapolate would let nothing be confirmed.
    near = trust.excess(known.poses, surrogate.trust_roots(known.poses)) < _EXCESS
    known, claims = known.rows(near), claims[near]
    roots = surrogate.trust_roots(known.poses)
    parts = normal_forces([part.normal for part in scene.parts], known.wrenches)
    false = (claims > tolerance) & ~np.logical_or.reduceat(parts > 0.0, scene.first_parts, axis=1)
    largest = np.array([max(s[rows].max(initial=0.0), 0.0) for s, rows in zip(roots.T, false.T, strict=True)])
    width = np.maximum(largest, _LEAST_ROOT)
    return replace(trust, confirmation=Confirmation(tolerance, largest + 2.5 * width, width))


def _thinned(points: Array) -> Array:
    """One point of each cell of a grid: spread evenly over the region, however densely it was sampled."""
    _, first = np.unique(np.floor(points / (0.5 * BANDWIDTH)).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def _centres(points: Array, count: int) -> Array:
    """At most `count` centres (K, 6) by k-means, the same for the same points."""
    distinct = np.unique(points, axis=0)
    if len(distinct) < len(points):  # k-means divides by the distance of the first centres
        points = distinct
    if len(points) <= count:
        return points
    centres, member = kmeans2(points, count, iter=20, minit="++", rng=np.random.default_rng(0))
    return centres[np.bincount(member, minlength=count) > 0]


def _bounded(trust: Trust, surrogate: Surrogate, training: Samples, held_out: Samples, around: Samples) -> Trust:
    """Error levels from the samples around each centre, shares θ by quantile regression on validation rows and the
    valid ones of `around`, growth from those that are not valid. A load that is carried in fewer than `_FEW_ROWS` of
    their poses may be as wrong as it is large.

    Of each load only the rows that carry it count: an error where a patch is lifted off is exactly or nearly zero. The
    valid poses around count as much as all held-out samples, and these as they are; each group has its coverage.
    """
    names = surrogate.load_names
    both = held_out.join_samples(around)
    excess = trust.excess(both.poses, surrogate.trust_roots(both.poses), surrogate.trust_claims(both.poses))
    valid, moved = excess < -_EXCESS, np.arange(len(both)) >= len(held_out)
    wanted, roots = both.loads(names), surrogate.trust_roots(both.poses)
    errors, loaded = np.abs(surrogate(both.poses) - wanted), wanted != 0.0
    # Where the levels know a row's own error, its share of them looks too small: each half is fitted on levels from
    # the other.
    used, half = valid | ~moved, np.arange(len(both)) % 2 == 0
    level, features = np.zeros_like(errors), trust.features(both.poses, roots)
    for rows in (half, ~half):
        others = _levelled(trust, surrogate, training.join_samples(both.rows(used & ~rows)))
        level[rows] = others.level(both.poses[rows], roots[rows])
    trust = _levelled(trust, surrogate, training.join_samples(both.rows(used)))
    shares = np.zeros_like(trust.shares)
    for k in range(len(names)):
        rows = loaded[:, k] & used
        if len(np.unique(both.poses[rows], axis=0)) < _FEW_ROWS:
            trust.levels[:, k] = level[:, k] = trust.usual_loads[k]
            shares[k, 0] = max(1.0, float((errors[rows, k] / trust.usual_loads[k]).max(initial=0.0)))
            continue
        weights = np.where(moved, (rows & ~moved).sum() / max((rows & moved).sum(), 1), 1.0)
        ratios = errors[:, k] / level[:, k]
        shares[k] = _quantile_shares(features[rows], ratios[rows], weights[rows])
        # One formula for all groups may give to one what another lacks: none has less than its share.
        bound = features @ shares[k]
        groups = [rows & moved, *(rows & ~moved & (both.domain == domain) for domain in np.unique(held_out.domain))]
        shares[k] *= max(1.0, *(quantile_of_unseen((ratios / bound)[group]) for group in groups))
    trust = replace(trust, shares=shares)
    inside = level * (features @ shares.T)
    growing = trust.outside(excess)
    growth = np.ones(len(names))
    for k in range(len(names)):
        rows = loaded[:, k] & (growing > 1e-3)
        if rows.sum() >= _LEAST_ROWS:
            missing = (errors[rows, k] - inside[rows, k]) / (growing[rows] * trust.usual_loads[k])
            growth[k] = max(float(np.quantile(missing, COVERAGE)), _LEAST_GROWTH)
    return replace(trust, shares=shares, growth=growth)


def quantile_of_unseen(ratios: Array) -> float:
    """What a share `FITTED` of further ratios of the same kind lies below: of n ratios the one at (n + 1)/n of that
    share, for the largest of a few is not the largest there is (conformal prediction, Vovk et al. 2005); 0 of none."""
    count = len(ratios)
    return float(np.quantile(ratios, min(1.0, FITTED * (count + 1) / count))) if count else 0.0


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
    states = replace(states, centres=_centres(_thinned(points), CENTRES))
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
        levels[:, k] = np.maximum(local, _LEAST_LEVEL * np.quantile(own, COVERAGE))
    least = 1e-9 * np.maximum(trust.usual_loads, scene.boundary_load)
    return replace(trust, states=states, levels=np.maximum(levels, least))


def _patch_normals(samples: Samples) -> Array:
    """Sum (n, P) [N] of the normal loads that press of each patch's parts."""
    parts = normal_forces([part.normal for part in samples.scene.parts], samples.wrenches)
    return np.asarray(np.add.reduceat(np.maximum(parts, 0.0), samples.scene.first_parts, axis=1))


def _quantile_shares(features: Array, ratios: Array, weights: Array) -> Array:
    """θ >= 0 of the quantile regression ratio ~ features·θ: min Σ w·(q·max(r, 0) + (1 - q)·max(-r, 0)), r = ratio -
    features·θ, q = `FITTED`, as a linear programme in θ and the parts of r (Koenker and Bassett 1978)."""
    count, columns = features.shape
    cost = np.concatenate([np.zeros(columns), FITTED * weights, (1.0 - FITTED) * weights])
    parts = hstack([csr_matrix(features), eye(count), -eye(count)]).tocsr()
    answer = linprog(cost, A_eq=parts, b_eq=ratios, bounds=(0.0, None), method="highs")
    if answer.x is None:
        raise ValueError(f"the expected error cannot be fitted ({answer.message}), expected finite errors")
    # All zero would promise no error at all; the constant share keeps the bound above zero.
    shares = np.maximum(answer.x[:columns], 0.0)  # HiGHS keeps bounds to a tolerance
    shares[0] = max(shares[0], 1e-6)
    return shares
