"""Polar quadrature: the rim, the choice of rays, bodies tilted, shifted and lifted off, close fits with two spots."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.convergence import NotGoodEnoughError
from casadi_contact.contact.polar import quadrature
from casadi_contact.contact.polar.foundation import RayChoice, fraction_in_disagreement, polar_foundation, pressed_poses
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.polar.peak import nearest
from casadi_contact.contact.polar.surfaces import u_range
from casadi_contact.core.conventions import rotation
from tests.support.agreement import check_hessians, check_jacobian, check_same_formulas
from tests.support.compiler import needs_compiler
from tests.support.ready_poses import at

RAYS, FINE = Rays(16, 3), Rays(32, 4)
TILT_RAD = np.pi / 4.0
# Least and largest place, with flexion of the knee apart: its condyles end where a tilted and deeply flexed one would
# touch with its back side.
REACH = {
    "knee": ([-15.0, 27.0, -8.0], [20.0, 27.0, 8.0], (-1.7, 0.3)),
    "patellofemoral": ([-50.0, -20.0, -10.0], [-50.0, 20.0, 10.0], (-TILT_RAD, TILT_RAD)),
    "sphere_in_dish": ([-16.0, 30.0, -16.0], [16.0, 30.0, 16.0], (-TILT_RAD, TILT_RAD)),
    "sphere_on_plane": ([-16.0, 30.0, -16.0], [16.0, 30.0, 16.0], (-TILT_RAD, TILT_RAD)),
}
# A button turned by 40° that hovers or presses the medial facet's rim with some 20 N and 3.5 kN; then off the groove's
# upper end, where the nearest point lies on the curved rim.
BUTTON = [
    [-46.685, 24.075, 6.247, 0.241, 0.64, -0.483],
    [-46.252, 23.066, 6.205, 0.233, 0.634, -0.475],
    [-45.78, 22.028, 6.219, 0.226, 0.629, -0.468],
    [-42.5, 35.5, -2.2, 0.22, -0.13, -0.19],
]
KNEES = [  # pressed on one rim of the insert, the other condyle up to 23 mm off
    [0.304, 41.172, -6.958, 0.443, -0.662, -0.515],
    [12.461, 41.139, 3.285, -0.281, -0.488, -1.054],
    [4.407, 38.828, -6.564, 0.472, -0.44, -1.591],
    [12.75, 47.107, -7.004, -0.774, -0.504, 0.109],
]


def off_elements(fine, model, poses):
    """Forces of a fine element grid (n, patches) [N], and by how much a model's are off."""
    wanted = fine.wrenches(poses)[..., :3]
    return np.linalg.norm(wanted, axis=-1), np.linalg.norm(model.wrenches(poses)[..., :3] - wanted, axis=-1)


def far_poses(name, elements, count, seed=4):
    """Poses (count, 6) within `REACH` whose least gap lies between -1.2 and 1 mm, a tenth of them up to 25 mm off."""
    random = np.random.default_rng(seed)
    low, high, flexion = REACH[name]
    poses = np.empty((count, 6))
    poses[:, :3] = random.uniform(low, high, (count, 3))
    poses[:, 3:5] = random.uniform(-TILT_RAD, TILT_RAD, (count, 2))
    poses[:, 5] = random.uniform(*flexion, count)
    wanted = random.uniform(-1.2, 1.0, count)
    wanted[: count // 10] = random.uniform(3.0, 25.0, count // 10)
    column, away = (0, -1.0) if name == "patellofemoral" else (1, 1.0)
    below, above = np.full(count, -40.0), np.full(count, 60.0)
    start = poses[:, column].copy()
    for _ in range(20):
        lift = 0.5 * (below + above)
        poses[:, column] = start + away * lift
        touching = elements.gaps(poses).min(axis=1) < wanted
        below, above = np.where(touching, lift, below), np.where(touching, above, lift)
    return poses


@pytest.mark.parametrize("name", REACH)
def test_contact_is_found_wherever_elements_find_it(name):
    """The patch holds its elements: its gap is no larger than theirs, smaller by half an element at most."""
    model = cc.PolarFoundation(cc.load_scene(name), FINE, compiled=False)
    elements = cc.ElasticFoundation(model.scene, (120, 80))
    poses = far_poses(name, cc.ElasticFoundation(model.scene, (24, 16)), 60)
    theirs, ours = elements.gaps(poses), model.gaps(poses)
    half = max(0.75 * np.sqrt(2.0 * grid.areas_mm2.max()) for grid in model.scene.elements(elements.grid))
    assert (ours <= theirs + 1e-9).all()
    assert (ours >= theirs - half).all()
    fine = cc.ElasticFoundation(model.scene, (400, 300))  # a spot along the rim is thin
    force, missed = off_elements(fine, model, poses)
    at_edge = model.at_edge(poses)
    assert (force > 0.0).sum() > 15
    assert (missed[~at_edge] <= 5e-3 * (force[~at_edge] + 20.0)).all()
    assert (missed[at_edge] <= 0.03 * (force[at_edge] + 20.0)).all()


@needs_compiler
def test_c_and_numpy_are_the_same_formulas_far_off_too():
    for name, poses in [("patellofemoral", BUTTON), ("knee", KNEES)]:
        scene = cc.load_scene(name)
        compiled, plain = (cc.PolarFoundation(scene, RAYS, compiled=c) for c in (True, False))
        check_same_formulas(compiled, plain, np.array(poses))


@needs_compiler
@pytest.mark.parametrize(
    ("radii_mm", "junctions_deg"),
    [
        ([45.0, 20.0, 45.0, 20.0], [8.0, 14.0, 20.0]),
        ([50.0, 40.0, 33.0, 27.0, 22.0, 18.0], [0.0, 10.0, 18.0, 30.0, 55.0]),
        ([30.0], []),
    ],
)
def test_condyles_of_any_arcs_agree_with_a_fine_element_grid(radii_mm, junctions_deg):
    """Several junctions in one spot, of arcs that turn flatter or rounder; in C as in NumPy."""
    scene = cc.load_scene("knee", sagittal_radii=radii_mm, sagittal_junctions_deg=junctions_deg)
    compiled, plain = (cc.PolarFoundation(scene, Rays(8, 3), compiled=c) for c in (True, False))
    poses = pressed_poses(plain.patches[0], plain.law, (20.0, 2500.0), 60)
    np.testing.assert_allclose(compiled.wrenches(poses), plain.wrenches(poses), rtol=1e-7, atol=1e-4)
    force, off = off_elements(cc.ElasticFoundation(scene, (320, 160)), compiled, poses)
    assert (off[:, 0] <= 4e-3 * force[:, 0] + 0.1).all()


@needs_compiler
def test_the_gap_s_derivatives_hold_where_the_nearest_point_slides_along_a_curved_rim():
    model = cc.PolarFoundation(cc.load_scene("patellofemoral"), RAYS)
    poses = np.array([BUTTON[0], BUTTON[3]])
    assert (model.gaps(poses) > 0.0).all()
    (facet, _), (_, _, _, beyond) = model.patches, BUTTON
    R, t = facet.turn @ rotation([beyond[3:]]), np.array([beyond[:3]]) @ facet.turn.T
    point = nearest(facet, R, t, np.array([0.0]), np.array([12.0]))
    assert point.u == pytest.approx(u_range(facet, point.v)[1])
    assert facet.rim.v[0] + 1.0 < point.v < facet.rim.v[1] - 1.0
    check_jacobian(model, poses, 1e-4)
    check_hessians(model, poses)


def test_the_rim_cuts_off_what_lies_beyond_it():
    """Half a ball's spot on a plane's edge carries half its force; a spot beyond the edge nothing."""
    model = cc.PolarFoundation(cc.load_scene("sphere_on_plane"), Rays(48, 4), compiled=False)
    whole, half, beyond = model(np.vstack([at(29.8), at(29.8, tx=12.0), at(29.8, tx=16.0)]))
    assert half[1] == pytest.approx(0.5 * whole[1], rel=2e-3)
    assert not beyond.any()
    np.testing.assert_array_equal(model.at_edge(np.vstack([at(29.8), at(29.8, tx=12.0)]))[:, 0], [False, True])


def test_more_rays_converge_and_the_choice_meets_the_tolerances_with_the_fewest():
    choice = RayChoice(poses=64, elements=(160, 80), poses_on_elements=16)
    model = polar_foundation(cc.load_scene("knee"), compiled=False, choice=choice)
    record = model.record
    assert (model.rays.count, model.rays.points) == (record["rays"], record["points"])
    assert (record["against"], record["elements_apart"]) == ("96 rays × 6 points, EF 160×80", 0.0)
    for name, tolerance in model.scene.tolerances.items():
        assert max(record["rms"][name], record["largest"][name] / 3.0) <= tolerance


def test_a_spot_as_wide_as_its_dish_is_deep_has_the_force_of_elements():
    """Where a femur fits its dish closely, estimated ends of a spot lie past the upright wall of the dish's circle."""
    scene = cc.load_scene("knee", dish_sagittal_radius=43.0, dish_frontal_radius=24.0)
    model = cc.PolarFoundation(scene, Rays(16, 3), compiled=False)
    poses = pressed_poses(model.patches[0], model.law, (5.0, 2500.0), 80)
    wanted = cc.ElasticFoundation(scene, grid=(160, 80))
    force, off = (each[:, 0] for each in off_elements(wanted, model, poses))
    share = (off / force)[(force > 20.0) & ~wanted.at_edge(poses)[:, 0]]
    assert len(share) > 25
    assert np.median(share) < 1e-3
    assert share.max() < 0.05


FITS_MM = [(58.0, 23.0), (41.0, 25.0)]  # condyles: 38.9 to 17.9 and 22 mm


def fitting(sagittal_mm, frontal_mm):
    return cc.load_scene("knee", dish_sagittal_radius=sagittal_mm, dish_frontal_radius=frontal_mm)


def on_both_ends(scene):
    """Poses of a turned femur, lowered until its dishes carry 50 to 800 N a side on elements."""
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


def one_spot_only(patch, R, t, m):
    return m, np.zeros(len(t), dtype=bool)


@pytest.fixture(scope="module")
def pressed():
    """A knee of a close fit, and poses that press one spot of its medial dish within the rim."""
    model = cc.PolarFoundation(fitting(41.0, 23.0), Rays(24, 3), compiled=False)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(quadrature, "second_peak", one_spot_only)
        return model, pressed_poses(model.patches[0], model.law, (20.0, 2500.0), 240)


@pytest.mark.parametrize("fit_mm", FITS_MM)
def test_a_femur_turned_in_closely_fitting_dishes_has_the_loads_of_elements(fit_mm):
    """Most of these contacts reach the rim, some in two places."""
    scene = fitting(*fit_mm)
    poses = on_both_ends(scene)
    model, fine = cc.PolarFoundation(scene, Rays(16, 3), compiled=False), cc.ElasticFoundation(scene, (320, 160))
    force, off = off_elements(fine, model, poses)
    assert model.at_edge(poses).mean() > 0.2
    assert np.median(off / force) < 5e-3
    assert (off <= 0.08 * force + 1.0).all()


def test_what_bears_on_the_rim_beside_a_spot_within_it_counts(pressed):
    model, poses = pressed
    fine = cc.ElasticFoundation(model.scene, (320, 160))
    force, off = (each[:, 0] for each in off_elements(fine, model, poses))
    seen = -fine.gaps(poses)[:, 0] < 1.0  # else the condyle's back lies in the dish
    beside = seen & model.at_edge(poses)[:, 0]
    assert beside.sum() > 5
    assert np.median(off[beside] / force[beside]) < 0.01
    assert (off[seen] > 0.05 * force[seen] + 1.0).mean() < 0.03


@needs_compiler
def test_c_and_numpy_are_the_same_formulas_with_two_spots(pressed):
    model, poses = pressed
    two = poses[model.at_edge(poses)[:, 0]][:4]
    assert len(two) == 4
    compiled, turned = cc.PolarFoundation(model.scene, model.rays), on_both_ends(model.scene)
    check_same_formulas(compiled, model, two)
    np.testing.assert_allclose(compiled.wrenches(turned), model.wrenches(turned), rtol=1e-7, atol=1e-4)


def test_elements_tell_where_rays_miss_a_spot(pressed, monkeypatch):
    """More rays see no more of a spot that none of them looks for."""
    model, poses = pressed
    monkeypatch.setattr(quadrature, "second_peak", one_spot_only)
    wrench = model.wrenches(poses)[:, 0]
    with pytest.raises(NotGoodEnoughError, match=r"rays and 320×160 elements differ .* \d\d% of .*ElasticFoundation"):
        fraction_in_disagreement(model.scene, [(poses, wrench)], RayChoice())
