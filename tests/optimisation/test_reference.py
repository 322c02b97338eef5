"""Load on walls too steep for elements, outside of all patches and beyond open edges is told, as large as it is."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.reference import (
    off_finer,
    share_beyond_open_edges,
    share_on_walls,
    share_outside_patches,
    unmodelled_fraction,
    unmodelled_load_words,
)
from casadi_contact.optimisation.verification import UNCOUNTED
from tests.support.meshes import (
    RADIUS_MM,
    STIFFNESS,
    ball_mesh,
    cap_mesh,
    force_n,
    ground_scene_text,
    mesh_scene_text,
    sheet_mesh,
    wheel_mesh,
    write_corner,
    write_obj,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_corner(tmp_path_factory.mktemp("walls"))


def model_of(folder, elements="grid", extra=""):
    path = folder / f"{elements}.toml"
    path.write_text(mesh_scene_text(folder / "ball.obj", folder / "post.obj", elements=elements, extra=extra))
    return cc.ElasticFoundation(cc.load_scene(path), (160, 160))


def words_of(where, share):
    return unmodelled_load_words({where: share}).get(where)


def test_a_ball_pressed_into_the_corner_of_floor_and_wall_bears_on_both_as_on_two_planes(folder):
    model = model_of(folder)
    floor, both, wall = (
        [RADIUS_MM - on_wall, RADIUS_MM - on_floor, 0.0, 0.0, 0.0, 0.0]
        for on_wall, on_floor in ((-3.0, 0.2), (0.2, 0.3), (0.3, -0.5))
    )
    share = share_on_walls(model, np.array([floor, both, wall]))
    assert share[0] == 0.0
    assert share[1] == pytest.approx(force_n(0.2) / (force_n(0.2) + force_n(0.3)), rel=0.05)
    assert share[2] == 1.0
    np.testing.assert_allclose(model.wrenches(wall), 0.0, atol=1e-9)  # and so nothing else tells it
    assert not model.at_edge(wall).any()
    np.testing.assert_array_equal(share_on_walls(model_of(folder, "triangles"), [wall]), 0.0)
    assert "in 2 of 3 frames up to 100%" in words_of("on_walls", share)


def test_a_cup_centre_on_the_axis_of_a_notch_counts_what_its_walls_carry(tmp_path):
    """A roller pressed sideways into a half-pipe: N = (K/h) L R ∫ (e cos φ - c) cos φ dφ for a clearance c, a way e."""
    radius, clearance, way, width = 20.0, 0.4, 0.45, 10.0
    points, faces = sheet_mesh(2.0, 0.05)
    angle = 1.9 * points[:, 0]
    pipe = np.stack([radius * np.sin(angle), -radius * np.cos(angle), 8.0 * points[:, 2]], axis=1)
    write_obj(tmp_path / "pipe.obj", pipe, faces)
    write_obj(tmp_path / "roller.obj", *wheel_mesh(radius - clearance, 0.5 * width, 1.0))
    pose = np.array([way * np.sin(1.2), -way * np.cos(1.2), 0.0, 0.0, 0.0, 0.0])
    reach = np.arccos(clearance / way)
    integral = way * (reach + 0.5 * np.sin(2.0 * reach)) - 2.0 * clearance * np.sin(reach)
    found = {}
    for key in ("", "cup_centre = [0.0, 0.0, 0.0]"):
        (tmp_path / "notch.toml").write_text(mesh_scene_text("roller.obj", "pipe.obj", extra=key))
        model = cc.ElasticFoundation(cc.load_scene(tmp_path / "notch.toml"), (120, 40))
        force = float(np.linalg.norm(model.wrenches(pose)[0, :3]))
        found[key] = (
            force / (STIFFNESS * width * radius * integral),
            words_of("on_walls", share_on_walls(model, [pose])),
        )
    (lost, told), (whole, nothing) = found.values()
    assert lost < 0.8
    assert "geometry.cup_centre" in told
    assert whole == pytest.approx(1.0, abs=0.04)
    assert nothing is None


@pytest.mark.parametrize("elements", ["grid", "triangles"])
def test_a_ball_beside_the_patch_bears_on_the_rest_of_the_mesh_all_of_its_load(folder, elements):
    model = model_of(folder, elements, "[geometry.patches.contact]\nx = [15.0, 30.0]\n")
    inside, half, beside, wall = ([x, y, 0.0, 0.0, 0.0, 0.0] for x, y in ((22, 7.7), (15, 7.7), (8.5, 7.7), (7.7, 8.5)))
    share = share_outside_patches(model, np.array([inside, half, beside, wall]))
    np.testing.assert_array_equal(share[[0, 2, 3]], [0.0, 1.0, 1.0])
    if elements == "grid":  # a triangle of the floor belongs to a patch or to none, whole
        assert share[1] == pytest.approx(0.5, abs=0.03)
    np.testing.assert_allclose(model.wrenches([beside, wall]), 0.0, atol=1e-9)  # and so nothing else tells it
    assert "up to 100% of the load lies on the fixed mesh outside of all patches" in words_of("outside_patches", share)


def test_what_walls_and_the_rest_of_the_mesh_carry_counts_together(folder):
    """4 % of the load on the wall and 3 % beside the patch are 7 % that no model counts: too much to be verified."""
    model = model_of(folder, extra="[geometry.patches.contact]\nz = [-1.5, 30.0]\n")
    pose = np.array([[RADIUS_MM - 0.06, RADIUS_MM - 0.3, 0.0, 0.0, 0.0, 0.0]])
    counted = float(model.pressure_maps(pose[0])[0].forces_n.sum())
    walls, outside = (share(model, pose)[0] for share in (share_on_walls, share_outside_patches))
    assert max(walls, outside) < UNCOUNTED
    lost = counted * (walls / (1.0 - walls) + outside / (1.0 - outside))
    assert lost / (lost + counted) > UNCOUNTED
    assert lost / (lost + counted) < unmodelled_fraction(model, pose) < 1.1 * lost / (lost + counted)
    assert not cc.verify(model, pose, model).verified.any()


def test_a_ridge_between_two_open_condyles_touches_neither(tmp_path):
    """Beyond the edges of an open mesh distances are those of no body, between condyles negative by many mm."""
    points, faces = sheet_mesh(34.0, 1.0, lambda x, z: -np.sqrt(20.0**2 - z**2))
    outer = (np.abs(points[faces][..., 2]) > 6.5).all(axis=1)
    write_obj(tmp_path / "condyles.obj", points, faces[outer][:, ::-1])
    trough = sheet_mesh(40.0, 0.5, lambda x, z: np.where(np.abs(z) < 3.0, -5.0, -np.sqrt(20.5**2 - z**2)))
    write_obj(tmp_path / "trough.obj", *trough)
    path = tmp_path / "knee.toml"
    patches = "[geometry.patches.med]\nz = [5.0, 20.0]\n[geometry.patches.lat]\nz = [-20.0, -5.0]\n"
    path.write_text(
        mesh_scene_text("condyles.obj", "trough.obj", extra=patches)
        .replace('sensitive = ["Fy"]', 'sensitive = ["-Fy_med", "-Fy_lat"]')
        .replace('sensitive_pose = ["ty"]', 'sensitive_pose = ["ty", "rx"]')
    )
    model = cc.ElasticFoundation(cc.load_scene(path))
    pose = np.array([0.0, -0.6, 0.0, 0.0, 0.0, 0.0])
    assert (model.wrenches(pose)[:, 1] < -1000.0).all()
    np.testing.assert_array_equal(share_outside_patches(model, [pose]), 0.0)


def test_a_verdict_holds_no_frame_verified_whose_load_nothing_counts(folder):
    model = model_of(folder)
    poses = np.array([[7.8, 7.7, 0.0, 0.0, 0.0, 0.0], [12.0, 7.7, 0.0, 0.0, 0.0, 0.0]])
    verdict = cc.verify(model, poses, model, loads=("Fy",))
    assert verdict.verified.tolist() == [False, True], "what bears on the wall is not counted"
    assert verdict.exit_code == 4
    assert "load not counted" in verdict.words[0]
    assert "1 solved, load not counted" in verdict.line


@pytest.fixture(scope="module")
def sheets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("edges")
    write_obj(folder / "plane.obj", *sheet_mesh(40.0, 2.0))
    write_obj(folder / "ball.obj", *ball_mesh(20.0, 1.2))
    write_obj(folder / "cap.obj", *cap_mesh(20.0, 1.2, 0.5))
    return folder


def on_sheet(folder, moving):
    path = folder / f"{moving}.toml"
    path.write_text(mesh_scene_text(folder / f"{moving}.obj", folder / "plane.obj"))
    return cc.ElasticFoundation(cc.load_scene(path), (60, 60))


def test_a_cap_that_stands_upright_bears_within_itself_and_one_that_is_turned_onto_its_edge_beyond_it(sheets):
    model = on_sheet(sheets, "cap")
    upright = np.array([0.0, 19.9, 0.0, 0.0, 0.0, 0.0])
    tilted = upright + np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0])  # by as much as the cap reaches from its pole
    apart = upright + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    share = share_beyond_open_edges(model, np.array([upright, tilted, apart]))
    assert share[0] == share[2] == 0.0
    assert 0.2 < share[1] < 0.8, "half of the spot lies beyond, where the cap rounds off"
    assert "in 1 of 3 frames up to" in unmodelled_load_words({"beyond_open_edges": share})["beyond_open_edges"]

    closed = share_beyond_open_edges(on_sheet(sheets, "ball"), [[0.0, 19.9, 0.0, 0.5, 0.0, 0.0]])
    np.testing.assert_array_equal(closed, 0.0)
    assert unmodelled_load_words({"beyond_open_edges": closed}) == {}
    many = np.tile([upright, tilted, apart], (150, 1))  # more than are looked up at once
    np.testing.assert_allclose(share_beyond_open_edges(model, many), np.tile(share, 150), rtol=1e-12)


@pytest.mark.parametrize("on_ground", [False, True])
def test_elements_and_fields_of_meshes_are_both_refined_to_tell_what_they_are_off_by(sheets, on_ground):
    """A coarse distance field of a mesh on the ground counts as that of two meshes does."""
    text = ground_scene_text("cap.obj") if on_ground else mesh_scene_text("cap.obj", "plane.obj")
    path, pose = sheets / f"coarse_{on_ground}.toml", np.array([[0.0, 19.9, 0.0, 0.0, 0.0, 0.0]])
    path.write_text(text.replace("units", "spacing = 1.4\nunits"))
    scene = cc.load_scene(path)
    coarse, fine = (
        cc.ElasticFoundation(scene.with_overrides(spacing=1.4 / times), (int(20 * times**2),) * 2)
        for times in (1.0, np.sqrt(2.0))
    )
    pose *= -1.0 if on_ground else 1.0
    off = off_finer(coarse, pose, ("Fy",), np.zeros((1, 1)))
    np.testing.assert_allclose(off, (coarse(pose) - fine(pose))[:, [1]], rtol=1e-9)
