"""Design of a dish: derivatives by all inputs, and an optimum in balance within its bounds that no neighbour beats."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.scenes.scene import Scene
from problems import design

BOUNDS = np.array([[5.0, 8.0], [0.5, 2.0]])
FRAMES = 7


@pytest.fixture(scope="module")
def contact():
    return design.DishContact(cc.load_scene("knee"))


@pytest.fixture(scope="module")
def solved(contact):
    return design.design(contact, BOUNDS, FRAMES)


def test_derivatives_by_pose_and_radii_are_those_of_loads_and_penetrations(contact, monkeypatch):
    """They are those of the integral, and of the sum over many rays."""
    monkeypatch.setattr(design, "RAYS", Rays(48, 5))
    pose, radii = np.array([0.5, 27.18, 0.1, 0.0, -0.05, -0.3]), np.array([58.0, 30.0])
    _, slopes = contact.evaluate(pose[None], radii)
    at, steps = np.concatenate([pose, radii]), np.array([*[1e-5] * 3, *[4e-7] * 3, 1e-4, 1e-4])
    for k, step in enumerate(np.diag(steps)):
        more, less = (contact.evaluate((at + sign * step)[None, :6], (at + sign * step)[6:])[0] for sign in (1, -1))
        expected = (more - less)[0] / (2.0 * steps[k])
        np.testing.assert_allclose(slopes[0, :-2, k], expected[:-2], atol=2e-4 * np.abs(expected[:-2]).max())
        np.testing.assert_allclose(slopes[0, -2:, k], expected[-2:], atol=1e-4 * (1.0 + np.abs(expected).max()))


def test_elements_of_other_dishes_change_alike(contact):
    """Another code: 320×160 elements, differenced over a tenth of a millimetre."""
    pose = [[-1.0, 27.3, 0.4, 0.002, 0.06, -0.15]]
    radii = np.array([contact.scene.geometry[name] for name in design.RADII])
    slopes = contact.evaluate(np.array(pose), radii)[1][0, :-2, -2:]
    for k, step in enumerate(0.05 * np.eye(2)):
        more, less = (cc.ElasticFoundation(contact.with_radii(radii + s * step), (320, 160))(pose)[0] for s in (1, -1))
        np.testing.assert_allclose(slopes[:, k], (more - less) / 0.1, atol=2e-3 * np.abs(more - less).max() / 0.1)


def test_the_best_dish_lowers_the_peak_carries_all_loads_and_keeps_its_laxity(contact, solved):
    first, best, _ = solved
    assert best.peaks_mpa.max() < 0.9 * first.peaks_mpa.max()
    loads = contact.evaluate(best.poses, best.radii_mm)[0]
    columns = [contact.scene.load_names.index(name) for name in design.BALANCED]
    np.testing.assert_allclose(loads[:, columns], design.wanted_loads(FRAMES)[0], atol=0.01)
    assert (best.travel_mm >= BOUNDS[:, 0] - 1e-3).all()
    assert (best.travel_mm <= BOUNDS[:, 1] + 1e-3).all()


def test_no_dish_nearby_within_the_laxity_bounds_is_better(contact, solved):
    _, best, _ = solved
    loads, _ = design.wanted_loads(FRAMES)
    for move in ([0.5, 0.0], [0.0, 0.3], [-0.5, 0.3], [0.5, -0.3]):
        radii = best.radii_mm + move
        near = design.balanced(contact.foundation(radii), radii, loads, best.poses)
        allowed = (near.travel_mm >= BOUNDS[:, 0]).all() and (near.travel_mm <= BOUNDS[:, 1]).all()
        assert not allowed or near.peaks_mpa.max() > best.peaks_mpa.max()


@pytest.mark.parametrize(
    ("own", "radii"), [({"frontal_radius": 25.0}, [39.4, 25.5]), ({"plateau_length": 90.0}, [45.5, 22.5])]
)
def test_a_dish_is_wider_than_condyle_and_plateau_of_both_sides(contact, own, radii):
    tables = contact.scene.tables
    uneven = Scene.from_tables({**tables, "geometry": {**tables["geometry"], "med": own}})
    np.testing.assert_allclose(design.narrowest(uneven), radii)


def test_scenes_without_one_dish_or_of_another_law_are_refused():
    for scene in (cc.load_scene("sphere_in_dish"), cc.load_scene("knee", law="log")):
        with pytest.raises(ValueError, match="dish"):
            design.DishContact(scene)


def test_the_program_prints_its_table_and_draws(solved, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(design, "design", lambda contact, bounds, frames: solved)
    coarse = cc.load_scene("knee").with_overrides(teacher=(60, 30), fine=(40, 20))
    (tmp_path / "coarse.toml").write_text(coarse.to_toml(), "utf-8")
    design.main(scene=str(tmp_path / "coarse.toml"), frames=FRAMES, out=tmp_path)
    assert "best" in capsys.readouterr().out
    assert (tmp_path / "design.png").stat().st_size > 1000
