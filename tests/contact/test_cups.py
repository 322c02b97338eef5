"""A ball in a cup: closed forms, the rim, the element grid, meshes with walls that no single direction sees."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from tests.support.meshes import ELASTIC, ball_mesh, scene_of, shell_mesh
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
        assert max(found.record["rms"][name], found.record["largest"][name] / 3.0) <= tolerance
    strict = found.scene.with_overrides(**{name: 1e-4 * t for name, t in found.scene.tolerances.items()})
    assert cc.foundation(strict, compiled=False).points > found.points
    with pytest.raises(ValueError, match="relax the scene's tolerances"):
        cc.foundation(found.scene.with_overrides(Fx=1e-12), compiled=False)


POLE = np.array([0.36, 0.8, 0.48])
ACROSS = np.array([0.8, -0.36, 0.0]) / np.hypot(0.8, 0.36)
BALL_MM, CUP_MM = 16.0, 16.4
DEPTHS = 0.55  # of the ball's centre from the cup's [mm]
HALF_ANGLE_DEG = 120.0
SIZE = Cells(1.5, 1.5, 4, 4)


@pytest.fixture(scope="module")
def deep_cup(tmp_path_factory):
    """In a patch of elements and cells on rays from its middle."""
    cup = shell_mesh(CUP_MM, 22.0, 1.5, np.deg2rad(HALF_ANGLE_DEG), POLE)
    said = f"pressing = {POLE.tolist()}\ncup_centre = [0.0, 0.0, 0.0]"
    return scene_of(tmp_path_factory.mktemp("cup"), ball_mesh(BALL_MM, 1.5), cup, extra=said, grid=(60, 60))


@pytest.fixture(scope="module")
def closed_form():
    """The force of the ball at the pole of a cup whose rim is far, along the displacement."""
    layer = {key: value for key, value in ELASTIC.items() if key != "law"}
    geometry = {"ball_radius": BALL_MM, "cup_radius": CUP_MM, "cup_half_angle_deg": 85.0, "cup_centre": [0.0] * 3}
    scene = cc.load_scene("hip", cup_pole=POLE.tolist(), law="linear", **geometry, **layer)
    return float(np.linalg.norm(cc.CupFoundation(scene, 32, compiled=False)([*DEPTHS * POLE, 0.0, 0.0, 0.0])[:3]))


@pytest.mark.parametrize("make", [cc.ElasticFoundation, lambda s: cc.CellFoundation(s, SIZE, compiled=False)])
@pytest.mark.parametrize("angle_deg", [0.0, 60.0])
def test_a_ball_presses_the_wall_of_a_deep_cup_as_it_presses_its_pole(deep_cup, closed_form, make, angle_deg):
    """At 60 degrees from the pole contact reaches from 17 to 103, beyond what rays along the pole meet."""
    angle = np.deg2rad(angle_deg)
    direction = np.cos(angle) * POLE + np.sin(angle) * ACROSS
    model = make(deep_cup)
    pose = np.array([*DEPTHS * direction, 0.1, -0.2, 0.3])
    force, torque = model.wrenches(pose)[0].reshape(2, 3)
    np.testing.assert_allclose(force, closed_form * direction, atol=1e-2 * closed_form)
    assert np.linalg.norm(torque) < 0.08 * closed_form  # it passes the cup's middle by less than 0.08 mm
    assert not model.at_edge(pose)[0]


def test_contact_that_reaches_a_cup_s_open_edge_is_said_to_and_at_the_rim_of_a_closed_one_it_ends(deep_cup, tmp_path):
    """All around, however the grid's lines cross the rim."""
    around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)[:, None]
    towards_rim = np.cos(2.0) * POLE + np.sin(2.0) * (np.cos(around) * ACROSS + np.sin(around) * np.cross(POLE, ACROSS))
    poses = np.pad(DEPTHS * towards_rim, ((0, 0), (0, 3)))
    points, faces = shell_mesh(CUP_MM, 22.0, 1.5, np.deg2rad(HALF_ANGLE_DEG), POLE)
    inside = faces[(faces < len(points) // 2).all(axis=1)]
    said = f"pressing = {POLE.tolist()}\ncup_centre = [0.0, 0.0, 0.0]"
    open_cup = scene_of(tmp_path, ball_mesh(BALL_MM, 1.5), (points, inside), extra=said, grid=(60, 60))
    assert cc.ElasticFoundation(open_cup).at_edge(poses).all()
    assert not cc.ElasticFoundation(deep_cup).at_edge(poses).any()
