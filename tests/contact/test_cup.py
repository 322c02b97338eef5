"""The foundation of a ball in a cup: closed forms, the rim, the element grid, derivatives, the choice of points."""

import numpy as np
import pytest

import casadi_contact as cc
from tests.support.ready_poses import PLACES, in_cup, placed, pole


@pytest.fixture(scope="module", params=PLACES)
def model(request):
    return cc.CupFoundation(cc.load_scene(request.param), 32, compiled=False)


@pytest.mark.parametrize(
    ("cup_radius", "overlap", "force"), [(45.0, 0.1, 749.0413), (45.0, 0.2, 2966.6461), (33.0, 0.1, 2652.6872)]
)
def test_a_shallow_cup_gives_the_reference_forces_of_a_dish(cup_radius, overlap, force):
    scene = cc.load_scene("hip", ball_radius=30.0, cup_radius=cup_radius, cup_half_angle_deg=25.0)
    along = pole(scene)
    got = cc.CupFoundation(scene, 8, compiled=False)(in_cup(scene, (cup_radius - 30.0 + overlap) * along))[0, :3]
    np.testing.assert_allclose(got, force * along, atol=1e-6 * force)


def test_it_agrees_with_a_fine_element_grid_inside_the_rim_and_cut_by_it(model):
    poses = placed(model.scene, PLACES[model.scene.name])
    grid = cc.ElasticFoundation(model.scene, (500, 500))
    wrenches = grid.wrenches(poses)
    np.testing.assert_allclose(model.wrenches(poses), wrenches, atol=3e-5 * np.abs(wrenches).max())
    np.testing.assert_allclose(model.gaps(poses), grid.gaps(poses), atol=0.01)
    np.testing.assert_array_equal(model.at_edge(poses), grid.at_edge(poses))
    np.testing.assert_array_equal(model.at_edge(poses)[:, 0], [False, True, True, False])


def test_out_of_contact_loads_are_zero_and_the_gap_is_the_distance_to_the_cup_or_its_rim(model):
    scene, cup = model.scene, model.cup
    clearance = cup.radius - cup.ball_radius
    poses = in_cup(scene, np.outer([0.0, 0.5 * clearance, -clearance], pole(scene)))
    assert not model.wrenches(poses).any()
    down = np.array([-np.cos(cup.half_angle), np.sin(cup.half_angle)])
    to_rim = np.hypot(cup.radius * down[0] - clearance, cup.radius * down[1]) - cup.ball_radius
    np.testing.assert_allclose(model.gaps(poses)[:, 0], [clearance, 0.5 * clearance, to_rim], rtol=1e-12)
    assert np.isfinite(model.root_loads(poses)[1]).all()
    np.testing.assert_allclose(model.root_loads(poses[0])[1][0, :3], scene.gap_slope * pole(scene), rtol=1e-12)


def test_the_choice_meets_the_tolerances_with_the_fewest_points():
    found = cc.foundation("hip", compiled=False)
    assert isinstance(found, cc.CupFoundation)
    for name, tolerance in found.scene.tolerances.items():
        assert found.record["rms"][name] <= tolerance
        assert found.record["largest"][name] <= 3.0 * tolerance
    strict = found.scene.with_overrides(**{name: 1e-4 * t for name, t in found.scene.tolerances.items()})
    assert cc.foundation(strict, compiled=False).points > found.points
    with pytest.raises(ValueError, match="relax the scene's tolerances"):
        cc.foundation(found.scene.with_overrides(Fx=1e-12), compiled=False)
