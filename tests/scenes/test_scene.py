"""Scenes: readable, checked, and the same after a round trip; the one rule of their tolerances."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.loading import ready_scenes
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance


@pytest.mark.parametrize("name", ready_scenes())
def test_every_ready_scene_survives_its_own_text(name):
    scene = cc.load_scene(name)
    again = Scene.from_toml(scene.to_toml())
    assert again == scene
    assert again.digest == scene.digest


def test_keywords_replace_single_parameters_and_change_the_digest():
    scene = cc.load_scene("sphere_on_plane", radius=20.0, law="log", fine=(30, 20))
    assert (scene.geometry["radius"], scene.material.law, scene.grids["fine"]) == (20.0, "log", (30, 20))
    assert scene.digest != cc.load_scene("sphere_on_plane").digest


@pytest.mark.parametrize("name", ["knee", "sphere_on_plane"])  # with settings of the sampling, and without any
def test_the_digest_tells_loads_and_sampling_but_neither_tolerances_nor_how_much_may_be_lost(name):
    scene = cc.load_scene(name)
    finer = scene.with_tolerances(**{scene.load_names[0]: 0.01})
    lenient = Scene.from_tables({**scene.tables, "sampling": {**scene.sampling, "most_dropped": 0.6}})
    other = Scene.from_tables({**scene.tables, "sampling": {**scene.sampling, "seed": 1}})
    assert finer != scene
    assert finer.digest == lenient.digest == scene.digest != other.digest


def test_one_side_of_a_knee_can_have_its_own_values():
    text = cc.load_scene("knee").to_toml()
    own = "[geometry]\nmed = { frontal_radius = 21.0, condyle_offset = 24.0 }"
    knee = Scene.from_toml(text.replace("[geometry]", own))
    assert [knee.patch_geometry(side)["frontal_radius"] for side in ("med", "lat")] == [21.0, 22.0]
    assert knee.anchors_mm[:, 2].tolist() == [24.0, -22.0]


TOLERANCE = Tolerance(("Fy", "Tx"), np.array([2.0, 50.0]))


@pytest.mark.parametrize(
    ("errors", "ratio"),
    [
        ([[2.0, 0.0], [-2.0, 0.0]], 1.0),  # the RMS is just met
        ([[0.0, 150.0], *[[0.0, 0.0]] * 15], 1.0),  # a single error of three tolerances, RMS 0.75
        ([[0.0, 300.0], *[[0.0, 0.0]] * 99], 2.0),
        ([[1.0, np.nan]], np.inf),
        (np.zeros((0, 2)), 0.0),
    ],
)
def test_a_tolerance_is_met_by_the_worst_rms_and_single_error(errors, ratio):
    assert TOLERANCE.ratio(errors) == pytest.approx(ratio)
    assert TOLERANCE.met(errors) == (ratio <= 1.0)


@pytest.mark.parametrize("given", [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (1.0, np.inf)])
def test_a_tolerance_that_is_not_above_zero_is_refused(given):
    with pytest.raises(ValueError, match="above 0"):
        Tolerance.of_kinds(*given)
