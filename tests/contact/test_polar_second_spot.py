"""A femur that fits its dishes closely bears on their rims too: rays see both spots, or the choice tells."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from casadi_contact.contact.convergence import NotGoodEnoughError
from casadi_contact.contact.polar import quadrature
from casadi_contact.contact.polar.foundation import RayChoice, fraction_in_disagreement, pressed_poses
from casadi_contact.contact.polar.lines import Rays
from tests.support.agreement import check_same_formulas
from tests.support.compiler import needs_compiler

FITS_MM = [(58.0, 23.0), (41.0, 25.0)]  # condyles: 38.9 to 17.9 and 22 mm


def fitting(sagittal_mm, frontal_mm):
    return cc.load_scene("knee", dish_sagittal_radius=sagittal_mm, dish_frontal_radius=frontal_mm)


def on_both_ends(scene):
    """Poses of a femur turned by 3 to 10 degrees about the vertical in its dishes, shifted and flexed a little, lowered
    until the dishes carry 50 to 800 N a side on elements."""
    random = np.random.default_rng(2)
    n = 30
    poses = np.zeros((n, 6))
    poses[:, 0], poses[:, 1] = random.uniform(-8.0, 8.0, n), 27.8
    poses[:, 4] = np.deg2rad(random.uniform(3.0, 10.0, n)) * random.choice([-1.0, 1.0], n)
    poses[:, 5] = -random.uniform(0.0, 1.2, n)
    forces = -random.uniform(50.0, 800.0, (2, n))
    poses, report = cc.settle(
        cc.ElasticFoundation(scene, (80, 40)), poses, ("ty", "rx"), {"Fy_med": forces[0], "Fy_lat": forces[1]}
    )
    return poses[report.converged]


def as_poses(R, t):
    return np.column_stack([t, Rotation.from_matrix(R).as_euler("XYZ")])


def one_spot_only(patch, R, t, m):
    return m, np.zeros(len(t), dtype=bool)


@pytest.fixture(scope="module")
def pressed():
    """A knee of a close fit by polar quadrature, and rotations and translations that press one spot of its medial dish
    within the rim, whatever bears beside it."""
    model = cc.PolarFoundation(fitting(41.0, 23.0), Rays(24, 3), compiled=False)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(quadrature, "second_peak", one_spot_only)
        return model, *pressed_poses(model.patches[0], model.law, (20.0, 2500.0), 240)


@pytest.mark.parametrize("fit_mm", FITS_MM)
def test_a_femur_turned_in_closely_fitting_dishes_has_the_loads_of_elements(fit_mm):
    """Most of these contacts reach the rim, some in two places."""
    scene = fitting(*fit_mm)
    poses = on_both_ends(scene)
    model, fine = cc.PolarFoundation(scene, Rays(16, 3), compiled=False), cc.ElasticFoundation(scene, (320, 160))
    wanted, found = fine.wrenches(poses)[..., :3], model.wrenches(poses)[..., :3]
    force, off = (np.linalg.norm(f, axis=-1) for f in (wanted, found - wanted))
    assert model.at_edge(poses).mean() > 0.2
    assert np.median(off / force) < 5e-3
    assert (off <= 0.08 * force + 1.0).all()


def test_what_bears_on_the_rim_beside_a_spot_within_it_counts(pressed):
    model, R, t = pressed
    poses = as_poses(R, t)
    fine = cc.ElasticFoundation(model.scene, (320, 160))
    wanted, found = fine.wrenches(poses)[:, 0, :3], model.wrenches(poses)[:, 0, :3]
    force, off = (np.linalg.norm(f, axis=-1) for f in (wanted, found - wanted))
    seen = -fine.gaps(poses)[:, 0] < 1.0  # else the condyle's back lies in the dish
    beside = seen & model.at_edge(poses)[:, 0]
    assert beside.sum() > 5
    assert np.median(off[beside] / force[beside]) < 0.01
    assert (off[seen] > 0.05 * force[seen] + 1.0).mean() < 0.03


@needs_compiler
def test_c_and_numpy_are_the_same_formulas_with_two_spots(pressed):
    model, R, t = pressed
    poses = as_poses(R, t)
    two = poses[model.at_edge(poses)[:, 0]][:4]
    assert len(two) == 4
    check_same_formulas(cc.PolarFoundation(model.scene, model.rays), model, two)


def test_elements_tell_where_rays_miss_a_spot(pressed, monkeypatch):
    """More rays see no more of a spot that none of them looks for."""
    model, R, t = pressed
    monkeypatch.setattr(quadrature, "second_peak", one_spot_only)
    wrench = quadrature.patch_loads(model.patches[0], model.law, model.rays, R, t).wrench
    with pytest.raises(NotGoodEnoughError, match=r"rays and 320×160 elements differ .* \d\d% of .*ElasticFoundation"):
        fraction_in_disagreement(model.scene, [(R, t, wrench)], RayChoice())
