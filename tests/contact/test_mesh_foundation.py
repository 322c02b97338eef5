"""The elastic foundation on meshes: within 1 % of the exact surface, where facets lose tens of per cent."""

import numpy as np
import pytest

import casadi_contact as cc
from tests.support.meshes import STIFFNESS, ball_mesh, cap_mesh, scene_of, sheet_mesh, slab_mesh

OVERLAP_MM = 0.1
EDGE_MM, RADIUS_MM = 1.2, 30.0


@pytest.fixture(scope="module")
def sphere(tmp_path_factory):
    moving = cap_mesh(RADIUS_MM, EDGE_MM, 0.45)
    return scene_of(tmp_path_factory.mktemp("sphere"), moving, sheet_mesh(14.0, 2.0), grid=(160, 160))


def turned(radius, overlap, count, angles):
    """Poses of a body turned about its centre, which lies above the origin: the contact moves over its facets."""
    poses = np.zeros((count, 6))
    poses[:, 1] = radius - overlap
    poses[:, 3:] = np.random.default_rng(3).uniform(-1.0, 1.0, (count, 3)) * angles
    return poses


def test_force_on_a_meshed_sphere_is_within_one_per_cent(sphere):
    exact = np.pi * STIFFNESS * OVERLAP_MM**2 * (RADIUS_MM - OVERLAP_MM / 3.0)
    poses = turned(RADIUS_MM, OVERLAP_MM, 30, [0.2, 3.0, 0.2])
    smooth, flat = (-m(poses)[:, 1] / exact - 1.0 for m in (cc.ElasticFoundation(sphere), cc.RayCastFoundation(sphere)))
    assert np.abs(smooth).max() < 0.01
    assert flat.mean() < -0.1


@pytest.mark.parametrize("count", [40, 160])
def test_a_ball_on_the_sharp_edge_of_a_slab_presses_it_down_with_half_its_load(tmp_path, count):
    """The slab ends at its edge, however fine the grid: its side wall bears nothing, and pushes nothing aside."""
    slab = slab_mesh(*sheet_mesh(14.0, 2.0), 6.0)
    scene = scene_of(tmp_path, cap_mesh(RADIUS_MM, EDGE_MM, 0.45), slab, grid=(count, count))
    fx, fy = cc.ElasticFoundation(scene)([7.0, RADIUS_MM - 2.0 * OVERLAP_MM, 0.0, 0.0, 0.0, 0.0])[:2]
    half = 0.5 * np.pi * STIFFNESS * (2.0 * OVERLAP_MM) ** 2 * (RADIUS_MM - 2.0 * OVERLAP_MM / 3.0)
    assert fy == pytest.approx(-half, rel=0.02)
    assert abs(fx) < 0.01 * half


def test_no_overlap_gives_exactly_zero_and_the_gap_also_beyond_the_field(sphere):
    model = cc.ElasticFoundation(sphere)
    poses = np.zeros((4, 6))
    gaps = np.array([1e-3, 0.1, 2.0, 9.0])
    poses[:, 1] = RADIUS_MM + gaps
    assert not model(poses).any()
    np.testing.assert_allclose(model.gaps(poses)[:, 0], gaps, atol=0.01)


def test_triangles_as_elements_meet_the_grid_on_a_curved_fixed_mesh(tmp_path):
    dish = sheet_mesh(16.0, 1.0, lambda x, z: 45.0 - np.sqrt(45.0**2 - x**2 - z**2))
    moving = cap_mesh(RADIUS_MM, EDGE_MM, 0.45)
    forces = {}
    for kind in ("grid", "triangles"):
        model = cc.ElasticFoundation(scene_of(tmp_path, moving, dish, elements=kind, grid=(160, 160)))
        forces[kind] = model(turned(RADIUS_MM, 0.2, 20, [0.1, 3.0, 0.1]))[:, 1].mean()
    assert forces["grid"] == pytest.approx(-2966.6461, rel=0.01)  # closed form, rays along the dish's normals
    assert forces["triangles"] == pytest.approx(-2966.6461, rel=0.01)


def test_patches_that_share_a_bound_share_no_force(tmp_path):
    """Two halves of the plate carry what the whole one does, with triangles as with grids."""
    halves = "[geometry.patches.front]\nx = [0.5, 20.0]\n[geometry.patches.back]\nx = [-20.0, 0.5]\n"
    poses = turned(RADIUS_MM, 0.2, 5, [0.1, 3.0, 0.1])
    for kind, grid in (("grid", (200, 200)), ("triangles", (1, 1))):
        forces = []
        for extra in ("", halves):
            folder = tmp_path / f"{kind}{len(extra)}"
            folder.mkdir()
            plate = sheet_mesh(14.0, 0.2 if kind == "triangles" else 2.0)
            ball = cap_mesh(RADIUS_MM, EDGE_MM, 0.45)
            model = cc.ElasticFoundation(scene_of(folder, ball, plate, elements=kind, grid=grid, extra=extra))
            forces.append(model.wrenches(poses)[:, :, 1])
        whole, parts = forces
        assert (parts < 0.0).all()
        np.testing.assert_allclose(parts.sum(axis=1), whole[:, 0], rtol=5e-3)


def test_a_plate_of_two_triangles_bears_a_small_ball(tmp_path):
    """Elements and rays count at the centres of triangles, which are divided to suit the ball."""
    sizes = {"elements": "triangles", "extra": "spacing = 0.25"}
    scene = scene_of(tmp_path, ball_mesh(3.0, 0.15), sheet_mesh(8.0, 8.0), **sizes)
    exact_n = np.pi * STIFFNESS * 0.06**2 * (3.0 - 0.06 / 3.0)
    for model in (cc.ElasticFoundation(scene), cc.RayCastFoundation(scene)):
        assert model([[0.1, 2.94, 0.2, 0.0, 0.0, 0.0]])[0, 1] == pytest.approx(-exact_n, rel=0.1)
