"""Learn at which poses a surrogate is wrong: an `ErrorClassifier` fitted to poses with the contact model's loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from casadi_contact.core.conventions import Array, Progress
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.samples.samples import VALIDATION, Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.error_classifier import STEEPNESS, ErrorClassifier
from casadi_contact.surrogate.states import state_columns
from casadi_contact.surrogate.trust import KEPT, SURE, Trust

WRONG = 10.0  # times the scene's tolerance, or the RMS error on validation rows where that is more
LEAST_SHARE, LEAST_WRONG = 0.05, 20  # of other valid poses, wrong: for fewer a classifier costs more right poses
_USUAL = 0.95  # share of the validation rows, those of least error: a single gross one may outweigh all others
_SAMPLES = 20_000  # at most, that are shown as right
_ITERATIONS = 150
_SETTINGS = TrainingSettings(sizes=((24, 24),), max_iterations=_ITERATIONS, restarts=0)


def with_error_classifier(
    trust: Trust,
    surrogate: Surrogate,
    samples: Samples,
    others: Sequence[Samples],
    progress: Progress | None = None,
) -> Trust:
    """The trust with an `ErrorClassifier`, where poses that it calls valid are wrong often enough.

    samples: those that the surrogate was trained on, validation rows among them, which stay valid where it is right;
    others: further poses with the contact model's loads, over the rim of the fixed body too. Wrong is an error of any
    load beyond `WRONG` times its tolerance, or its RMS error on the 95 % of validation rows that are least off where
    that is more. progress: called as (iterations done, all) where a classifier is learned.
    """
    shown = samples.rows(np.sort(np.random.default_rng(0).permutation(len(samples))[:_SAMPLES]))
    parts = [shown, *others]
    poses = np.concatenate([part.poses for part in parts])
    limits = _limits(surrogate, samples)
    wrong = np.concatenate([_beyond(surrogate, part, limits) for part in parts])
    roots = surrogate.trust_roots(poses)
    valid = trust.excess(poses, roots, surrogate.trust_claims(poses)) < 0.0
    valid[: len(shown)] = False  # of the others alone
    if (valid & wrong).sum() < max(LEAST_WRONG, LEAST_SHARE * valid.sum()):
        return trust
    columns = np.array(state_columns(surrogate.scene), dtype=float)
    x = np.hstack([poses[:, columns.astype(int)], roots])
    # Both kinds count alike; a tenth of the rows, evenly, tells when to stop.
    weights = np.sqrt(0.5 / np.where(wrong, wrong.mean(), 1.0 - wrong.mean()))
    stopping = np.arange(len(x)) % 10 == 9
    network = _learned(Regression("classifier", x, np.where(wrong, 1.0, -1.0), weights, stopping, 0.0), progress)
    known = ~wrong[: len(shown)]
    sure = float(np.quantile(network.value(x[: len(shown)][known]), KEPT))
    return replace(trust, classifier=ErrorClassifier.of(columns, network, sure + SURE / STEEPNESS))


def _learned(regression: Regression, progress: Progress | None) -> Network:
    """The regression's network, its bar full where it stops before its last iteration."""
    if progress is None:
        return fit(regression, _SETTINGS).network
    done = count(1)
    network = fit(regression, _SETTINGS, progress=lambda *_: progress(next(done), _ITERATIONS)).network
    progress(_ITERATIONS, _ITERATIONS)
    return network


def right_ones(surrogate: Surrogate, samples: Samples, others: Samples) -> Samples:
    """The rows of others that are not wrong, as `with_error_classifier` counts them."""
    return others.rows(~_beyond(surrogate, others, _limits(surrogate, samples)))


def _limits(surrogate: Surrogate, samples: Samples) -> Array:
    """Errors (L,) of the loads beyond which a pose counts as wrong [N, N·mm]."""
    validation, names = samples.select(role=VALIDATION), surrogate.load_names
    squares = np.sort((surrogate(validation.poses) - validation.loads(names)) ** 2, axis=0)
    rms = np.sqrt(np.mean(squares[: max(1, int(_USUAL * len(squares)))], axis=0))
    return WRONG * np.maximum([surrogate.scene.tolerances[name] for name in names], rms)


def _beyond(surrogate: Surrogate, part: Samples, limits: Array) -> np.ndarray:
    """Whether any load of each sample (m,) is off by more than its limit."""
    return np.asarray((np.abs(surrogate(part.poses) - part.loads(surrogate.load_names)) > limits).any(axis=1))
