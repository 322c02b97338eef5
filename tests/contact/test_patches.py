"""Patches in parts, and patches that are pressed along directions of their own."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.networks.training.fit import fit_all
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.meshes import RADIUS_MM, cap_mesh, force_n, mesh_scene_text, scene_of, sheet_mesh, write_corner

BALL_MM = 30.0
TWO_PATCHES = """[geometry.patches.med]
z = [0.0, 7.0]
{med}
[geometry.patches.lat]
z = [-7.0, 0.0]
{lat}
"""


def ball_on_plate(folder, med="", lat="", **settings):
    folder.mkdir()
    moving, plate = cap_mesh(BALL_MM, 1.2, 0.45), sheet_mesh(14.0, 1.0)
    extra = TWO_PATCHES.format(med=med, lat=lat)
    return scene_of(folder, moving, plate, extra=extra, grid=(60, 30), **settings)


def poses_about(count, seed=0):
    """The ball's centre over the plate, from 0.2 mm overlap to 0.1 mm gap."""
    rng = np.random.default_rng(seed)
    poses = np.zeros((count, 6))
    poses[:, 0], poses[:, 2] = rng.uniform(-2.0, 2.0, (2, count))
    poses[:, 1] = BALL_MM + rng.uniform(-0.2, 0.1, count)
    return poses


@pytest.mark.parametrize("elements", ["grid", "triangles"])
def test_a_cut_moves_no_force_and_no_gap(tmp_path, elements):
    whole = cc.ElasticFoundation(ball_on_plate(tmp_path / "whole", elements=elements))
    scene = ball_on_plate(tmp_path / "cut", med="split_z = [1.0, 2.5]", lat="split_z = [-1.0]", elements=elements)
    cut, poses = cc.ElasticFoundation(scene), poses_about(40)
    assert cut.patch_names == whole.patch_names == ("med", "lat")
    assert [part.name for part in scene.parts] == ["med_1", "med_2", "med_3", "lat_1", "lat_2"]
    parts = cut.part_wrenches(poses)
    assert (parts[:, :, 1] < 0.0).any(axis=0).all(), "each part is loaded somewhere"
    np.testing.assert_allclose(parts[:, :3].sum(axis=1), whole.wrenches(poses)[:, 0], rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(parts[:, 3:].sum(axis=1), whole.wrenches(poses)[:, 1], rtol=1e-10, atol=1e-8)
    gaps, of_parts = whole.gaps(poses), cut.part_gaps(poses)
    np.testing.assert_allclose(of_parts[:, :3].min(axis=1), gaps[:, 0], rtol=1e-10)
    np.testing.assert_allclose(of_parts[:, 3:].min(axis=1), gaps[:, 1], rtol=1e-10)
    for got, want in zip(cut.jacobian(poses), whole.jacobian(poses), strict=True):
        np.testing.assert_array_equal(got, want)


def test_cells_tell_parts_apart_as_elements_do(tmp_path):
    """Where elements lie on one side of a cut or the other, cells end at it: fine elements come near."""
    scene = ball_on_plate(tmp_path / "cut", med="split_z = [1.0, 2.5]", lat="split_z = [-1.0]")
    cells, poses = CellFoundation(scene, Cells(0.5, 0.5), compiled=False), poses_about(8)
    parts = cells.part_wrenches(poses)
    fine = cc.ElasticFoundation(scene, (240, 250))
    size = np.repeat([np.abs(parts[..., :3]).max(), np.abs(parts[..., 3:]).max()], 3)
    np.testing.assert_allclose(parts / size, fine.part_wrenches(poses) / size, rtol=0.0, atol=0.02)
    whole = np.stack([parts[:, :3].sum(axis=1), parts[:, 3:].sum(axis=1)], axis=1)
    np.testing.assert_allclose(whole / size, cells.wrenches(poses) / size, rtol=0.0, atol=0.005)
    gaps = fine.part_gaps(poses)
    free = gaps > 0.0
    assert free.any()
    np.testing.assert_allclose(cells.part_gaps(poses)[free], gaps[free], atol=0.02)


def test_networks_of_parts_give_the_loads_of_their_patches(tmp_path):
    scene = ball_on_plate(tmp_path / "cut", med="split_z = [1.5]")
    model, poses = cc.ElasticFoundation(scene), poses_about(1500, seed=1)
    role, domain = np.full(len(poses), TRAIN, dtype=np.uint8), np.ones(len(poses), dtype=np.uint8)
    role[::10], role[5::10] = VALIDATION, TEST
    samples = Samples(scene, poses, model.part_wrenches(poses), model.part_gaps(poses), domain, role)
    np.testing.assert_allclose(samples.loads(), model(poses), rtol=1e-10, atol=1e-8)
    regressions = PatchSurrogate.regressions(samples)
    settings = TrainingSettings(sizes=((8, 8),), max_iterations=60)
    fits = fit_all(regressions, dict.fromkeys([regression.name for regression in regressions], settings))
    assert {"root_med_1", "root_med_2", "root_lat", "ratios_med_2"} <= set(fits)
    surrogate = PatchSurrogate(scene, {name: fit.network for name, fit in fits.items()})
    test = samples.select(role=TEST)
    error = np.sqrt(np.mean((surrogate(test.poses) - test.loads()) ** 2, axis=0))
    assert error[1] < 0.02 * np.abs(test.loads()[:, 1]).max(), error
    np.testing.assert_allclose(surrogate.wrenches(test.poses).sum(axis=1)[:, 1], surrogate(test.poses)[:, 1])
    normal = -surrogate.wrenches(test.poses)[:, :, 1]
    roots = surrogate.root_loads(test.poses)[0]
    np.testing.assert_allclose(normal, scene.reference_load * np.maximum(roots, 0.0) ** 2, rtol=1e-9, atol=1e-9)
    surrogate.save(tmp_path / "parts.h5")
    again = cc.load_surrogate(tmp_path / "parts.h5")
    np.testing.assert_array_equal(again(test.poses), surrogate(test.poses))
    np.testing.assert_allclose(np.asarray(again.root_function()(test.poses[3])).ravel(), roots[3], rtol=1e-12)


FLOOR = "[geometry.patches.floor]\nx = [0.0, 30.0]\n"
WALL = "[geometry.patches.wall]\nx = [-0.5, 0.5]\ny = [0.5, 16.0]\npressing = [-1.0, 0.0, 0.0]\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_corner(tmp_path_factory.mktemp("wall_patch"))


def corner_scene(folder, wall=WALL):
    path = folder / "corner.toml"
    text = mesh_scene_text(folder / "ball.obj", folder / "post.obj", extra=FLOOR + wall, grid=(160, 160))
    text = text.replace('sensitive_pose = ["ty"]', 'sensitive_pose = ["ty", "tx"]')
    path.write_text(text.replace('sensitive = ["Fy"]', 'sensitive = ["-Fy_floor", "-Fx_wall"]'))
    return cc.load_scene(path)


@pytest.fixture(scope="module", params=["cells", "elements"])
def model(request, folder):
    return {"cells": cc.CellFoundation, "elements": cc.ElasticFoundation}[request.param](corner_scene(folder))


def corner(on_wall_mm, on_floor_mm):
    """The ball as deep in the wall and in the floor."""
    return np.array([RADIUS_MM - on_wall_mm, RADIUS_MM - on_floor_mm, 2.0, 0.0, 0.0, 0.0])


def test_a_ball_in_the_corner_is_carried_by_floor_and_wall_as_by_two_planes(model):
    on_wall, on_floor = 0.2, 0.3
    pose = corner(on_wall, on_floor)
    floor, wall = model.wrenches(pose)
    for wrench, direction, overlap in ((floor, [0.0, -1.0, 0.0], on_floor), (wall, [-1.0, 0.0, 0.0], on_wall)):
        force = force_n(overlap) * np.array(direction)
        np.testing.assert_allclose(wrench[:3], force, atol=0.02 * force_n(overlap))
        np.testing.assert_allclose(wrench[3:], np.cross(pose[:3], force), atol=0.02 * force_n(overlap) * RADIUS_MM)
    np.testing.assert_allclose(model.gaps(corner(-1.5, -0.5)), [0.5, 1.5], atol=0.02)  # cells: of the nearest corner


def test_ipopt_finds_the_pose_that_presses_both(model):
    frames = ContactFrames(model, 1, locked={"tz": 2.0, "rx": 0.0, "ry": 0.0, "rz": 0.0})
    wanted = {"Fy_floor": -force_n(0.3), "Fx_wall": -force_n(0.2)}
    misfit = frames.misfit(wanted)
    solver = ca.nlpsol("solver", "ipopt", {"x": ca.vec(frames.q), "f": ca.sumsqr(misfit)}, {"ipopt.print_level": 0})
    found = solver(x0=frames.variables(np.array([corner(-2.0, -3.0)])))
    assert solver.stats()["success"]
    pose = frames.poses_with(np.array([corner(0.0, 0.0)]), found["x"])[0]
    np.testing.assert_allclose(pose[:2], corner(0.2, 0.3)[:2], atol=0.005)


def test_patches_seen_from_different_sides_share_what_both_see_alone(folder):
    oblique = WALL.replace("[-1.0, 0.0, 0.0]", "[-1.0, -1.0, 0.0]").replace("0.5, 16", "-0.5, 16")
    with pytest.raises(ValueError, match=r"floor and wall share .* which would carry load twice"):
        cc.ElasticFoundation(corner_scene(folder, oblique))
