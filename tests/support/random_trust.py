"""A trust of random numbers that holds every cause of distrust: enough to compare evaluations."""

from __future__ import annotations

import numpy as np

from casadi_contact.surrogate.cubic_logistic import cubic_terms
from casadi_contact.surrogate.distrust import Border, Box, Confirmation
from casadi_contact.surrogate.error_classifier import ErrorClassifier
from casadi_contact.surrogate.states import States
from casadi_contact.surrogate.trust import Trust
from tests.support.random_surrogates import POSE_CENTRE, POSE_SPREAD


def random_trust(
    patches: int,
    loads: int,
    *,
    confirmation: bool = False,
    older: bool = False,
    root_size: float = 1.0,
) -> Trust:
    """older: as in files without states and classifier; root_size: of usual root loads."""
    rng = np.random.default_rng(0)

    def positive(*shape: int) -> np.ndarray:
        return rng.uniform(0.2, 1.0, shape)

    columns, count = np.array([0.0, 2.0, 4.0]), 3 + patches
    sizes = np.r_[np.ones(3), np.full(patches, root_size)]
    confirming = root_size * positive(2, patches)
    terms = cubic_terms(np.zeros((1, count))).shape[1]
    others = np.random.default_rng([0, 1])
    near = POSE_CENTRE[[0, 2, 4]] / POSE_SPREAD[[0, 2, 4]]
    states = States(
        columns,
        POSE_SPREAD[[0, 2, 4]],
        root_size * others.uniform(0.2, 1.0, patches),
        np.r_[near, np.full(patches, 2.0)] + others.uniform(-1.0, 1.0, (37, count)),
        0.4,
    )
    classifier = ErrorClassifier(
        columns,
        np.r_[POSE_CENTRE[[0, 2, 4]], np.zeros(patches)],
        np.r_[POSE_SPREAD[[0, 2, 4]], np.full(patches, root_size)],
        *(
            array
            for size in ((7, count), (5, 7), (1, 5))
            for array in (0.3 * others.normal(size=size), np.zeros(size[0]))
        ),
        0.3,
    )
    return Trust(
        scales=POSE_SPREAD / np.sqrt(3.0),
        centres=POSE_CENTRE * np.sqrt(3.0) / POSE_SPREAD + 1.7 * rng.uniform(-1.0, 1.0, (37, 6)),
        bandwidth=0.9,
        sharpness=0.6,
        edge=1.0,
        root_low=-root_size * positive(patches),
        root_high=root_size * positive(patches),
        margin_low=root_size * positive(patches),
        margin_high=root_size * positive(patches),
        levels=positive(37, loads),
        dense_centres=POSE_CENTRE * np.sqrt(3.0) / POSE_SPREAD + 1.7 * rng.uniform(-1.0, 1.0, (11, 6)),
        dense_bandwidth=0.7,
        dense_start=0.5,
        boundary_root=0.1,
        shares=positive(loads, 3 + patches),
        usual_loads=positive(loads),
        box=Box(
            columns,
            (POSE_CENTRE - 0.6 * POSE_SPREAD)[[0, 2, 4]],
            (POSE_CENTRE + 0.6 * POSE_SPREAD)[[0, 2, 4]],
            0.2 * POSE_SPREAD[[0, 2, 4]],
        ),
        border=Border(columns, np.zeros(count), 3.0 * sizes, rng.normal(size=terms)),
        confirmation=Confirmation(20.0 * positive(patches), *confirming) if confirmation else None,
        growth=positive(loads),
        growth_start=-1.3,
        light_shares=None if older else positive(loads),
        states=None if older else states,
        classifier=None if older else classifier,
    )
