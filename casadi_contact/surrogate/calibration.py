"""Fit a surrogate's `Confidence` to samples, and to poses around and between them where the contact model is at hand.

*Valid* means that the errors of all loads, with what the contact model carries at the edges of its elements, are
expected to stay within a few tolerances of the scene, fewer in light contact. A surrogate that misses them everywhere
is nowhere valid. Test rows take no part, nor do unseen cycles, whose poses are found on the surrogate: the coverage
reported there is what a user may expect.
"""

import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.cluster.vq import kmeans2

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array, Progress, Update, load_selection, stage_progress
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.samples.calibration_poses import (
    cycle_poses,
    label_poses,
    perturbed_poses,
    poses_in_range,
    self_settled_poses,
)
from casadi_contact.samples.models import model_name_of
from casadi_contact.samples.samples import DOMAINS, TEST, TRAIN, VALIDATION, Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.confidence import SURE, SURELY_VALID, VALID, Confidence, growth_outside

_OF_THE_MODEL = ("model_errors", "model_errors_against")  # keys of the record


@dataclass(frozen=True)
class CalibrationSettings:
    """What a calibration goes by.

    tolerances: a pose is wrong where the error of any load exceeds so many tolerances of the scene under its reference
    load; `light` times as many without load, and in proportion between.
    kept: share of accurate validation rows that the classifier leaves a validity above 0.9; wrong_share: at most so
    many of the poses that it calls valid may be wrong, whatever `kept` asks for.
    coverage: share of unseen errors below the expected error, all together; group_coverage: of each group of poses.
    inside: share of validation rows near enough to the
    samples for a validity above 0.9.
    rows: validation rows, perturbed, pressed and self-settled poses, at most so many of each, and half as many lifted;
    of a user's own model, which may be slow, at most own_rows.
    centres, bandwidth [of the scales], sharpness: of the distance. least_range: of a parameter that never varies
    [mm, rad]. hidden, iterations, steepness: of the classifier; its output times steepness is u_2.
    """

    tolerances: float = 5.0
    light: float = 0.4
    kept: float = 0.99
    wrong_share: float = 0.03
    coverage: float = 0.95
    group_coverage: float = 0.94
    inside: float = 0.995
    rows: int = 9000
    own_rows: int = 2000
    centres: int = 256
    bandwidth: float = 0.5
    sharpness: float = 1.8
    least_range: float = 1e-3
    hidden: tuple[int, int] = (20, 20)
    iterations: int = 100
    steepness: float = 8.0
    seed: int = 0


class _Rows(NamedTuple):
    """Poses (n, 6) with root loads (n, P), errors (n, L) [N, N·mm], the largest of them, and of what edges carry, over
    what is allowed (n,), whether a load is carried (n, L) and its group (n): a domain, or one of the other kinds."""

    poses: Array
    roots: Array
    errors: Array
    ratio: Array
    carried: np.ndarray
    group: np.ndarray


def calibrate(
    surrogate: Surrogate,
    samples: Samples,
    model: ContactModel | None = None,
    update: Update | None = None,
    settings: CalibrationSettings | None = None,
    executor: Executor | None = None,
) -> Surrogate:
    """The surrogate with validity and expected error, and their coverage on test rows in its record.

    model: the contact model that the samples come from. It is evaluated around the samples, over their whole range, and
    where the surrogate's own loads lead a solver; without it both hold on poses like the samples only. update: called
    as (what, done, all, remark) meanwhile. executor: workers, where a model of the library is slow.

    Raises ValueError for samples of another scene or without training or validation rows, and for a surrogate without
    root loads.
    """
    settings = settings or CalibrationSettings()
    if samples.scene.digest != surrogate.scene.digest:
        raise ValueError("the samples belong to another scene than the surrogate (digests differ): draw them anew")
    kind = type(surrogate)
    surrogate = kind(surrogate.scene, surrogate.networks, surrogate.record)  # NumPy: the same file by any compiler
    training, validation = samples.select(role=TRAIN), samples.select(role=VALIDATION)
    for what, part in (("training", training), ("validation", validation)):
        if not len(part):
            raise ValueError(f"samples hold no {what} rows, expected some: draw samples with a validation share")
    blank = _distance(surrogate, training, validation, settings)
    progress = stage_progress(update, f"{surrogate.structure}: other poses")
    others: dict[str, Samples] = {}
    if model is not None:
        others = _other_poses(surrogate, blank, samples, model, settings, progress, executor)
    rows = _rows(surrogate, validation, [part.select(role=VALIDATION) for part in others.values()], model, settings)
    confidence = _fit(surrogate, blank, rows, settings)
    calibrated = kind(surrogate.scene, surrogate.networks, surrogate.record, confidence)
    test = samples.select(role=TEST)
    unseen = {name: part.select(role=TEST) for name, part in others.items()}
    if model is not None and len(poses := cycle_poses(surrogate, samples)):
        unseen["cycles"] = label_poses(model, samples, poses, executor)
    record = {**surrogate.record, "coverage": coverage_by_group(calibrated, test, unseen)}
    if len(test):
        record["valid_share"] = float(np.mean(calibrated.validity(test.poses) > SURELY_VALID))
    if model is not None:  # what was known of another model is not known of this one
        record = {key: value for key, value in record.items() if key not in _OF_THE_MODEL} | _model_errors(model)
    return kind(surrogate.scene, surrogate.networks, record, confidence)


def spread_centres(points: Array, count: int, cell: float = 0.25) -> Array:
    """At most `count` centres (K, d) spread evenly over the region of points (n, d), however densely each part of it
    was sampled: k-means of one point from each cell of a grid. The same for the same points."""
    _, first = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_index=True)
    points = np.unique(points[np.sort(first)], axis=0)
    if len(points) <= count:
        return points
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of empty clusters, which are left out
        centres, member = kmeans2(points, count, iter=20, minit="points", rng=np.random.default_rng(0))
    return np.asarray(centres[np.bincount(member, minlength=count) > 0])


def _distance(
    surrogate: Surrogate, training: Samples, validation: Samples, settings: CalibrationSettings
) -> Confidence:
    """A confidence whose distance is fitted, and whose network is zero."""
    space, names = surrogate.scene.pose_space, surrogate.load_names
    bound = [k for k in range(6) if k not in space.free]
    reduced = np.eye(6)
    reduced[bound] -= space.matrix[bound]
    ranges = np.maximum(np.ptp(training.poses @ reduced.T, axis=0), settings.least_range)
    whitening = np.sqrt(12.0) * reduced / ranges[:, None]
    columns = [k for k in surrogate.confidence_columns if np.ptp(training.poses[:, k]) > 0.0]
    inputs, outputs = len(columns) + len(surrogate.patch_names), 1 + len(names)
    blank = Network(np.zeros(inputs), np.ones(inputs), (np.zeros((outputs, inputs)),), (np.zeros(outputs),))
    centres = spread_centres(training.poses @ whitening.T, settings.centres, 0.5 * settings.bandwidth)
    values = (whitening, centres, settings.bandwidth, settings.sharpness)
    confidence = Confidence(*values, 0.0, np.array(columns, dtype=float), blank, np.zeros(len(names)))
    edge = float(np.quantile(confidence.distance(validation.poses), settings.inside)) + SURE / settings.sharpness
    return replace(confidence, edge=edge)


def _other_poses(
    surrogate: Surrogate,
    confidence: Confidence,
    samples: Samples,
    model: ContactModel,
    settings: CalibrationSettings,
    progress: Progress | None,
    executor: Executor | None,
) -> dict[str, Samples]:
    """Poses around the samples, over their range, self-settled ones and some that became no samples, with the model's
    loads."""

    def near(poses: Array) -> np.ndarray:
        """Mask of poses with a distance that leaves validity above about 0.05."""
        return np.asarray(confidence.sharpness * (confidence.distance(poses) - confidence.edge) < 2.0)

    own = model_name_of(samples) is None
    # Twice the rows that are fitted to: the others are test rows.
    count = min(2 * settings.rows, len(samples) // 3, settings.own_rows if own else len(samples))
    settled, lost = self_settled_poses(surrogate, samples, count), samples.dropped.poses
    poses = {
        "around": perturbed_poses(samples, count),
        "range": poses_in_range(samples, count, near, surrogate.confidence_roots),
        "settled": settled[near(settled)] if own and len(settled) else settled,
    }
    if len(lost):
        poses["dropped"] = lost[np.random.default_rng(19).permutation(len(lost))[:count]]
    parts = {}
    for k, (name, part) in enumerate(poses.items(), start=1):
        if len(part):
            parts[name] = label_poses(model, samples, part, executor)
        if progress is not None:
            progress(k, len(poses))
    return parts


def _rows(
    surrogate: Surrogate,
    validation: Samples,
    others: Sequence[Samples],
    model: ContactModel | None,
    settings: CalibrationSettings,
) -> _Rows:
    """At most `rows` validation rows, and all others. Poses at which the model gave no loads have infinite errors."""
    rng, parts, names = np.random.default_rng(settings.seed), [], surrogate.load_names
    scene = surrogate.scene
    for k, part in enumerate([validation, *others]):
        chosen = part if k else part.rows(np.sort(rng.permutation(len(part))[: settings.rows]))
        poses, target = chosen.poses, chosen.loads(names)
        errors = np.abs(surrogate(poses) - target)
        load = np.linalg.norm(chosen.wrenches[..., :3], axis=2).sum(axis=1) / scene.reference_load
        share = settings.light + (1.0 - settings.light) * np.minimum(load, 1.0)
        allowed = settings.tolerances * share[:, None] * scene.tolerances_of(names)
        unsure = errors
        if (edges := getattr(model, "edge_wrenches", None)) is not None and len(poses):
            selection = load_selection(names, scene.patch_names)
            unsure = errors + np.abs(np.einsum("lpk,npk->nl", selection, edges(poses)))
        ratio = np.nan_to_num((unsure / allowed).max(axis=1), nan=np.inf)
        group = np.full(len(poses), len(DOMAINS) + k) if k else chosen.domain.astype(int)
        errors = np.nan_to_num(errors, nan=np.inf)
        parts.append(_Rows(poses, surrogate.confidence_roots(poses), errors, ratio, _carried(target), group))
    return _Rows(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _carried(loads: Array) -> np.ndarray:
    """Which loads (n, L) are numbers, and not zero."""
    return np.isfinite(loads) & (loads != 0.0)


def _fit(surrogate: Surrogate, confidence: Confidence, rows: _Rows, settings: CalibrationSettings) -> Confidence:
    """The network and the growth.

    Hidden layers are fitted to the classifier's target 2q²/(1 + q²) - 1, with q the ratio of the rows: -1 where the
    surrogate is accurate, 0 at the limit, 1 where it is wrong; accurate and wrong poses weigh alike. The outputs of the
    loads are linear quantile regressions of log(error) on the last hidden layer, over valid poses that carry the load.
    """
    tolerances = surrogate.scene.tolerances_of(surrogate.load_names)
    q = np.minimum(rows.ratio, 1e3)
    wrong, x = q > 1.0, confidence.inputs(rows.poses, rows.roots)
    network = _classifier(x, 2.0 * q**2 / (1.0 + q**2) - 1.0, settings)
    answer, near = network.value(x), confidence.distance(rows.poses) < confidence.edge
    from_samples = (rows.group > 0) & (rows.group <= len(DOMAINS))
    half = _threshold(answer, wrong, near, from_samples, settings)
    u = np.logaddexp(
        confidence.sharpness * (confidence.distance(rows.poses) - confidence.edge), settings.steepness * (answer - half)
    )
    m = len(network.biases[-2])  # activations of the last hidden layer
    hidden = np.column_stack([np.ones(len(x)), _ending_in(network, np.eye(m), np.zeros(m)).value(x)])
    outside = growth_outside(np.maximum(u + SURE, 0.0))
    heads, growth = np.zeros((len(tolerances), 1 + m)), np.zeros(len(tolerances))
    for k, tolerance in enumerate(tolerances):
        used, errors, usual = (u < 0.0) & rows.carried[:, k], rows.errors[:, k], _usual(rows, k, tolerance)
        heads[k, 0], enough = np.log(usual), used.sum() >= 3 * (1 + m)  # else as wrong as the load is large
        if enough:
            heads[k] = _quantile_regression(hidden[used], np.log(errors[used] + 1e-3 * tolerance), settings.coverage)
        bound, far = np.exp(hidden @ heads[k]), rows.carried[:, k] & (outside > 1e-3)
        grown = np.quantile((errors - bound)[far] / outside[far], settings.coverage) if far.sum() >= 40 else usual
        growth[k] = max(10.0 * tolerance, float(grown))
        if enough:
            ratios = np.maximum(errors - growth[k] * outside, 0.0)[used] / bound[used]
            heads[k, 0] += np.log(_widening(ratios, rows.group[used], settings))
    scale = float(np.ravel(network.output_scale)[0]) * settings.steepness
    last = np.vstack([scale * network.weights[-1], heads[:, 1:]])
    bias = np.r_[scale * network.biases[-1][0] - settings.steepness * half, heads[:, 0]]
    return replace(confidence, network=_ending_in(network, last, bias), growth=growth)


def _classifier(x: Array, target: Array, settings: CalibrationSettings) -> Network:
    """Network of one output that is fitted to the target; a tenth of the rows stop the fit."""
    wrong = target > 0.0
    share = np.clip(wrong.mean(), 0.5 / len(wrong), 1.0 - 0.5 / len(wrong))
    weights = np.sqrt(0.5 / np.where(wrong, share, 1.0 - share))
    regression = Regression("classifier", x, target, weights, np.arange(len(x)) % 10 == 9, tolerance=0.0)
    effort = TrainingSettings(sizes=(settings.hidden,), max_iterations=settings.iterations, restarts=0)
    return fit(regression, effort).network


def _threshold(
    answer: Array, wrong: np.ndarray, near: np.ndarray, from_samples: np.ndarray, settings: CalibrationSettings
) -> float:
    """The classifier's answer at which validity is a half: the largest at which at most `wrong_share` of the nearby
    poses with a lower answer are wrong, and not more than `kept` of the accurate samples need (but half of the way from
    accurate to the limit)."""
    accurate = from_samples & ~wrong
    order = np.flatnonzero(near)[np.argsort(answer[near])]
    shares = np.cumsum(wrong[order]) / np.arange(1, len(order) + 1)
    # Of the first hundred no share is known so finely.
    allowed = np.flatnonzero((shares <= settings.wrong_share) & (np.arange(len(order)) >= min(100, len(order) // 10)))
    if not (len(allowed) and accurate.any()):
        return float(answer.min()) - 1.0
    kept = max(float(np.quantile(answer[accurate], settings.kept)) + SURE / settings.steepness, -0.5)
    return kept if allowed[-1] == len(order) - 1 else min(kept, float(answer[order][allowed[-1]]))


def _ending_in(network: Network, weights: Array, biases: Array) -> Network:
    """The network with another last layer, in units of its own."""
    all_weights, all_biases = (*network.weights[:-1], weights), (*network.biases[:-1], biases)
    return replace(network, weights=all_weights, biases=all_biases, output_scale=1.0)


def _widening(ratios: Array, group: np.ndarray, settings: CalibrationSettings) -> float:
    """What bounds are multiplied by, from errors over them (n,): of all unseen ratios a share of `coverage` lies below
    it, and of each group of a hundred rows or more `group_coverage`. Of fewer no share is known so finely: their two
    or three largest errors would widen all bounds."""
    groups = [ratios[group == g] for g in np.unique(group)]
    shares = [_unseen_quantile(each, settings.group_coverage) for each in groups if len(each) >= 100]
    return max(_unseen_quantile(ratios, settings.coverage), *shares, 1e-6)


def _quantile_regression(h: Array, target: Array, share: float) -> Array:
    """Coefficients β with a share of the targets (n,) below h·β: least Σ w·r² with r = target - h·β and
    w = |share - [r < 0]|/|r| (Koenker and Bassett 1978), by iteratively reweighted least squares, with a small ridge on
    all but the first."""
    ridge = 1e-3 * len(h) * np.diag(np.r_[0.0, np.ones(h.shape[1] - 1)])
    beta: Array = np.zeros(h.shape[1])
    weights = np.ones(len(h))
    for _ in range(60):
        weighted = h * weights[:, None]
        beta = np.asarray(np.linalg.solve(h.T @ weighted + ridge, weighted.T @ target))
        residual = target - h @ beta
        weights = np.where(residual < 0.0, 1.0 - share, share) / np.maximum(np.abs(residual), 1e-2)
    return np.asarray(beta)


def _usual(rows: _Rows, k: int, tolerance: float) -> float:
    """Error of load k that is expected where nothing is known [N, N·mm]: the largest finite one, or more."""
    finite = rows.errors[np.isfinite(rows.errors[:, k]), k]
    return float(max(10.0 * tolerance, np.quantile(finite, 0.99) if len(finite) else 0.0))


def _unseen_quantile(ratios: Array, share: float) -> float:
    """What a share of further ratios of the same kind lies below: of n ratios the one at share·(n + 1)/n (conformal
    prediction, Vovk et al. 2005)."""
    return float(np.quantile(ratios, min(1.0, share * (len(ratios) + 1) / len(ratios))))


def _model_errors(model: ContactModel) -> dict[str, Any]:
    """Errors of a foundation that were found when it was chosen: no error on samples includes them."""
    measured = getattr(model, "record", {})
    if "rms" not in measured or "against" not in measured:
        return {}
    return dict(zip(_OF_THE_MODEL, (dict(measured["rms"]), str(measured["against"])), strict=True))


def coverage_by_group(
    surrogate: Surrogate, samples: Samples, others: dict[str, Samples] | None = None
) -> dict[str, dict[str, float]]:
    """By domain of the samples: share of poses with validity above 0.9 ("valid") and, by load, share of errors below
    the expected ones, over the poses that carry the load, where there are ten or more. By name of the others: the same
    of those with validity above 0.5."""
    groups = {domain: samples.select(domain) for domain in DOMAINS}
    for name, part in (others or {}).items():
        groups[name] = part.rows(surrogate.validity(part.poses) > VALID) if len(part) else part
    return {name: dict(_coverage(surrogate, part)) for name, part in groups.items() if len(part)}


def _coverage(surrogate: Surrogate, part: Samples) -> Iterator[tuple[str, float]]:
    target = part.loads(surrogate.load_names)
    below = np.abs(surrogate(part.poses) - target) <= surrogate.expected_error(part.poses)
    yield "valid", float(np.mean(surrogate.validity(part.poses) > SURELY_VALID))
    for load, column, carried in zip(surrogate.load_names, below.T, _carried(target).T, strict=True):
        if carried.sum() >= 10:
            yield load, float(np.mean(column[carried]))
