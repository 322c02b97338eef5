"""Finite elements: closed forms, energy, complementarity, and exact derivatives."""

import sys

import numpy as np
import pytest
from scipy.optimize import nnls

import casadi_contact as cc
from casadi_contact.contact.finite_elements import layer as layers
from casadi_contact.contact.finite_elements.layer import Hexahedra, Layer
from casadi_contact.contact.finite_elements.model import ElasticBody, FiniteElements, active_set
from casadi_contact.geometry.moving_surface import sphere
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.samples.models import MODELS
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.material import Material

COARSE = ((21, 13), Hexahedra(layers=1))


@pytest.fixture(scope="module")
def knee_model():
    return FiniteElements(cc.load_scene("knee"), *COARSE)


@pytest.fixture(scope="module")
def pressed_pose(knee_model):
    """Turned, and 0.3 mm lower than where it first touches."""
    pose = np.array([0.8, 0.0, 0.4, 0.01, 0.05, 0.4])
    for _ in range(20):
        pose[1] -= knee_model.gaps(pose).max()
    return pose - [0, 0.3, 0, 0, 0, 0]


def flat_grid(x):
    points = np.stack(np.meshgrid(x, [0.0], x, indexing="ij"), -1)[:, 0]
    return points, np.broadcast_to([0.0, 1.0, 0.0], points.shape), np.ones(points.shape[:2], dtype=bool)


def graded_block(half, thickness, mesh, E=10.0, nu=0.3):
    """A block whose elements end at ±half (k,) along x and z, the first 0."""
    ends = np.concatenate([-half[:0:-1], half])
    grid = np.sort(np.concatenate([ends, 0.5 * (ends[1:] + ends[:-1])]))
    return Layer.of(*flat_grid(grid), Material(E, nu, thickness), mesh)


def test_sphere_on_thick_block_is_hertz():
    """With the series of Dimitriadis et al. (2002) for a bonded layer, to second order in √(R·d)/h."""
    E, nu, R, radius, h = 10.0, 0.3, 100.0, 1.0, 20.0
    half = np.concatenate([np.linspace(0.0, 1.25, 4), 1.25 + 0.42 * np.cumsum(3.0 ** np.arange(1, 4))])
    block = graded_block(half, h, Hexahedra(3, grading=5.0))
    depth = radius**2 / R
    found = ElasticBody(block, sphere(R)).press(np.eye(3), np.array([0.0, R - depth, 0.0]), 0.01)
    alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1.0 - nu)
    chi = -2.0 * alpha / np.pi * np.sqrt(R * depth) / h
    hertz = 4.0 / 3.0 * E / (1.0 - nu**2) * np.sqrt(R) * depth**1.5 * (1.0 + chi + chi**2)
    assert found.forces_n.sum() == pytest.approx(hertz, rel=0.02)


def test_rigid_flat_punch_on_a_half_space():
    """Square of side L: F = π·0.36679·E/(1-ν²)·L·d, as the capacitance of a plate (Read 1997); a back at h takes
    away 1.386·F·(1-ν²)/(π·E·h) of d (Dimitriadis et al. 2002, first order). Pressure is without bound at the edges."""
    modulus, h, depth = 10.0 / (1.0 - 0.3**2), 10.0, 0.01
    block = graded_block(np.array([0.0, 0.8, 1.0, 1.2, 2.0, 4.0, h]), h, Hexahedra(4, grading=3.3))
    under = (np.abs(block.points_mm[:, [0, 2]]) < 1.0 + 1e-9).all(axis=1)
    nodes = np.flatnonzero(active_set(block.compliance, np.where(under, depth, -np.inf)))
    forces = np.linalg.solve(block.compliance[np.ix_(nodes, nodes)], np.full(len(nodes), depth))
    half_space = np.pi * 0.36679 * modulus * 2.0
    expected = depth / (1.0 / half_space - 1.386 / (np.pi * modulus * h))
    assert forces.sum() == pytest.approx(expected, rel=0.03)
    pressures = forces / block.areas_mm2[nodes]
    at = np.abs(block.points_mm[nodes][:, [0, 2]]).max(axis=1)
    assert pressures[at > 0.95].mean() > 2.0 * pressures[at < 0.5].mean()


def test_thin_compressible_layer_is_an_elastic_foundation():
    scene = cc.load_scene("sphere_on_plane").with_overrides(
        radius=1000.0, patch_side=26.0, thickness=1.0, poissons_ratio=0.2
    )
    pose = np.array([0.0, 1000.0 - 0.05, 0.0, 0.0, 0.0, 0.0])  # contact radius: ten times the thickness
    springs = cc.ElasticFoundation(scene, (53, 53)).wrenches(pose)[0, 1]
    assert FiniteElements(scene, (27, 27)).wrenches(pose)[0, 1] == pytest.approx(springs, rel=0.05)


@pytest.mark.parametrize("order", [1, 2])
def test_evenly_compressed_block_without_poissons_ratio(order):
    """F = E·A·d/h exactly, the pressure even and the energy F·d/2."""
    scene = cc.load_scene("punch_on_plane").with_overrides(poissons_ratio=0.0)
    model = FiniteElements(scene, (9, 9), Hexahedra(2, order))
    pose = np.array([0.0, -0.1, 0.0, 0.0, 0.0, 0.0])
    (map_,) = model.pressure_maps(pose)
    pressure = scene.material.youngs_modulus * 0.1 / scene.material.thickness
    np.testing.assert_allclose(map_.pressures_mpa, pressure, rtol=1e-9)
    force = pressure * map_.areas_mm2.sum()
    assert -model.wrenches(pose)[0, 1] == pytest.approx(force, rel=1e-9)
    assert model.stored_energy(pose)[0] == pytest.approx(0.05 * force, rel=1e-9)
    assert map_.areas_mm2.sum() == pytest.approx(scene.geometry["area"] * (8 / 9) ** 2)


@pytest.mark.parametrize("order", [1, 2])
def test_rigid_motions_strain_nothing(order):
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(*[np.arange(order + 1.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    x = grid + 0.1 * rng.uniform(size=grid.shape)
    K = layers._stiffness(x, np.arange(len(x))[None], Material(5.0, 0.4, 1.0), order)
    turns = [np.cross(axis, x).ravel() for axis in np.eye(3)]
    shifts = [np.tile(axis, len(x)) for axis in np.eye(3)]
    np.testing.assert_allclose(K @ np.transpose(turns + shifts), 0.0, atol=1e-11)
    assert np.linalg.matrix_rank(K.toarray(), tol=1e-9) == 3 * len(x) - 6


def test_work_of_pressing_is_the_stored_energy():
    scene = cc.load_scene("sphere_on_plane")
    model = FiniteElements(scene, (31, 31), Hexahedra(layers=1))
    at, weights = np.polynomial.legendre.leggauss(120)
    depths = 0.2 * (at + 1.0)  # 0 to 0.4 mm
    poses = np.zeros((len(at), 6))
    poses[:, 1] = scene.geometry["radius"] - depths
    work = 0.2 * weights @ -model.wrenches(poses)[:, 0, 1]
    assert model.stored_energy(np.array([0.0, 29.6, 0.0, 0.0, 0.0, 0.0]))[0] == pytest.approx(work, rel=1e-3)


def test_forces_press_and_keep_the_bodies_apart(knee_model, pressed_pose):
    for body, found in zip(knee_model._bodies, next(knee_model._pressed(pressed_pose[None])), strict=True):
        C = body.layer.compliance
        np.testing.assert_allclose(C, C.T, atol=1e-12 * C.max())
        assert len(found.nodes) > 3
        assert (found.forces_n > 0.0).all()
        np.testing.assert_allclose(C[np.ix_(found.nodes, found.nodes)] @ found.forces_n, found.overlaps_mm)


def test_active_set_solves_like_non_negative_least_squares():
    rng = np.random.default_rng(3)
    for _ in range(20):
        A = rng.normal(size=(30, 30))
        C, d = A @ A.T + np.eye(30), rng.normal(size=30)
        upper = np.linalg.cholesky(C).T
        expected = nnls(upper, np.linalg.solve(upper.T, d))[0] > 0.0
        for steps in (40, 0):
            np.testing.assert_array_equal(active_set(C, d, most_steps=steps), expected)


def test_jacobian_is_that_of_differences(knee_model, pressed_pose):
    h = 1e-6
    wrenches, jacobian = knee_model.wrench_jacobian(pressed_pose)
    moved = knee_model.wrenches(pressed_pose + h * np.vstack([np.eye(6), -np.eye(6)]))
    differences = np.moveaxis(moved[:6] - moved[6:], 0, -1) / (2.0 * h)
    np.testing.assert_allclose(jacobian, differences, atol=1e-6 * abs(jacobian).max())
    np.testing.assert_allclose(wrenches, knee_model.wrenches(pressed_pose))
    assert (wrenches[:, 1] < -50.0).all()


def test_mirrored_pose_has_mirrored_loads(knee_model, pressed_pose):
    mirrored = pressed_pose * [1, 1, -1, -1, -1, 1]
    sign = np.array([1, 1, -1, -1, -1, 1])
    wrenches = knee_model.wrenches(pressed_pose)
    np.testing.assert_allclose(knee_model.wrenches(mirrored)[::-1] * sign, wrenches, atol=1e-6 * abs(wrenches).max())


def test_orders_meet_as_elements_get_smaller():
    scene = cc.load_scene("sphere_on_plane").with_overrides(poissons_ratio=0.3)
    pose = np.array([0.0, 29.4, 0.0, 0.0, 0.0, 0.0])

    model = FiniteElements(scene, (25, 25))
    fine = -model.wrenches(pose)[0, 1]
    record = model.convergence(pose[None])
    assert 0.0 < record["rms"]["Fy"] < 0.03 * fine
    assert record["against"] == "FE 17×17"
    linear = [FiniteElements(scene, (nodes, nodes), Hexahedra(layers, 1)) for nodes, layers in ((7, 1), (25, 5))]
    errors = [abs(-each.wrenches(pose)[0, 1] / fine - 1.0) for each in linear]
    assert errors[1] < 0.015 < errors[0]


def test_forces_along_a_line_have_little_noise():
    """N^⅔ is nearly linear in the depth; nodes, 1 mm apart, come into contact one by one."""
    scene = cc.load_scene("sphere_on_plane").with_overrides(poissons_ratio=0.3, patch_side=25.0)
    poses = np.zeros((100, 6))
    poses[:, 1] = np.linspace(29.7, 29.95, 100)
    force_n = -FiniteElements(scene, (25, 25)).wrenches(poses)[:, 0, 1]
    smooth = np.polynomial.Polynomial.fit(poses[:, 1], force_n ** (2 / 3), 4)(poses[:, 1]) ** 1.5
    assert force_n.min() > 40.0
    assert np.sqrt(np.mean((smooth / force_n - 1.0) ** 2)) < 0.02


@pytest.mark.parametrize(("depth", "aside", "force"), [(0.3, 0.0, 914.8), (0.15, 0.0, 284.3), (0.3, 3.0, 910.2)])
def test_an_independent_solver_finds_the_same_force(depth, aside, force):
    """CalculiX 2.20: 36×36×8 elements C3D8I (smaller in the middle) of 24×24×8 mm, rigid sphere, node to surface."""
    scene = cc.load_scene("sphere_on_plane").with_overrides(poissons_ratio=0.3, patch_side=25.0)
    model = FiniteElements(scene, (25, 25))
    assert -model.wrenches(np.array([aside, 30.0 - depth, 0, 0, 0, 0]))[0, 1] == pytest.approx(force, rel=0.02)


def test_elements_under_a_sharp_bend_stay_upright():
    """Of a surface bent to a radius of 0.6 mm, above a back 2 mm below: normals there would meet above the back."""
    points, _, present = flat_grid(np.linspace(-4.0, 4.0, 17))
    points[..., 1] = 0.8 * np.cos(1.5 * points[..., 0])
    normals = np.stack([1.2 * np.sin(1.5 * points[..., 0]), np.ones(present.shape), np.zeros(present.shape)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    layer = Layer.of(points, normals, present, Material(10.0, 0.3, 2.0), Hexahedra(1))
    assert np.linalg.eigvalsh(layer.compliance).min() > 0.0
    assert layer.areas_mm2.sum() > 8.0**2


def test_out_of_contact_nothing_is_borne(knee_model, pressed_pose):
    lifted = pressed_pose + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    assert not knee_model.wrenches(lifted).any()
    assert not knee_model.wrench_jacobian(lifted)[1].any()
    assert (knee_model.gaps(lifted) > 0.0).all()
    assert (knee_model.root_loads(lifted)[0] < 0.0).all()


def test_kept_compliance_that_is_damaged_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setenv("CASADI_CONTACT_CACHE", str(tmp_path))
    made = Layer.of(*flat_grid(np.arange(5.0)), Material(10.0, 0.3, 2.0), Hexahedra(1))
    (kept,) = tmp_path.iterdir()
    content = bytearray(kept.read_bytes())
    content[-100] ^= 1
    kept.write_bytes(content)
    again = Layer.of(*flat_grid(np.arange(5.0)), Material(10.0, 0.3, 2.0), Hexahedra(1))
    np.testing.assert_array_equal(again.compliance, made.compliance)
    assert kept.read_bytes() != bytes(content)


@pytest.mark.parametrize("values", [{"layers": 0}, {"order": 3}, {"grading": 0.0}])
def test_meshes_that_cannot_be(values):
    with pytest.raises(ValueError, match="expected"):
        Hexahedra(**values)


def test_samples_of_finite_elements_settle_on_springs_that_carry_about_as_much(monkeypatch):
    """What is learned from such samples is verified on finite elements."""
    scene = cc.load_scene("sphere_on_plane", coarse=(12, 12))
    springs, teacher = MODELS["finite-elements"](scene, SamplingSettings.from_scene(scene))
    starts = np.array([[0.0, 29.9, 0.0, 0, 0, 0], [2.0, 29.8, -3.0, 0, 0, 0]])
    poses, report = cc.settle(springs, starts, ("ty",), {"Fy": -300.0})
    assert report.converged.all()
    np.testing.assert_allclose(teacher.wrenches(poses)[:, 0, 1], -300.0, rtol=0.3)
    learned = cc.OnFoundation(scene, [], {"drawn_from": "finite-elements"})
    assert repr(reference_model(learned)) == repr(teacher)
    monkeypatch.setitem(sys.modules, "skfem", None)
    for name in ("layer", "model"):
        monkeypatch.delitem(sys.modules, f"casadi_contact.contact.finite_elements.{name}")
    assert "pip install casadi_contact[fem]" in reference_model(learned)
