"""Load at a sharp edge of the moving body, which its distance field rounds off, is told, and a finer field bears it."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.pressures import share_at_sharp_edges
from casadi_contact.optimisation.reference import unmodelled_load_words
from tests.support.meshes import STIFFNESS, ball_mesh, mesh_scene_text, sheet_mesh, wheel_mesh, write_obj

RADIUS, HALF_WIDTH = 12.0, 3.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sharp")
    write_obj(folder / "plate.obj", *sheet_mesh(16.0, 1.0))
    write_obj(folder / "wheel.obj", *wheel_mesh(RADIUS, HALF_WIDTH, 0.6))
    write_obj(folder / "ball.obj", *ball_mesh(RADIUS, 0.8))
    return folder


def model_of(folder, moving, spacing_mm):
    path = folder / f"{moving}.toml"
    spacing = f"spacing = {{moving = {spacing_mm}, fixed = 0.75}}"
    path.write_text(mesh_scene_text(folder / f"{moving}.obj", folder / "plate.obj", extra=spacing))
    return cc.ElasticFoundation(cc.load_scene(path), (200, 200))


def leaning(tilt, overlap):
    """The pose of a wheel that leans on its edge, and what the plate carries: (K/h) ∫ depth, over a grid of its own.

    Below a point of the plate the wheel ends on its tread or on its lower side, whichever comes first.
    """
    pose = np.array([0.0, RADIUS * np.cos(tilt) + HALF_WIDTH * np.sin(tilt) - overlap, 0.0, tilt, 0.0, 0.0])
    step = 0.01
    x, z = np.meshgrid(np.arange(-5.0, 5.0, step), np.arange(-8.0, 8.0, step), indexing="ij")
    along, up = z * np.cos(tilt) - pose[1] * np.sin(tilt), -z * np.sin(tilt) - pose[1] * np.cos(tilt)
    tread = up + np.sqrt(RADIUS**2 - x**2)  # above the lowest point of the tread, square to the axis
    depth = np.minimum(tread / np.cos(tilt), (HALF_WIDTH + np.sign(tilt) * along) / np.sin(abs(tilt)))
    return pose, STIFFNESS * step**2 * float(np.maximum(depth, 0.0).sum())


def test_where_an_edge_alone_bears_the_error_is_within_the_share_that_is_told_and_a_finer_field_mends_it(folder):
    cases = [leaning(tilt, overlap) for tilt, overlap in ((0.5, 0.25), (0.5, 0.4), (0.2, 0.8))]
    poses, wanted = zip(*cases, strict=True)
    errors, shares = [], []
    for spacing_mm in (0.75, 0.3):
        model = model_of(folder, "wheel", spacing_mm)
        errors.append(np.abs(-model(poses)[:, model.load_names.index("Fy")] / wanted - 1.0))
        shares.append(share_at_sharp_edges(model, poses))
    assert (errors[0] < shares[0] + 0.02).all()
    assert errors[0][:2].min() > 0.05
    assert (errors[1] < 0.3 * errors[0] + 0.01).all()
    assert (
        "in 3 of 3 frames up to 100% of the load lies at sharp edges"
        in unmodelled_load_words({"at_sharp_edges": shares[0]})["at_sharp_edges"]
    )


def test_a_ball_has_no_edges(folder):
    share = share_at_sharp_edges(model_of(folder, "ball", 0.75), [[0.0, RADIUS - 0.2, 0.0, 0.3, 0.2, 0.1]])
    np.testing.assert_array_equal(share, 0.0)
    assert unmodelled_load_words({"at_sharp_edges": share}) == {}
