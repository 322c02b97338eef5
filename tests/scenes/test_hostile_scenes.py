"""A scene of someone else's names nothing outside its folder, fits into memory, and fails in one short line."""

import re

import pytest

import casadi_contact as cc
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.joint_cycle import scene_cycles
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import LONGEST_NAME, MOST_ELEMENTS
from tests.support.own_contact import SCENE

NAMES = ["../../../x", "/tmp/x", "..", ".hidden", "-rf", "", "x\x1b[31m", "kn\u00e9e", "x y", "x" * (LONGEST_NAME + 1)]


def refused(make, said):
    """The one line with which something is refused."""
    with pytest.raises(ValueError, match=said) as caught:
        make()
    line = str(caught.value)
    assert len(line.splitlines()) == 1, line
    assert line.isprintable(), line
    assert len(line) < 700, line
    return line


def own_scene(patch):
    """A scene of the user's own model with one patch of this name."""
    tables = SCENE.tables
    return Scene.from_tables({**tables, "geometry": {"patches": {patch: {}}}})


def mesh_scene(patch):
    """A scene of meshes, not loaded from a file, with one patch of this name."""
    tables = cc.load_scene("sphere_on_plane").tables
    geometry = {"moving": "a.stl", "fixed": "b.stl", "units": "mm", "patches": {patch: {}}}
    return Scene.from_tables({**tables, "shape": "mesh", "geometry": geometry})


@pytest.mark.parametrize("name", NAMES, ids=repr)
def test_a_scenes_name_cannot_leave_a_folder_or_hold_what_a_terminal_or_c_would_read(name):
    refused(lambda: Scene.from_tables({**cc.load_scene("knee").tables, "name": name}), "name.*expected")


@pytest.mark.parametrize("name", ["knee", "my-knee_2.1", "K"])
def test_plain_names_stay_allowed(name):
    assert Scene.from_tables({**cc.load_scene("knee").tables, "name": name}).name == name


@pytest.mark.parametrize("patch", ["../x", "a-b", "a.b", 'a"; system("id"); //', "1st"], ids=repr)
@pytest.mark.parametrize("make", [own_scene, mesh_scene])
def test_patches_of_every_shape_have_plain_names(make, patch):
    refused(lambda: make(patch), "geometry.patches.*expected")


def test_a_patch_and_a_part_of_another_patch_are_never_called_alike():
    tables = mesh_scene("med").tables
    patches = {"med": {"z": [0.0, 2.0], "split_z": [1.0]}, "med_1": {"z": [3.0, 4.0]}}
    loads = {**tables["loads"], "sensitive": ["Fy_med", "Fy_med_1"]}
    twice = {**tables, "geometry": {**tables["geometry"], "patches": patches}, "loads": loads}
    refused(lambda: Scene.from_tables(twice), "and their parts.*expected names that differ")


def test_a_patch_in_a_thousand_parts_is_refused():
    tables = mesh_scene("med").tables
    cut = {"z": [0.0, 2000.0], "split_z": [float(k) for k in range(1, 1000)]}
    many = {**tables, "geometry": {**tables["geometry"], "patches": {"med": cut}}}
    refused(lambda: Scene.from_tables(many), "1000 patches or parts of patches, expected 256 at most")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("radius = 30.0", f"radius = {'9' * 400}", "geometry.radius = 9+.*expected a finite number"),
        ("radius = 30.0", f"radius = {'9' * 5000}", "not valid TOML|expected a finite number"),
        ("radius = 30.0", "radius = inf", "geometry.radius = inf, expected a finite number"),
        ("radius = 30.0", "radius = 1979-05-27", "geometry.radius = .*expected a number"),
        ("boundary_load = 5.0", "boundary_load = -inf", "loads.boundary_load = -inf"),
        ("[tolerances]", f"[sampling]\ncounts = {'[' * 5000}{']' * 5000}\n[tolerances]", "nested"),
        ("[tolerances]", f"[sampling.{'.'.join('a' * 50)}]\n[tolerances]", "nested"),
        ("[tolerances]", '[sampling]\n"a\\u001b[2J" = 1\n[tolerances]', "expected printable text"),
        ("fine = [200, 200]", "fine = [4096, 4096]", f"grids.fine = .*at most {MOST_ELEMENTS} elements"),
        ("fine = [200, 200]", "fine = [true, 1]", "two positive whole numbers"),
        ('law = "linear"', 'law = ["linear"]', r"material.law = \['linear'\], expected linear or"),
        ('shape = "sphere_on_plane"', 'shape = ["knee"]', "shape = .*expected one of knee"),
    ],
)
def test_immense_deep_and_infinite_values_are_one_line_at_once(old, new, said):
    text = cc.load_scene("sphere_on_plane").to_toml()
    text = re.sub(r"fine = \[\s*200,\s*200,?\s*\]", "fine = [200, 200]", text)
    assert old in text
    refused(lambda: Scene.from_toml(text.replace(old, new)), said)


def test_files_that_are_no_scene_are_one_line(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xff\xfe\x00")
    refused(lambda: cc.load_scene(path), "not UTF-8 text")
    path.write_bytes(b"#" * 4_000_001)
    refused(lambda: cc.load_scene(path), "bytes, expected at most")
    with pytest.raises(FileNotFoundError, match="does not exist"):
        cc.load_scene(tmp_path / "folder.toml")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("cycles", 100_000_000),
        ("cycles", True),
        ("duration_s", "long"),
        ("duration_s", 0.0),
        ("deviation", -0.1),
        ("harmonics", {"Fx_N": [1.0, 2.0]}),
        ("harmonics", {"Fx_N": [0.0] * 1001}),
        ("harmonics", {"Fx_N": ["a"]}),
    ],
)
def test_a_motion_beyond_all_need_is_refused(key, value):
    motion = {**SCENE.tables["motion"], key: value}
    refused(lambda: scene_cycles(Scene.from_tables({**SCENE.tables, "motion": motion})), f"motion.{key}")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("counts", {"D1": 10**12}),
        ("scale", 1e9),
        ("frames", 10**9),
        ("fixed_offsets", {"ry": [[1.0], "a"]}),
        ("counts", 3),
    ],
)
def test_a_sampling_plan_beyond_all_need_is_refused(key, value):
    scene = Scene.from_tables({**SCENE.tables, "sampling": {key: value}})
    refused(lambda: SamplingSettings.from_scene(scene), f"{key}.*expected")


def test_an_elastic_foundation_of_too_many_elements_is_refused_before_any_is_made(monkeypatch):
    monkeypatch.setattr(Scene, "elements", lambda *_: pytest.fail("elements were made"))
    refused(lambda: cc.ElasticFoundation(cc.load_scene("knee"), (4096, 4096)), f"at most {MOST_ELEMENTS} elements")
