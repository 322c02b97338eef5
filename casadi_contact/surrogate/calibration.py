"""Fit a surrogate's `Trust` to samples: centres and ranges on the training rows, limits on the validation rows.

Poses around and between the samples take part where a contact model tells their loads. Test rows take none: the
coverage reported on them, and on an unseen walking sequence, is what a user may expect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array, Update, in_stage
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.led_to import samples_led_to
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.coverage import trust_coverage
from casadi_contact.surrogate.cubic_logistic import cubic_terms, logistic_coefficients
from casadi_contact.surrogate.distrust import Border, Box, Confirmation, OffSpace
from casadi_contact.surrogate.error_bounds import BANDWIDTH, CENTRES, LEAST_LEVEL, LEAST_ROWS, with_error_bounds
from casadi_contact.surrogate.gaussian_kernels import soft_distance, spread_centres, thinned
from casadi_contact.surrogate.poses_over_range import poses_over_range
from casadi_contact.surrogate.states import state_columns
from casadi_contact.surrogate.trust import KEPT, LIGHT_LOADS, SURE, SURELY_VALID, Trust
from casadi_contact.surrogate.wrong_poses import right_ones, with_error_classifier

INSIDE = 0.995  # share of held-back poses near enough to the samples for a validity above 0.9
DENSE_CENTRES = 64
DENSE_BANDWIDTH = 0.4  # of the scales, the deviation of an even spread over the sampled range
SHARPNESS = 1.8
MARGIN = 0.2  # of the sampled root loads: so far outside their range validity is below 0.06, half as far 0.5
_LEAST_RANGE = 1e-3  # [mm, rad] of a pose parameter that the samples never vary
BOX_MARGIN = 0.015  # of the sampled range of an insensitive pose parameter: twice so far beyond it validity is 0.5
CLAIM_SHARE = 0.1  # of the boundary load: contact of less than this needs no confirmation
LEAST_LIGHT_LOADS = 0.2  # boundary loads: of less on the patch that is pressed most all errors are small
_LEAST_DROPPED = 20  # of fewer no border can be learned
_OF_THE_MODEL = ("model_errors", "model_errors_against")  # keys of the record
_LEAST_ROOT = 0.005  # a root load is not known better than this out of contact


def with_trust(
    surrogate: Surrogate,
    samples: Samples,
    around: Samples | None = None,
    model: WrenchModel | None = None,
    update: Update | None = None,
) -> Surrogate:
    """The surrogate with validity and expected error, and their coverage on test rows in its record.

    around: poses between and beside the sampled ones with the contact model's loads (`sampling.perturbed_samples`), so
    that the expected error holds off equilibrium too. model: that contact model; it is asked at poses over the whole
    sampled range (`sampling.perturbed`), so that the expected error holds wherever validity is high, and at those to
    which the surrogate itself leads (`sampling.led_to`), so that validity is low where it is wrong. update: called
    as (what, done, all, remark) meanwhile.

    Raises ValueError for samples of another scene or without training or validation rows, and for a surrogate
    without root loads.
    """
    moved = [] if around is None else [around]
    if {part.scene.digest for part in (samples, *moved)} != {surrogate.scene.digest}:
        raise ValueError("the samples belong to another scene than the surrogate (digests differ): draw them anew")
    kind = type(surrogate)
    surrogate = kind(surrogate.scene, surrogate.networks, surrogate.record)  # NumPy: the same file by any compiler
    training, validation = samples.select(role=TRAIN), samples.select(role=VALIDATION)
    for what, part in (("training", training), ("validation", validation)):
        if not len(part):
            raise ValueError(f"samples hold no {what} rows, expected some: draw samples with a validation share")
    known = samples.select(role=(TRAIN, VALIDATION))
    tube = _tube(surrogate, training, validation)
    trust = _distrusting(tube, surrogate, known, moved)
    in_range = led = None
    over_range, leading, classifying, expecting = (
        in_stage(update, f"{surrogate.structure}: {what}")
        for what in ("poses over the range", "poses it leads to", "where it is wrong", "expected errors")
    )
    if model is not None:
        around_and = list(moved)
        in_range, trust = poses_over_range(
            kind(surrogate.scene, surrogate.networks, surrogate.record, trust),
            samples,
            model,
            lambda found: _distrusting(tube, surrogate, known, [*around_and, found]),
            over_range,
        )
        moved.append(in_range)
        first = kind(surrogate.scene, surrogate.networks, surrogate.record, trust)
        led = samples_led_to(surrogate, samples, model, first.validity, progress=leading)
        others = [part.select(role=VALIDATION) for part in (*moved, led)]
        trust = with_error_classifier(trust, surrogate, known, others, classifying)
        # Without a classifier, few gross errors at rims would raise what is expected everywhere.
        moved.append(led if trust.classifier is not None else right_ones(surrogate, known, led))
    unknown = [validation, *_by_size(surrogate, [part.select(role=VALIDATION) for part in moved])]
    trust = with_error_bounds(trust, surrogate, training, unknown, expecting)
    trusted = kind(surrogate.scene, surrogate.networks, surrogate.record, trust)
    record = {**surrogate.record, **_on_test_rows(trusted, samples, (around, in_range, led))}
    if model is not None:  # what was known of another model is not known of this one
        record = {key: value for key, value in record.items() if key not in _OF_THE_MODEL} | _model_errors(model)
    return kind(surrogate.scene, surrogate.networks, record, trust)


def _by_size(surrogate: Surrogate, others: Sequence[Samples]) -> list[Samples]:
    """The poses of each kind, and as a kind of its own those of all in light contact: the rest are many more, and tell
    little of errors there. Few in light contact stay with their kinds, since a kind's errors count however few."""
    if not others:
        return []
    scene = surrogate.scene
    least, most = np.sqrt(np.array([LEAST_LIGHT_LOADS, LIGHT_LOADS]) * scene.boundary_load / scene.reference_load)
    largest = [surrogate.trust_roots(part.poses).max(axis=1) for part in others]
    light = [(least < roots) & (roots <= most) for roots in largest]
    if sum(rows.sum() for rows in light) < LEAST_ROWS:
        return list(others)
    rest = [part.rows(~rows) for part, rows in zip(others, light, strict=True)]
    return [*rest, reduce(Samples.join_samples, [part.rows(rows) for part, rows in zip(others, light, strict=True)])]


def _model_errors(model: WrenchModel) -> dict[str, Any]:
    """What a foundation was found to be off by when it was chosen: no error on samples includes it."""
    measured = getattr(model, "record", {})
    if "rms" not in measured or "against" not in measured:
        return {}
    return dict(zip(_OF_THE_MODEL, (dict(measured["rms"]), str(measured["against"])), strict=True))


def _on_test_rows(trusted: Surrogate, samples: Samples, others: Sequence[Samples | None]) -> dict[str, Any]:
    """Coverage on test rows of samples and of other poses, and the share of valid ones among the samples'."""
    test = samples.select(role=TEST)
    unseen = (None if part is None else part.select(role=TEST) for part in others)
    record: dict[str, Any] = {"coverage": trust_coverage(trusted, test, *unseen)}
    if len(test):
        record["valid_share"] = float(np.mean(trusted.validity(test.poses) > SURELY_VALID))
    return record


def _tube(surrogate: Surrogate, training: Samples, validation: Samples) -> Trust:
    """What validity needs of the samples themselves; error levels and shares are still zero."""
    scene, loads = surrogate.scene, training.loads(surrogate.load_names)
    scales = np.maximum(np.ptp(training.poses, axis=0), _LEAST_RANGE) / np.sqrt(12.0)
    points = training.poses / scales
    roots = surrogate.trust_roots(training.poses)
    # Of the contact model, since a root load that a network gets wrong would let others like it pass; below zero, where
    # patches are lifted off, there is none.
    low, high = roots.min(axis=0), np.sqrt(_patch_normals(training).max(axis=0) / scene.reference_load)
    boundary_root = float(np.sqrt(scene.boundary_load / scene.reference_load))
    centres, dense = spread_centres(thinned(points, 0.5 * BANDWIDTH), CENTRES), spread_centres(points, DENSE_CENTRES)
    distance = soft_distance(validation.poses / scales, centres, BANDWIDTH)
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
        edge=float(np.quantile(distance, INSIDE)) + SURE / SHARPNESS,
        root_low=low,
        root_high=high,
        margin_low=np.maximum(MARGIN * np.abs(low), boundary_root) / 4.0,
        margin_high=np.maximum(MARGIN * np.abs(high), boundary_root) / 4.0,
        levels=np.zeros((0, count)),
        dense_centres=dense,
        dense_bandwidth=DENSE_BANDWIDTH,
        dense_start=float(np.quantile(soft_distance(validation.poses / scales, dense, DENSE_BANDWIDTH), 0.01)),
        boundary_root=boundary_root,
        shares=np.zeros((count, 3 + patches)),
        usual_loads=np.maximum(np.sqrt(np.mean(loads**2, axis=0)), LEAST_LEVEL * scene.boundary_load),
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
        growth_start=-SURE,
    )


def _distrusting(trust: Trust, surrogate: Surrogate, known: Samples, moved: Sequence[Samples]) -> Trust:
    """With the border to poses that no sample stands for, and what confirms contact.

    Lost are dropped poses, and those where a patch that is pressed in no single direction has a force beyond the
    sampled ones: its root load tells the size of that force alone.
    """
    sampled = _undirected_forces(known)
    margin = 0.5 * MARGIN * np.ptp(sampled, axis=0)
    low, high = sampled.min(axis=0) - margin, sampled.max(axis=0) + margin
    kept, lost = [known.poses], [known.dropped.poses]
    moved = [part.select(role=VALIDATION) for part in moved]
    for part in moved:
        forces = _undirected_forces(part)
        beyond = ((forces < low) | (forces > high)).any(axis=1)
        kept.append(part.poses[~beyond])
        lost += [part.poses[beyond], part.dropped.poses]
    trust = _with_border(trust, surrogate, np.concatenate(kept), np.concatenate(lost))
    return _confirmed(trust, surrogate, reduce(Samples.join_samples, moved, known))


def _undirected_forces(samples: Samples) -> Array:
    """Forces (n, 3·patches) [N] of the patches whose normal load has no single direction."""
    scene = samples.scene
    forces = np.add.reduceat(samples.wrenches[:, :, :3], scene.first_parts, axis=1)
    undirected = [normal.direction is None for normal in scene.normal_loads]
    return np.asarray(forces[:, undirected].reshape(len(samples), 3 * sum(undirected)))


def _with_border(trust: Trust, surrogate: Surrogate, kept_poses: Array, lost_poses: Array) -> Trust:
    """The border between kept and lost poses, where enough were lost to tell."""
    if len(lost_poses) < _LEAST_DROPPED:
        return trust
    count, everything = len(kept_poses), np.concatenate([kept_poses, lost_poses])
    columns = state_columns(surrogate.scene)
    x = np.column_stack([everything[:, columns], surrogate.trust_roots(everything)])
    centre, scale = x[:count].mean(axis=0), np.maximum(x[:count].std(axis=0), _LEAST_RANGE)
    # A pose far off says nothing of the border, and its cube would outweigh all others.
    near = (np.abs((x - centre) / scale) < 6.0).all(axis=1)
    terms, kept = cubic_terms((x - centre) / scale)[near], (np.arange(len(x)) < count)[near]
    if (~kept).sum() < _LEAST_DROPPED:
        return trust
    coefficients = logistic_coefficients(terms, kept)
    coefficients[0] += SURE - float(np.quantile(terms[kept] @ coefficients, 1.0 - KEPT))
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
    near = trust.excess(known.poses, surrogate.trust_roots(known.poses)) < SURE
    known, claims = known.rows(near), claims[near]
    roots = surrogate.trust_roots(known.poses)
    parts = normal_forces([part.normal for part in scene.parts], known.wrenches)
    false = (claims > tolerance) & ~np.logical_or.reduceat(parts > 0.0, scene.first_parts, axis=1)
    largest = np.array([max(s[rows].max(initial=0.0), 0.0) for s, rows in zip(roots.T, false.T, strict=True)])
    width = np.maximum(largest, _LEAST_ROOT)
    return replace(trust, confirmation=Confirmation(tolerance, largest + 2.5 * width, width))


def _patch_normals(samples: Samples) -> Array:
    """Sum (n, P) [N] of the normal loads that press of each patch's parts."""
    parts = normal_forces([part.normal for part in samples.scene.parts], samples.wrenches)
    return np.asarray(np.add.reduceat(np.maximum(parts, 0.0), samples.scene.first_parts, axis=1))
