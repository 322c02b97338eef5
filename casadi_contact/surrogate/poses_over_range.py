"""Poses over the sampled range, and the border of validity that they move, until they have been drawn all over it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from casadi_contact.core.conventions import Array, Progress
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.perturbed import LEAST_VALIDITY, uniform_count, uniform_poses, uniform_samples
from casadi_contact.samples.samples import Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.trust import Trust

_SEED, _EVENLY = 13, 20_000  # of poses that tell how much of the region is new
_NEW_SHARE, _MOST_ROUNDS = 0.01, 4


def poses_over_range(
    surrogate: Surrogate,
    samples: Samples,
    model: WrenchModel,
    refitted: Callable[[Samples], Trust],
    progress: Progress | None = None,
) -> tuple[Samples, Trust]:
    """Poses drawn evenly where validity is above 0.1 (`uniform_samples`), and the trust that is fitted to them.

    Where the moved border lies farther out than the one before, nothing was asked. There poses are drawn too, as
    densely where chance finds so many, if not more than at first, until less than a hundredth of the region is new, or
    four times in all.
    """
    found = uniform_samples(samples, model, surrogate.validity, surrogate.trust_roots, seed=_SEED, progress=progress)
    trust, before = refitted(found), [surrogate]
    evenly = uniform_poses(samples, _EVENLY, np.random.default_rng(_SEED))
    while len(before) < _MOST_ROUNDS:
        current = type(surrogate)(surrogate.scene, surrogate.networks, surrogate.record, trust)
        new = _validity_where_new(current, before)
        asked, valid = (int(np.sum(of(evenly) > LEAST_VALIDITY)) for of in (new, current.validity))
        if asked <= _NEW_SHARE * valid:
            break
        drawn, seed = len(found) + len(found.dropped.poses), _SEED + len(before)
        most = uniform_count(samples)
        count = min(round(drawn * asked / (valid - asked)) + 1, most) if drawn and valid > asked else most
        more = uniform_samples(samples, model, new, current.trust_roots, count=count, seed=seed, progress=progress)
        found = found.join_samples(more)
        trust = refitted(found)
        before.append(current)
    return found, trust


def _validity_where_new(current: Surrogate, before: Sequence[Surrogate]) -> Callable[[Array], Array]:
    """Validity (n,) of poses (n, 6), 0 where one of the surrogates before had more than 0.1."""
    earlier = list(before)

    def validity(poses: Array) -> Array:
        found = current.validity(poses)
        for surrogate in earlier:
            found = np.where(surrogate.validity(poses) > LEAST_VALIDITY, 0.0, found)
        return found

    return validity
