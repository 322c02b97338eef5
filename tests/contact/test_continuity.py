"""Several poses that carry the same loads: those of neighbouring frames belong together (a ball over two dips)."""

import numpy as np
import pytest

from casadi_contact.contact.continuity import Motion, follow
from casadi_contact.contact.settle import settle
from tests.support.two_dips import DIP_MM, contact_model, height, slope

FREE = ("tx", "ty")


@pytest.fixture(scope="module")
def model():
    return contact_model()


@pytest.fixture(scope="module")
def wanted():
    """A shear to and fro under a steady load, over 41 frames."""
    return {"Fx": 4.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 41)), "Fy": np.full(41, -200.0)}


def settled(model, wanted, places):
    begin = np.zeros((len(places), 6))
    begin[:, 0], begin[:, 1] = places, height(places) - 0.3
    poses, report = settle(model, begin, FREE, wanted, tolerance=1e-6)
    assert report.converged.all()
    assert (np.abs(poses[:, 0] - places) < 2.0).all()
    return poses


def motion(model, wanted, free=FREE):
    return Motion(model, free, wanted, np.full(41, 1e-6), np.ones(41, dtype=bool))


def test_a_ridge_is_an_unstable_equilibrium_and_a_dip_is_none(model, wanted):
    for place, unstable in ((-DIP_MM, False), (0.0, True), (DIP_MM, False)):
        poses = settled(model, wanted, np.full(41, place))
        assert motion(model, wanted).unstable(poses).all() == unstable
    assert not motion(model, wanted, ("ty",)).unstable(poses).any(), "with tx held, nothing can slide"
    assert not motion(model, {"Tz": wanted["Fx"]}).unstable(poses).any()


def test_frames_strewn_over_all_places_come_together_in_one_dip(model, wanted):
    places = np.random.default_rng(3).choice([-DIP_MM, 0.0, DIP_MM], 41, p=[0.1, 0.1, 0.8])
    places[[0, -1]] = [-DIP_MM, 0.0]
    frames, poses = motion(model, wanted), settled(model, wanted, places)
    everywhere = np.ones(41, dtype=bool)
    assert frames.leaping(poses, everywhere).sum() > 5
    better = frames.without_leaps(poses, everywhere)
    assert not frames.leaping(better, everywhere).any()
    assert not frames.unstable(better).any()
    dip = np.sign(better[0, 0]) * DIP_MM
    np.testing.assert_allclose(better, settled(model, wanted, np.full(41, dip)), atol=1e-5)
    np.testing.assert_allclose(model(better)[:, 0], wanted["Fx"], atol=1e-5)


def test_an_unsolved_frame_beside_a_leap_is_found_from_its_neighbour(model, wanted):
    poses = settled(model, wanted, np.where(np.arange(41) < 5, DIP_MM, -DIP_MM))
    solved = np.arange(41) != 12
    poses[12] = 0.0
    better = motion(model, wanted).without_leaps(poses, solved)
    np.testing.assert_allclose(model(better)[:, :2], np.column_stack([wanted["Fx"], wanted["Fy"]]), atol=1e-4)


def test_following_ends_where_the_equilibrium_does(model):
    begin, end = ({"Fx": shear, "Fy": -200.0} for shear in (0.0, 60.0))
    pose = settled(model, {name: np.array([load]) for name, load in begin.items()}, np.array([-DIP_MM]))[0]
    found, share = follow(model, pose, pose, FREE, begin, {**begin, "Fx": 4.0}, 1e-6)
    assert share == 1.0
    np.testing.assert_allclose(model(found)[[0, 1]], [4.0, -200.0], atol=1e-5)
    steepest = 200.0 * np.abs(slope(np.linspace(-DIP_MM, 0.0, 1001))).max()
    assert steepest < 60.0
    _, share = follow(model, pose, pose, FREE, begin, end, 1e-6)
    assert share < 1.0
