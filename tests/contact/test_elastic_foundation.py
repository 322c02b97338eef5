"""The elastic foundation against closed-form forces, symmetry, invariance and finite differences."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.scene import Scene
from tests.support.ready_poses import at, walking


def test_force_errors_fall_as_the_square_of_the_element_size():
    """A quadrature of a contact with a free edge has a ragged error: compare its RMS over many positions."""
    scene = cc.load_scene("sphere_on_plane")
    rng = np.random.default_rng(0)
    poses = np.repeat(at(29.8), 60, axis=0)
    poses[:, [0, 2]] = rng.uniform(-0.5, 0.5, (60, 2))
    grids = np.array([40, 80, 160, 320])
    errors = [np.sqrt(np.mean((cc.ElasticFoundation(scene, (n, n))(poses)[:, 1] + 1006.4840) ** 2)) for n in grids]
    order = -np.polyfit(np.log(grids), np.log(errors), 1)[0]
    assert 1.7 < order < 3.0


@pytest.mark.parametrize("law", ["linear", "log"])
def test_flat_punch_is_exact_on_any_grid(law):
    scene = cc.load_scene("punch_on_plane", law=law, area=77.0)
    K, h, d = 267.5728 * 8.0, 8.0, 0.3
    expected = 77.0 * (K * d / h if law == "linear" else -K * np.log(1 - d / h))
    loads = cc.ElasticFoundation(scene, grid=(3, 5))(at(-d))[0]
    assert loads[1] == pytest.approx(-expected, rel=1e-6)
    np.testing.assert_allclose(loads[[0, 2, 3, 4, 5]], 0.0, atol=1e-9)


def knee_poses(n, seed=0):
    """Poses over the walking range, from lightly lifted to 0.3 mm deep."""
    scene, (poses, targets) = cc.load_scene("knee"), walking(n, seed)
    settled, report = cc.settle(cc.ElasticFoundation(scene), poses, ("ty", "rx"), targets)
    assert report.converged.all()
    settled[::5, 3] += 0.02
    return scene, settled


def test_a_mirrored_pose_on_a_mirrored_knee_mirrors_the_loads():
    text = cc.load_scene("knee").to_toml()
    left, right = (
        cc.ElasticFoundation(
            Scene.from_toml(
                text.replace("[geometry]", f"[geometry]\n{side} = {{ frontal_radius = 21.0, plateau_width = 30.0 }}")
            )
        )
        for side in ("med", "lat")
    )
    _, poses = knee_poses(20)
    mirror = np.array([1, 1, -1, -1, -1, 1])  # z -> -z: tz, rx and ry change sign
    wrenches, mirrored = left.wrenches(poses), right.wrenches(poses * mirror)
    np.testing.assert_allclose(mirrored[:, ::-1], wrenches * [1, 1, -1, -1, -1, 1], atol=1e-6)


def test_root_loads_are_continuous_through_liftoff_with_their_slopes():
    scene, _ = knee_poses(1)
    model = cc.ElasticFoundation(scene, (320, 160))
    ty = np.linspace(27.2, 27.8, 121)
    poses = np.repeat(at(0.0, rz=-0.6), len(ty), axis=0)
    poses[:, 1] = ty
    s, slope = model.root_loads(poses)
    assert s[0, 0] > 0 > s[-1, 0]
    assert np.all(np.diff(s[:, 0]) < 0)
    loaded = s[:, 0] > 0.1
    np.testing.assert_allclose(slope[loaded, 0, 1], np.gradient(s[:, 0], ty)[loaded], rtol=0.03)
    assert np.all(slope[s[:, 0] < 0, 0, 1] < -0.9 * scene.gap_slope)


def test_contact_at_the_edge_of_the_elements_is_seen():
    scene = cc.load_scene("sphere_on_plane")
    poses = np.vstack([at(29.9), at(29.9, tx=11.9), at(30.1, tx=12.0), at(29.9, tz=-11.95)])
    assert cc.ElasticFoundation(scene).at_edge(poses)[:, 0].tolist() == [False, True, False, True]


def test_a_users_own_callable_is_a_contact_model():
    scene = cc.load_scene("sphere_on_plane")
    reference = cc.ElasticFoundation(scene)
    model = cc.CallableModel(scene, reference.wrenches)
    poses = at(29.83, tx=0.2)
    np.testing.assert_allclose(model(poses), reference(poses))
    np.testing.assert_allclose(model.jacobian(poses)[1], reference.jacobian(poses)[1], rtol=1e-2, atol=2.0)
    settled, report = cc.settle(model, at(33.0), ("ty",), {"Fy": -500.0})
    assert report.converged.all()
    assert reference(settled)[0, 1] == pytest.approx(-500.0, abs=1e-3)
    with pytest.raises(ValueError, match=r"returned wrenches of shape \(1, 6\), expected \(1, 1, 6\)"):
        cc.CallableModel(scene, lambda p: np.zeros((len(p), 6)))(poses)


def test_depths_stay_finite_on_the_back_of_a_body_where_its_distance_jumps():
    """Beyond its last arc a condyle's distance function jumps; rays that end there once gave 1e42 N, pulling."""
    scene = cc.load_scene("knee")
    unit = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 6))
    poses = np.array([0.0, 26.0, 0.0, 0.0, 0.0, -2.2]) + np.array([25.0, 8.0, 3.0, 0.4, 0.4, 0.5]) * unit
    normal = -cc.ElasticFoundation(scene, (40, 30))(poses)[:, :2]
    assert (normal > 0.0).sum() > 500
    assert normal.min() >= 0.0
    assert normal.max() < 1e7
