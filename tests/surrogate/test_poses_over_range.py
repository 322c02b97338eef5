"""Where a border of validity moves outwards, poses are drawn there too."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.samples.samples import TRAIN, Samples
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.poses_over_range import poses_over_range

SCENE = load_scene("sphere_on_plane")
LOW, HIGH = np.array([-3.0, 29.0, -2.0, -0.1, -0.2, -0.3]), np.array([3.0, 30.5, 1.0, 0.1, 0.1, 0.2])
ROWS = 3600  # a third of which are drawn


@dataclass
class Reaching:
    """Valid where tx is below its trust, which is a number."""

    scene: Any
    networks: Any
    record: Any
    trust: float

    def validity(self, poses):
        return np.where(poses[:, 0] < self.trust, 1.0, 0.0)

    def trust_roots(self, poses):
        return 30.0 - poses[:, 1:2]


def drawn(borders):
    """The poses and the last border, where those drawn move the border from the first to the next in turn."""
    poses, role = np.tile([LOW, HIGH], (ROWS // 2, 1)), np.full(ROWS, TRAIN, dtype=np.uint8)
    samples = Samples(SCENE, poses, np.zeros((ROWS, 1, 6)), np.ones((ROWS, 1)), np.ones(ROWS, dtype=np.uint8), role)
    places, later = [], iter(borders[1:])

    def refitted(found):
        places.append(np.concatenate([found.poses, found.dropped.poses])[:, 0])
        return next(later)

    first = Reaching(SCENE, {}, {}, borders[0])
    _, trust = poses_over_range(first, samples, ElasticFoundation(SCENE, (8, 8)), refitted)
    return places, trust


def test_a_border_that_moves_outwards_is_asked_beyond_the_one_before_as_densely():
    (first, second), trust = drawn([0.0, 1.5, 1.5])
    assert trust == 1.5
    assert first.max() < 0.0
    assert len(first) == ROWS // 3
    new = np.setdiff1d(second, first)
    assert len(second) - len(new) == len(first)
    assert new.min() >= 0.0
    assert new.max() > 1.4
    assert len(new) / 1.5 == pytest.approx(len(first) / 3.0, rel=0.05), "poses per mm"


def test_a_border_that_moves_inwards_or_hardly_is_asked_once():
    for borders in ([1.0, 0.5], [1.0, 1.02]):
        places, trust = drawn(borders)
        assert len(places) == 1
        assert trust == borders[1]


def test_a_border_that_never_rests_is_asked_four_times():
    places, trust = drawn([-2.0, -1.0, 0.0, 1.0, 2.0])
    assert [len(each) for each in places] == sorted(len(each) for each in places)
    assert len(places) == 4
    assert trust == 2.0
