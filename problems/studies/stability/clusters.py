"""Row 5: Kriging with dense clusters of samples, with and without a nugget on the kernel matrix's diagonal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from problems.studies.stability.methods import EF_ANALYTIC, METHODS, Bench
from problems.studies.stability.peers import KRIGING
from problems.studies.stability.table import Line
from problems.studies.stability.walking_samples import walking_samples

POINTS, CLUSTERS, PER_CLUSTER = 1000, 5, 20
SPACINGS = (1e-1, 1e-3, 1e-5, 0.0)  # of a cluster's points, in standard deviations of the poses
NUGGETS = (0.0, 1e-10, 1e-6, 1e-2)  # variances of the loads


def clustered(model: Any, data: TrainingSet, count: int, spacing: float) -> TrainingSet:
    """The first points of data, and about five of them 20 more points each, a normal distance of `spacing` away."""
    rng = np.random.default_rng(0)
    near = np.repeat(data.poses[:CLUSTERS], PER_CLUSTER, axis=0)
    near = near + spacing * data.spread * rng.standard_normal(near.shape)
    poses = np.vstack([data.poses[:count], near])
    return replace(data, poses=poses, loads=model(poses))


def fitted(data: TrainingSet, held_out: tuple[Array, Array], kernel: Any, nugget: float) -> tuple[float, float]:
    """2-norm condition number of the kernel matrix and the RMS error on held-back points in deviations of the loads,
    for a kernel as it is; infinity and NaN where the matrix cannot be factorised."""
    from sklearn.gaussian_process import GaussianProcessRegressor

    mean, deviation = data.load_scale
    process = GaussianProcessRegressor(kernel, optimizer=None, alpha=nugget)
    try:
        process.fit((data.poses - data.centre) / data.spread, (data.loads - mean) / deviation)
    except np.linalg.LinAlgError:
        return np.inf, np.nan
    poses, loads = held_out
    off = process.predict((poses - data.centre) / data.spread) - (loads - mean) / deviation
    return float(np.linalg.cond(process.L_) ** 2), float(np.sqrt(np.mean(off**2)))


def measure(
    bench: Bench, spacings: Sequence[float] = SPACINGS, nuggets: Sequence[float] = NUGGETS, points: int = POINTS
) -> tuple[list[Line], None]:
    """Lines of row 5: for each spacing and nugget, condition number and held-back error of Kriging."""
    no_matrix = "no matrix of samples against samples: nothing to be ill-conditioned"
    why = {method: bench.missing.get(KRIGING, no_matrix) if method == KRIGING else no_matrix for method in METHODS}
    if KRIGING in bench.missing:
        return [Line(5, "clusters", "condition number / error", {}, why)], None
    del why[KRIGING]
    model = bench.models[EF_ANALYTIC]
    data = TrainingSet.of(walking_samples(model, bench.poses, 2 * points, seed=3))
    held_out = data.poses[points:], data.loads[points:]
    kernel = bench.models[KRIGING].remembered.k1  # c·Matérn without the nugget that was tuned with it
    cases = {"no clusters": replace(data, poses=data.poses[:points], loads=data.loads[:points])}
    for spacing in spacings:
        where = f"{spacing:g} deviations apart" if spacing else "repeated points"
        cases[f"{CLUSTERS} clusters of {PER_CLUSTER}, {where}"] = clustered(model, data, points, spacing)
    lines = []
    for case, samples in cases.items():
        for nugget in nuggets:
            condition, error = fitted(samples, held_out, kernel, nugget)
            cell = f"{condition:.0e} / {error:.2g}" if np.isfinite(condition) else "cannot be factorised"
            quantity = f"condition number / error [deviations], nugget {nugget:g}"
            lines.append(Line(5, case, quantity, {KRIGING: cell}, why))
    return lines, None
