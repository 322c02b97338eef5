"""Samples that a plan asked for and did not get are counted, and too many of them stop a build."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from casadi_contact.dataset import Dropped, Samples
from casadi_contact.sampling import SamplingSettings, drops
from casadi_contact.sampling.drops import dropped_shares, refuse_many_dropped
from casadi_contact.scenes import load_scene
from tests.support import own_contact

SPHERE = load_scene("sphere_on_plane")


def samples(kept, lost, reason, scene=SPHERE):
    counts = {"dropped": {"D3": {reason: lost}}}
    drawn = Samples(
        scene,
        np.zeros((kept, 6)),
        np.zeros((kept, 1, 6)),
        np.zeros((kept, 1)),
        np.full(kept, 3),
        np.zeros(kept, dtype=np.uint8),
        provenance=counts,
    )
    return replace(drawn, dropped=Dropped(np.zeros((lost, 6)), np.full(lost, 3)))


def test_the_share_is_of_the_plan_of_its_domain():
    assert dropped_shares(samples(75, 25, "not settled: no contact")) == {"D3": 0.25}
    assert dropped_shares(samples(75, 0, "")) == {}


@pytest.mark.parametrize(
    ("reason", "cure"),
    [
        ("contact reaches the edge of the elements", "enlarge"),
        ("not settled: x", "equilibrium"),
        ("touches though lifted off", "larger liftoff_mm"),
    ],
)
def test_more_than_the_stated_share_is_refused_with_reason_and_cure(reason, cure):
    refuse_many_dropped(samples(75, 25, reason))
    with pytest.raises(
        ValueError, match=rf"40% of the samples of D3 were dropped, expected at most 30%: {reason} \(40\).*{cure}"
    ):
        refuse_many_dropped(samples(60, 40, reason))
    refuse_many_dropped(samples(60, 40, reason), most=0.5)


@pytest.mark.parametrize("reason", ["not settled: x", "touches though lifted off", "pulls"])
def test_a_scene_without_surfaces_is_not_sent_to_a_picture_of_them(reason):
    for scene, named in ((SPHERE, True), (own_contact.SCENE, False)):
        with pytest.raises(ValueError, match="were dropped") as error:
            refuse_many_dropped(samples(60, 40, reason, scene))
        assert ("casadi-contact show" in str(error.value)) is named


@pytest.mark.parametrize(("ends", "open_sides", "named"), [("cut", 4, True), ("cut", 0, False), ("rim", 4, False)])
def test_where_a_mesh_was_taken_for_cut_open_the_cure_names_the_key_that_says_otherwise(
    ends, open_sides, named, monkeypatch
):
    """A cup that ends at its rim, of which a proposal cannot know whether it was cut from a larger one. A closed mesh
    has no edge that the key speaks of."""
    monkeypatch.setattr(drops, "body_mesh", lambda *_: SimpleNamespace(boundary_edges=np.zeros((open_sides, 2))))
    mesh = replace(SPHERE, geometry={**SPHERE.geometry, "open_edges": ends})
    with pytest.raises(ValueError, match="enlarge its patches") as error:
        refuse_many_dropped(samples(60, 40, "contact reaches the edge of the elements", mesh))
    assert ('open_edges = "rim"' in str(error.value)) is named


def test_shares_that_differ_by_less_than_a_percent_are_told_apart():
    with pytest.raises(
        ValueError, match=r"99\.70% of the samples of D3 were dropped, expected at most 99\.60%.*D3 = 0"
    ):
        refuse_many_dropped(samples(3, 997, "touches though lifted off"), most=0.996)


def test_the_limit_is_a_setting_of_the_scene_and_changes_no_sample():
    assert SamplingSettings(most_dropped=0.6).to_table() == SamplingSettings().to_table()
    with pytest.raises(ValueError, match="most_dropped"):
        SamplingSettings(most_dropped=1.5)
