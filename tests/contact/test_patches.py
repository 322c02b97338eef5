"""Patches that are pressed along directions of their own."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.contact_frames import ContactFrames
from tests.support.meshes import RADIUS_MM, force_n, mesh_scene_text, write_corner

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
