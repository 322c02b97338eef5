"""How often the errors of a surrogate lie below those it expects, by domain and load."""

from __future__ import annotations

import numpy as np

from casadi_contact.samples.samples import DOMAINS, Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.trust import SURELY_INVALID, SURELY_VALID, VALID

_LEAST = 10  # poses that tell a share: of a single one it is 0 or 100 %


def trust_coverage(
    surrogate: Surrogate,
    samples: Samples,
    around: Samples | None = None,
    in_range: Samples | None = None,
    led: Samples | None = None,
) -> dict[str, dict[str, float]]:
    """By domain: share of poses with validity above 0.9 ("valid") and, by load, share of errors below those
    expected, over the poses that carry the load, where there are ten or more. Of the poses around: "around" those with
    validity above 0.5, "edge" those of all with validity between 0.1 and 0.9, "outside" those below 0.1. Of the poses
    in range "range", of those to which the surrogate leads "led": those with validity above 0.5."""
    groups = {domain: samples.select(domain) for domain in DOMAINS}
    for name, part in (("range", in_range), ("led", led)):
        if part is not None:
            groups[name] = part.rows(surrogate.validity(part.poses) > VALID)
    result = {domain: _coverage(surrogate, part) for domain, part in groups.items() if len(part)}
    if around is None or not len(around):
        return result
    everything = samples.join_samples(around)
    validity = [surrogate.validity(part.poses) for part in (around, everything)]
    parts = {
        "around": around.rows(validity[0] > VALID),
        "edge": everything.rows((validity[1] > SURELY_INVALID) & (validity[1] <= SURELY_VALID)),
        "outside": around.rows(validity[0] <= SURELY_INVALID),
    }
    return result | {name: _coverage(surrogate, part) for name, part in parts.items() if len(part)}


def _coverage(surrogate: Surrogate, part: Samples) -> dict[str, float]:
    wanted = part.loads(surrogate.load_names)
    below = np.abs(surrogate(part.poses) - wanted) <= surrogate.expected_error(part.poses)
    row = {"valid": float(np.mean(surrogate.validity(part.poses) > SURELY_VALID))}
    for load, column, loaded in zip(surrogate.load_names, below.T, (wanted != 0.0).T, strict=True):
        if loaded.sum() >= _LEAST:
            row[load] = float(np.mean(column[loaded]))
    return row
