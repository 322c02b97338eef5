"""A scene of someone else's names nothing outside its folder, fits into memory, and fails in one short line."""

import pytest

import casadi_contact as cc
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.cycle import scene_cycles
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import LONGEST_NAME, MOST_ELEMENTS
from tests.support.meshes import mesh_scene_text
from tests.support.own_contact import SCENE

MESH_TEXT = mesh_scene_text("a.stl", "b.stl")
MESHES = Scene.from_toml(MESH_TEXT)


def refused(make, said):
    """Refused in one line."""
    with pytest.raises(ValueError, match=said) as caught:
        make()
    line = str(caught.value)
    assert line.isprintable(), line
    assert len(line) < 700, line


def with_patches(patches, scene=MESHES, sensitive=("Fy",)):
    """A scene with these patches, of the user's own model or of meshes that are not loaded."""
    loads = {**scene.tables["loads"], "sensitive": list(sensitive)}
    return Scene.from_tables({**scene.tables, "geometry": {**scene.geometry, "patches": patches}, "loads": loads})


@pytest.mark.parametrize(
    "name",
    ["../../../x", "/tmp/x", ".hidden", "-rf", "", "x\x1b[31m", "kn\u00e9e", "x y", "x" * (LONGEST_NAME + 1)],
    ids=repr,
)
def test_a_scenes_name_cannot_leave_a_folder_or_hold_what_a_terminal_or_c_would_read(name):
    knee = cc.load_scene("knee").tables
    refused(lambda: Scene.from_tables({**knee, "name": name}), "name.*expected")
    assert Scene.from_tables({**knee, "name": "my-knee_2.1"}).name == "my-knee_2.1"


@pytest.mark.parametrize("patch", ["../x", "a-b", "a.b", 'a"; system("id"); //', "1st"], ids=repr)
@pytest.mark.parametrize("scene", [SCENE, MESHES], ids=["own", "meshes"])
def test_patches_of_every_shape_have_plain_names(scene, patch):
    refused(lambda: with_patches({patch: {}}, scene), "geometry.patches.*expected")


def test_patches_are_few():
    many = {f"p{k}": {"z": [k, k + 1.0]} for k in range(300)}
    refused(lambda: with_patches(many, sensitive=[f"Fy_{name}" for name in many]), "300 patches, expected 256 at most")


@pytest.mark.parametrize(
    ("name", "overrides", "said"),
    [
        ("kneee", {}, "kneee"),
        ("knee", {"radius": 3.0}, "radius"),
        ("knee", {"law": "cubic"}, "material.law"),
        ("knee", {"law": ["linear"]}, r"material.law = \['linear'\], expected linear or"),
        ("knee", {"poissons_ratio": 0.5}, "poissons_ratio"),
        ("knee", {"thickness": float("nan")}, "thickness"),
        ("knee", {"thickness": 10**5000}, "expected a finite number"),
        ("knee", {"fine": (0, 40)}, "grids.fine"),
        ("knee", {"fine": (True, 1)}, "two positive whole numbers"),
        ("knee", {"fine": (4096, 4096)}, f"grids.fine = .*at most {MOST_ELEMENTS} elements"),
        ("knee", {"dish_frontal_radius": 20.0}, "geometry.dish_frontal_radius"),
        ("knee", {"sagittal_radii": [30.0]}, "geometry.sagittal_junctions_deg"),
        ("knee", {"sensitive": ["Fq"]}, "Fq"),
        ("sphere_in_dish", {"dish_radius": 20.0}, "geometry.dish_radius"),
        ("hip", {"cup_radius": 15.0}, "geometry.cup_radius"),
        ("hip", {"cup_pole": (0.0, 0.0, 0.0)}, "geometry.cup_pole"),
        ("hip", {"cup_centre": (0.0, 0.0)}, "geometry.cup_centre"),
        ("patellofemoral", {"dome_radius": 31.0}, "geometry.facet_radius"),
        ("patellofemoral", {"dome_sagittal_radius": 10.0}, "geometry.dome_sagittal_radius"),
        ("patellofemoral", {"facet_half_width_deg": 80.0}, "geometry.facet_half_width_deg"),
    ],
)
def test_bad_values_are_refused_with_the_key(name, overrides, said):
    refused(lambda: cc.load_scene(name, **overrides), said)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format = 1", "format = 9", "format = 9"),
        ("[material]", "[material]\ncolour = 1", "colour"),
        ("[geometry]", "[geometry]\nmed = { wheel = 1.0 }", "wheel"),
        ("frontal_radius = 22.0", f"frontal_radius = {'9' * 5000}", "not valid TOML|expected a finite number"),
        ("frontal_radius = 22.0", "frontal_radius = 1979-05-27", "geometry.frontal_radius = .*expected a number"),
        ("[tolerances]", f"[motion.{'.'.join('a' * 50)}]\n[tolerances]", "nested"),
        ("[tolerances]", '[motion.x]\n"a\\u001b[2J" = 1\n[tolerances]', "expected printable text"),
    ],
)
def test_bad_text_is_one_line_at_once(old, new, said):
    text = cc.load_scene("knee").to_toml()
    assert old in text
    refused(lambda: Scene.from_toml(text.replace(old, new, 1)), said)


UNITS, PATCH = 'units = "mm"', "[geometry.patches.contact]"


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        (UNITS, "", "units"),
        ('elements = "grid"', 'elements = "hexes"', "elements"),
        (UNITS, f'{UNITS}\naxes = ["-x", "y", "z"]', "axes"),
        (UNITS, f"{UNITS}\ncolour = 1", "colour"),
        (UNITS, f"{UNITS}\nspacing = 1e-9", "spacing"),
        (UNITS, f"{UNITS}\nspacing = 3.0", "spacing"),
        (UNITS, f"{UNITS}\npressing = [0.0, 0.0, 0.0]", "geometry.pressing"),
        (UNITS, f'{UNITS}\nopen_edges = "torn"', "geometry.open_edges"),
        (UNITS, f'{UNITS}\nshell = "inner"', "geometry.shell"),
        (PATCH, f'{PATCH}\n[geometry.placement.moving]\nmirror = "w"', "placement.moving.mirror"),
        (PATCH, f"{PATCH}\n[geometry.placement.moving]\noffset = 3.0", "placement.moving.offset"),
        (PATCH, f"{PATCH}\n[geometry.placement.femur]\noffset = [1, 2, 3]", "placement.femur"),
        (PATCH, f"{PATCH}\nx = [2.0, 1.0]", "rising"),
        (PATCH, f"{PATCH}\nanchor = [2.0]", "anchor"),
        (PATCH, "", "patches"),
    ],
)
def test_bad_mesh_scenes_are_refused_with_the_key(old, new, word):
    refused(lambda: Scene.from_toml(MESH_TEXT.replace(old, new)), word)


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
        *[("cycles", value) for value in (1, 100_000_000, True)],
        *[("duration_s", value) for value in ("long", 0.0)],
        ("deviation", -0.1),
        ("wheels", 3),
        *[("harmonics", {name: value}) for name, value in (("rz_deg", [1.0]), ("Fx_N", [1.0, 2.0]), ("Fx_N", ["a"]))],
        ("harmonics", {"Fx_N": [0.0] * 1001}),
    ],
)
def test_a_motion_that_makes_no_sense_is_refused(key, value):
    motion = {**SCENE.tables["motion"], key: value}
    refused(lambda: scene_cycles(Scene.from_tables({**SCENE.tables, "motion": motion})), key)


@pytest.mark.parametrize(
    ("key", "value"),
    [("counts", {"D1": 10**12}), ("counts", 3), ("scale", 1e9), ("frames", 10**9), ("fixed_offsets", {"ry": ["a"]})],
)
def test_a_sampling_plan_beyond_all_need_is_refused(key, value):
    scene = Scene.from_tables({**SCENE.tables, "sampling": {key: value}})
    refused(lambda: SamplingSettings.from_scene(scene), f"{key}.*expected")


def test_an_elastic_foundation_of_too_many_elements_is_refused_before_any_is_made(monkeypatch):
    monkeypatch.setattr(Scene, "elements", lambda *_: pytest.fail("elements were made"))
    refused(lambda: cc.ElasticFoundation(cc.load_scene("knee"), (4096, 4096)), f"at most {MOST_ELEMENTS} elements")
