"""Polar quadrature in NumPy: closed forms, symmetry, invariance, its own convergence, and the choice of rays."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import pressed_poses
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import rotation
from tests.support.ready_poses import KNEE, at


def polar(name, rays=Rays(12, 3), **overrides):  # noqa: B008
    return cc.PolarFoundation(cc.load_scene(name, **overrides), rays, compiled=False)


def test_no_overlap_gives_exactly_zero_and_the_distance():
    model = polar("sphere_on_plane")
    poses = np.vstack([at(30.25), at(30.0 + 1e-9), at(29.9)])
    assert not model.wrenches(poses[:2]).any()
    np.testing.assert_allclose(model.gaps(poses)[:, 0], [0.25, 1e-9, -0.1], atol=1e-12)
    np.testing.assert_allclose(model.root_loads(poses[:1])[1][0, 0], [0.0, -model.scene.gap_slope, 0.0, 0.0, 0.0, 0.0])


def test_the_resultant_in_a_spherical_dish_passes_through_its_centre():
    model = polar("sphere_in_dish", Rays(16, 4))
    wrench = model.wrenches(np.array([[2.0, 30.0, 1.0, 0.0, 0.0, 0.0]]))[0, 0]
    assert wrench[1] < -100.0
    about_centre = wrench[3:] - np.cross([0.0, 45.0, 0.0], wrench[:3])
    np.testing.assert_allclose(about_centre, 0.0, atol=1e-4 * np.abs(wrench[3:]).max())


@pytest.mark.parametrize(
    ("name", "pose"),
    [("knee", KNEE), ("patellofemoral", [-49.7, 1.0, 0.3, 0.02, 0.05, 0.1])],
)
def test_it_agrees_with_a_fine_element_grid(name, pose):
    """Inside the rim; the element grid's own error of some tenths of a newton is what is left."""
    model = polar(name, Rays(24, 4))
    grid = cc.ElasticFoundation(model.scene, (320, 160))
    poses = np.array([pose])
    force = np.abs(grid(poses)).max()
    np.testing.assert_allclose(model(poses), grid(poses), atol=2e-3 * force)
    np.testing.assert_allclose(model.gaps(poses), grid.gaps(poses), atol=0.01)


def test_moving_both_bodies_together_leaves_the_wrench_in_the_fixed_frame_unchanged():
    """On a plane of any size: shifted along it and turned about its normal, the wrench goes along."""
    model = polar("sphere_on_plane")
    pose = at(29.8, tx=0.5)
    wrench = model.wrenches(pose)[0, 0]
    R = rotation([0.0, 0.7, 0.0])
    moved = pose.copy()
    moved[0, :3] = R @ pose[0, :3]
    moved[0, 4] = 0.7
    np.testing.assert_allclose(model.wrenches(moved)[0, 0], np.kron(np.eye(2), R) @ wrench, atol=1e-6)


def test_the_rim_cuts_off_what_lies_beyond_it():
    """Half a ball's spot on a plane's edge carries half its force; a spot beyond the edge nothing."""
    model = polar("sphere_on_plane", Rays(48, 4))
    whole, half, beyond = model(np.vstack([at(29.8), at(29.8, tx=12.0), at(29.8, tx=16.0)]))
    assert half[1] == pytest.approx(0.5 * whole[1], rel=2e-3)
    assert not beyond.any()
    np.testing.assert_array_equal(model.at_edge(np.vstack([at(29.8), at(29.8, tx=12.0)]))[:, 0], [False, True])


def test_more_rays_converge_and_the_choice_meets_the_tolerances_with_the_fewest():
    model = cc.foundation("knee", compiled=False)
    record = model.record
    assert (model.rays.count, model.rays.points) == (record["rays"], record["points"])
    assert (record["against"], record["elements_apart"]) == ("96 rays × 6 points, EF 320×160", 0.0)
    for name, tolerance in model.scene.tolerances.items():
        assert record["rms"][name] <= tolerance
        assert record["largest"][name] <= 3.0 * tolerance


def test_a_spot_as_wide_as_its_dish_is_deep_has_the_force_of_elements():
    """Where a femur fits its dish closely, estimated ends of a spot lie past the upright wall of the dish's circle."""
    scene = cc.load_scene("knee", dish_sagittal_radius=43.0, dish_frontal_radius=24.0)
    model = cc.PolarFoundation(scene, Rays(16, 3), compiled=False)
    R, t = pressed_poses(model.patches[0], model.law, (5.0, 2500.0), 200)
    poses = np.column_stack([t, Rotation.from_matrix(R).as_euler("XYZ")])
    wanted = cc.ElasticFoundation(scene, grid=(160, 80))
    force, elements = model.wrenches(poses)[:, 0, :3], wanted.wrenches(poses)[:, 0, :3]
    size = np.linalg.norm(elements, axis=1)
    seen = (size > 20.0) & ~wanted.at_edge(poses)[:, 0]
    off = np.linalg.norm(force - elements, axis=1)[seen] / size[seen]
    assert seen.sum() > 75
    assert np.median(off) < 1e-3
    assert off.max() < 0.05
