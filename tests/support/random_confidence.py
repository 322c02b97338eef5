"""A confidence of random numbers: enough to compare its evaluations in NumPy, CasADi and C."""

from __future__ import annotations

import itertools

import numpy as np

from casadi_contact.networks.network import Network
from casadi_contact.surrogate.confidence import Confidence
from tests.support.random_surrogates import POSE_CENTRE, POSE_SPREAD


def random_confidence(patches: int, loads: int, *, root_size: float = 1.0) -> Confidence:
    """root_size: of usual root loads. Validity varies over random poses."""
    rng = np.random.default_rng(0)
    columns = np.array([0.0, 2.0, 4.0])
    sizes = (3 + patches, 7, 5, 1 + loads)
    whitening = np.sqrt(3.0) * np.diag(1.0 / POSE_SPREAD)
    whitening[1, 0] = 0.1  # as of a parameter that is tied to another
    layers = [(0.5 * rng.normal(size=(m, n)), 0.1 * rng.normal(size=m)) for n, m in itertools.pairwise(sizes)]
    layers[-1][1][0] -= 1.0  # some poses are valid
    network = Network(
        np.r_[POSE_CENTRE[[0, 2, 4]], np.zeros(patches)],
        np.r_[POSE_SPREAD[[0, 2, 4]], np.full(patches, root_size)],
        tuple(weights for weights, _ in layers),
        tuple(bias for _, bias in layers),
    )
    return Confidence(
        whitening=whitening,
        centres=POSE_CENTRE @ whitening.T + 1.7 * rng.uniform(-1.0, 1.0, (37, 6)),
        bandwidth=0.9,
        sharpness=0.6,
        edge=1.0,
        columns=columns,
        network=network,
        growth=rng.uniform(0.2, 1.0, loads),
    )
