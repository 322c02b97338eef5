"""Element grids of every surface: derivatives of their loads, and culling."""

import numpy as np
import pytest

import casadi_contact as cc
import casadi_contact.geometry.elements as grids
from casadi_contact.contact.elements.loops import block_bounds, point_bound
from casadi_contact.core.conventions import rotation
from casadi_contact.geometry.moving_surface import MESH_FIELD
from casadi_contact.geometry.surface_distances import signed_distance
from casadi_contact.pictures.contact_picture import contact_pose
from tests.support.agreement import differences
from tests.support.meshes import scene_of, sheet_mesh, torus_mesh

SCENES = ("knee", "hip", "patellofemoral", "mesh")
SPREAD = np.array([0.5, 0.2, 0.5, 0.02, 0.05, 0.2])


@pytest.fixture(scope="module", params=SCENES)
def case(request, tmp_path_factory):
    """A scene and poses about contact: light, deep, across the rim and none."""
    if request.param == "mesh":
        vertices, faces = torus_mesh(18.0, 12.0, 1.2)
        lower = faces[(vertices[faces][..., 1] < -25.0).all(axis=1)]
        scene = scene_of(tmp_path_factory.mktemp("torus"), (vertices, lower), sheet_mesh(14.0, 2.0))
        first = np.array([0.0, 29.85, 0.0, 0.0, 0.0, 0.0])
    else:
        scene = cc.load_scene(request.param)
        first = contact_pose(cc.ElasticFoundation(scene, (40, 30)))
    return scene, first + SPREAD * np.random.default_rng(1).normal(size=(60, 6))


def test_jacobians_are_differences_of_the_loads(case):
    """Loads of a fixed set of elements are smooth. A step that loads another element is an outlier."""
    scene, poses = case
    model = cc.ElasticFoundation(scene, (40, 30))
    loads, jacobian = model.jacobian(poses)
    np.testing.assert_allclose(loads, model(poses), rtol=1e-12, atol=1e-9)
    off = np.abs(jacobian - differences(model, poses, 1e-7)) / np.abs(jacobian).max(axis=(0, 2), keepdims=True)
    assert np.quantile(off, 0.98) < 1e-6
    roots, slopes = model.root_loads(poses)
    off = np.abs(slopes - differences(lambda at: model.root_loads(at)[0], poses, 1e-6)) / np.abs(slopes).max()
    assert np.quantile(off, 0.95) < 1e-4
    assert (roots > 0.0).any()


def test_culling_never_changes_the_result(case, monkeypatch):
    """Blocks of one element each bound nothing but themselves: the plain sum over all elements."""
    scene, poses = case
    culled = cc.ElasticFoundation(scene, (40, 30))
    for side in (1, 64):
        monkeypatch.setattr(grids, "BLOCK_SIDE", side)
        other = cc.ElasticFoundation(scene, (40, 30))
        np.testing.assert_allclose(other.wrenches(poses), culled.wrenches(poses), rtol=1e-10, atol=1e-7)
        np.testing.assert_allclose(other.gaps(poses), culled.gaps(poses), rtol=1e-10)


@pytest.mark.parametrize("from_middle_mm", [20.0, 26.0, 29.5])
@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.6, -0.8, 0.0], [1.0, 1.0, 1.0]])
def test_bounds_hold_at_all_points_of_a_block_in_a_hollow(from_middle_mm, direction):
    """A body around a spherical hollow, g = R - |p|, is bent towards the body, as in the notch of a femur."""
    hollow_mm, outwards = 30.0, np.array(direction) / np.linalg.norm(direction)
    centre, half = from_middle_mm * outwards, np.array([1.0, 0.3, 1.5])
    curvature = 1.0 / (from_middle_mm - np.linalg.norm(half))  # the largest in the block
    tangent = (hollow_mm - from_middle_mm, *-outwards, curvature)
    offsets = half * np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * 3), axis=-1).reshape(-1, 3)
    distances = hollow_mm - np.linalg.norm(centre + offsets, axis=1)
    bounds = np.array([point_bound.py_func(tangent, *offset) for offset in offsets])
    box = np.concatenate([[0.0] * 3, np.diag(half).ravel()])[:, None]
    assert block_bounds(MESH_FIELD, np.array(tangent)[:, None], box)[0] <= distances.min()
    assert (bounds <= distances + 1e-12).all()
    assert (distances - bounds).max() < 2.0 * curvature * half @ half  # and not so low that nothing is left out


def test_distances_of_many_points_are_those_of_each(case):
    """Swept arcs have loops of their own."""
    scene, poses = case
    model, patch = cc.ElasticFoundation(scene, (10, 10)), scene.patch_names[0]
    points = poses[0, :3] + 30.0 * np.random.default_rng(2).normal(size=(200, 3))
    surface, frame = scene.surfaces()[0], rotation(poses[0, 3:])
    each = [signed_distance(surface.family, surface.parameters, *q)[0] for q in (points - poses[0, :3]) @ frame]
    np.testing.assert_allclose(model.distances(points, poses[0], patch), each, atol=1e-10)
