"""Rays on flat triangles reproduce the stored output of another program, OpenSim JAM, on real cartilage meshes."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.opensim import femur_in_insert
from casadi_contact.scenes.scene import Scene
from tests.support.meshes import mesh_scene_text
from tests.support.shared_data import shared_file

JAM_MATERIAL = {"youngs_modulus": 10.0, "poissons_ratio": 0.45, "thickness": 6.0, "law": '"linear"'}


TURN = np.array([-1.0, 1.0, -1.0])  # about y: from JAM's axes into those of an insert


def jam_poses(stored):
    """The femur in the insert from JAM's tibia in the femur."""
    names = ("knee_tx_r_m", "knee_ty_r_m", "knee_tz_r_m", "knee_add_r_rad", "knee_rot_r_rad", "knee_flex_r_rad")
    return femur_in_insert(np.stack([stored[name] for name in names], axis=1) * np.repeat([1000.0, 1.0], 3))


def jam_scene(folder, **options):
    """Of the two cartilage meshes, as one patch."""
    femur, tibia = (shared_file(f"data/jam/{name}") for name in ("femur_cartilage.obj", "tibia_cartilage.stl"))
    path = folder / "jam.toml"
    lines = 'axes = ["-x", "y", "-z"]'
    path.write_text(mesh_scene_text(femur, tibia, units="m", material=JAM_MATERIAL, extra=lines, **options))
    return cc.load_scene(path)


@pytest.fixture(scope="module")
def jam(tmp_path_factory):
    """The scene with triangles as elements, and the stored output."""
    stored = np.genfromtxt(shared_file("data/jam/passive_flexion_tf.csv"), delimiter=",", names=True)
    return jam_scene(tmp_path_factory.mktemp("jam"), elements="triangles"), stored


def vectors(stored, name, scale):
    return scale * TURN * np.stack([stored[f"{name}_{axis}"] for axis in "xyz"], axis=1)


def test_all_frames_of_another_program_are_reproduced(jam):
    scene, stored = jam
    model, poses = cc.RayCastFoundation(scene), jam_poses(stored)
    wrenches, summary = model.wrenches(poses)[:, 0], model.summary(poses)
    differences = {  # quantity: largest difference, tolerance
        "force [N]": (wrenches[:, :3] - vectors(stored, "contact_force", 1.0), 1e-3),
        "moment [N·mm]": (wrenches[:, 3:] + vectors(stored, "contact_moment", 1000.0), 0.02),
        "area [mm²]": (summary.area_mm2[:, 0] - 1e6 * stored["contact_area"], 0.01),
        "mean pressure [MPa]": (summary.mean_mpa[:, 0] - 1e-6 * stored["mean_pressure"], 1e-5),
        "largest pressure [MPa]": (summary.largest_mpa[:, 0] - 1e-6 * stored["max_pressure"], 1e-4),
        "centre of pressure [mm]": (summary.centre_mm[:, 0] - vectors(stored, "center_of_pressure", 1000.0), 1e-4),
    }
    assert len(wrenches) == 251
    for name, (difference, tolerance) in differences.items():
        assert np.abs(difference).max() < tolerance, name


def test_on_cartilage_the_smooth_surface_agrees_with_flat_triangles_where_overlap_is_deep(jam):
    """Cartilage overlaps by up to 1.2 mm, where what facets cut off hardly matters: it is 0.8 to 1.9 % of the force."""
    scene, stored = jam
    poses = jam_poses(stored)[::25]
    flat = cc.RayCastFoundation(scene).wrenches(poses)[:, 0, :3]
    smooth = cc.ElasticFoundation(scene).wrenches(poses)[:, 0, :3]
    excess = np.linalg.norm(smooth, axis=1) / np.linalg.norm(flat, axis=1) - 1.0
    assert 0.005 < excess.min() < excess.max() < 0.025
    assert (np.linalg.norm(smooth - flat, axis=1) / np.linalg.norm(flat, axis=1)).max() < 0.025


@pytest.mark.parametrize("kind", ["elements", "cells"])
def test_on_cartilage_areas_and_pressures_are_within_some_percent_of_jam_s(jam, tmp_path, kind):
    """JAM's mean counts triangles of all sizes alike, `summary` weighs them by area."""
    scene, stored = jam
    poses, stored = jam_poses(stored)[::25], stored[::25]
    if kind == "elements":
        model = cc.ElasticFoundation(scene)
        pressures = [model.pressure_maps(pose)[0].pressures_mpa for pose in poses]
        mean = np.array([p[p > 0.0].mean() for p in pressures])
    else:
        model = cc.CellFoundation(jam_scene(tmp_path), cc.Cells(1.2, 1.2), compiled=False)
        mean = model.summary(poses).mean_mpa[:, 0]
    found = model.summary(poses)
    for got, want, most in (
        (found.area_mm2[:, 0], 1e6 * stored["contact_area"], 0.022),
        (mean, 1e-6 * stored["mean_pressure"], 0.022),
        (found.largest_mpa[:, 0], 1e-6 * stored["max_pressure"], 0.03),
    ):
        assert np.abs(got / want - 1.0).max() < most
    np.testing.assert_allclose(found.centre_mm[:, 0], vectors(stored, "center_of_pressure", 1000.0), atol=0.1)


def test_a_layer_on_each_body_is_the_lumped_one_of_that_program(jam):
    scene, stored = jam
    half = {"youngs_modulus": 10.0, "poissons_ratio": 0.45, "thickness": 3.0}
    halves = Scene.from_tables({**scene.tables, "material": {**half, "law": "linear", "moving": half}})
    few = slice(0, len(stored), 25)
    wrenches = cc.RayCastFoundation(halves).wrenches(jam_poses(stored)[few])[:, 0]
    np.testing.assert_allclose(wrenches[:, :3], vectors(stored, "contact_force", 1.0)[few], atol=1e-3)
