"""The joint in a page, driven in headless Chromium: its numbers are Python's, and its controls do what they say."""

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.pressure_law import pressures
from casadi_contact.core.conventions import pose_index
from casadi_contact.pictures.live.contact_model import page_contact
from casadi_contact.pictures.live.drawn_bodies import fixed_surfaces
from casadi_contact.pictures.live.joint_page import write_joint_page
from casadi_contact.scenes.opensim import read_opensim_table
from casadi_contact.scenes.pose_file import read_poses, write_poses
from tests.support.agreement import agree
from tests.support.browser import opened, require_browser, until
from tests.support.drawn_surfaces import depths, law_of, point_areas_mm2
from tests.support.shared_data import shared_file

pytest.importorskip("ziglang", reason="pages need the extra: pip install casadi_contact[page]")

MOST_BYTES = 2_500_000
READY = "window.joint !== undefined && joint.later === null"
POSES = {  # pressed on all patches, pressed otherwise, apart
    "knee": [[5.8, 27.94, 0.2, 0.01, -0.06, 0.05], [0.5, 27.4, 0.1, 0.03, 0.0, -0.3], [0.0, 29.5, 0.0, 0.0, 0.1, -1.0]],
    "hip": [[69.9, -65.56, -83.9, 0.0, 0.1, -0.2], [70.1, -65.8, -84.0, 0.0, 0.0, 0.3], [70.0, -66.0, -84.0, 0, 0, 0]],
    "cylinder_on_plane": [[0.0, 29.8, 0.0, 0.0, 0.0, 0.0], [0.3, 29.6, 0.1, 0.01, 0.0, 0.0], [0.0, 30.4, 0.0, 0, 0, 0]],
    "tka_mesh": [
        [-6.2, 41.55, -0.2, 0.0, -0.05, -0.07],
        [-4.0, 41.3, 0.0, 0.01, 0.0, -0.2],
        [-6.2, 43.0, 0.0, 0, 0, 0],
    ],
}


MESHES = Path(__file__).parents[2] / "problems" / "scenes" / "tka_mesh.toml"


def scene_of(name):
    """A ready scene's name, or the scene file of real meshes, which are not part of the project."""
    if name != "tka_mesh":
        return name
    shared_file("data/dm_tka/femoral_component.stl")
    return str(MESHES)


class Live:
    """A page of a scene in the browser, and the models that it was made of."""

    def __init__(self, scene, path, tab, complaints, asked):
        self.path, self.tab, self.complaints, self.asked = path, tab, complaints, asked
        self.contact = page_contact(cc.load_scene(scene_of(scene)))
        self.surrogate = cc.load_surrogate("knee") if scene == "knee" else None
        until(tab, READY)

    def ask(self, expression, *argument):
        return self.tab.evaluate(expression, *argument)

    def of_poses(self, expression, poses):
        """An array from an expression in m (the page's models) and pose, at each of the poses."""
        code = f"(poses) => poses.map((pose) => {{ const m = joint.models; return {expression}; }})"
        return np.array(self.ask(code, np.asarray(poses).tolist()), dtype=float)

    def drawn(self):
        until(self.tab, READY)


@pytest.fixture(scope="module", params=list(POSES))
def live(request, tmp_path_factory):
    require_browser()
    folder = tmp_path_factory.mktemp(request.param)
    page, motion, scene = folder / "page.html", folder / "poses.csv", scene_of(request.param)
    start = np.array(POSES[request.param][0])
    poses = start + np.linspace(0.0, 0.1, 7)[:, None] * np.eye(6)[1]
    write_poses(np.linspace(0.0, 1.0, len(poses)), poses, motion)
    write_joint_page(scene, page, str(motion))
    with opened(page) as (tab, complaints, asked):
        live = Live(request.param, page, tab, complaints, asked)
        yield live
        assert complaints == []


@pytest.fixture
def knee(live):
    if live.surrogate is None:
        pytest.skip("once is enough: the knee's page has all of it")
    live.ask("joint.go(joint.content.cycle.poses[0], 0)")
    live.drawn()
    return live


def test_the_page_is_small_and_asks_for_nothing_from_elsewhere(live):
    text = live.path.read_text("utf-8")
    assert len(text.encode()) < MOST_BYTES
    assert "default-src 'none'" in text
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert all(url.startswith(("file:", "blob:", "data:")) for url in live.asked)


def test_loads_and_root_loads_in_the_page_are_those_of_python(live):
    poses = np.array(POSES[live.contact.scene.name])
    for name, model in (("contact", live.contact), ("surrogate", live.surrogate)):
        if model is None:
            continue
        loads, slopes = model.jacobian(poses)
        s, ds = model.root_loads(poses)
        agree(live.of_poses(f"Array.from(m.{name}.loads(pose))", poses), loads)
        agree(live.of_poses(f"Array.from(m.{name}.jacobian(pose).slopes)", poses).reshape(slopes.shape), slopes, 1)
        agree(live.of_poses(f"Array.from(m.{name}.roots(pose).values)", poses), s)
        agree(live.of_poses(f"Array.from(m.{name}.roots(pose).slopes)", poses).reshape(ds.shape), ds, 1)


def test_validity_and_expected_error_in_the_page_are_those_of_python(knee):
    poses = np.array([*POSES["knee"], [40.0, 27.0, 9.0, 1.0, 1.0, 1.0]])
    agree(knee.of_poses("[m.surrogate.confidence(pose).validity]", poses), knee.surrogate.validity(poses)[:, None])
    agree(knee.of_poses("Array.from(m.surrogate.confidence(pose).errors)", poses), knee.surrogate.expected_error(poses))


def test_pressures_in_the_page_are_those_of_python_s_formulas(live):
    poses = np.array(POSES[live.contact.scene.name])
    for p, surface in enumerate(fixed_surfaces(live.contact)):
        expected = np.array(
            [pressures(*law_of(live.contact), depths(live.contact, p, surface, pose)) for pose in poses]
        )
        assert expected.any()
        agree(live.of_poses(f"Array.from(m.contact.pressures(pose, {p}))", poses).T, expected.T, size=expected.max())


def test_areas_peaks_and_centres_in_the_page_are_those_of_python(live):
    poses = np.array(POSES[live.contact.scene.name])
    summary = live.contact.summary(poses)
    values = np.concatenate([summary.area_mm2, summary.largest_mpa, summary.centre_mm.reshape(len(poses), -1)], 1)
    code = "[...c.map((p) => p.area), ...c.map((p) => p.peak), ...c.flatMap((p) => p.centre ?? [0, 0, 0])]"
    found = live.of_poses(f"((c) => {code})(m.contact.contact(pose))", poses)
    agree(found, np.nan_to_num(values))


def test_forces_on_the_drawn_points_add_up_to_the_patch_s_load(live):
    """A picture of pressure whose sum is not the load would be a picture of something else."""
    pose = np.array(POSES[live.contact.scene.name][0])
    for p, surface in enumerate(fixed_surfaces(live.contact)):
        (found,) = live.of_poses(f"Array.from(m.contact.pressures(pose, {p}))", [pose])
        force = -(found * point_areas_mm2(surface.triangles)) @ surface.triangles.normals
        wanted = live.contact.wrenches(pose)[p, :3]
        assert np.linalg.norm(force - wanted) < 0.02 * np.linalg.norm(wanted)


def test_a_slider_moves_the_loads(live):
    before = live.ask("Array.from(joint.state.contact)")
    live.ask("document.getElementById('ty').value = joint.pose[1] - 0.05")
    live.ask("document.getElementById('ty').dispatchEvent(new Event('change'))")
    live.drawn()
    pose = np.array(live.ask("joint.pose"))
    found = live.ask("Array.from(joint.state.contact)")
    np.testing.assert_allclose(found, live.contact(pose), rtol=1e-9, atol=1e-8)
    assert live.ask("Array.from(joint.state.contact)") != before


def test_settling_in_the_page_ends_where_python_s_does(live):
    scene = live.contact.scene
    if not live.ask("joint.content.settle.free.length"):
        pytest.skip("the scene leaves open what settles")
    names, begun = live.ask("[joint.content.settle.loads, joint.content.settle.start]")
    wanted = {name: 0.8 * value for name, value in zip(names, begun, strict=True)}
    model = live.surrogate or live.contact
    start = np.array(POSES[scene.name][2])
    live.ask("(pose) => joint.go(pose)", start.tolist())
    for name, value in wanted.items():
        live.tab.fill(f"#target-{name}", repr(value))
    live.tab.click("#settle button")
    live.drawn()
    assert live.tab.inner_text("#settled").startswith("settled in ")
    poses, report = cc.settle(model, start[None], scene.sensitive_pose, wanted)
    assert report.converged.all()
    free = [pose_index(name) for name in scene.sensitive_pose]
    np.testing.assert_allclose(np.array(live.ask("joint.pose"))[free], poses[0, free], atol=1e-7)


def test_loads_that_pull_are_not_settled_and_the_page_says_so(knee):
    knee.tab.fill("#target-Fy_med", "300")
    knee.tab.click("#settle button")
    assert "no equilibrium" in knee.tab.inner_text("#settled")


def test_the_scrubber_plays_and_stops(knee):
    knee.tab.click("#play")
    until(knee.tab, "joint.frame === joint.content.cycle.poses.length - 1")
    until(knee.tab, "joint.frame === 0")
    knee.tab.click("#play")
    assert knee.ask("joint.timeline.playing") is None
    frame = knee.ask("joint.frame")
    assert knee.ask("joint.pose") == knee.ask("joint.content.cycle.poses")[frame]


def test_the_scrubber_is_at_the_frame_that_a_button_leads_to(knee):
    poses = np.array(knee.ask("joint.content.cycle.poses"))
    pressed = -knee.contact(poses, ["Fy_med", "Fy_lat"]).sum(axis=1)
    for name, frame in (("stance", pressed.argmax()), ("swing", pressed.argmin())):
        knee.tab.click(f"#presets button:text-is('{name}')")
        assert int(knee.tab.input_value("#frame")) == frame
        knee.drawn()
        assert float(knee.ask("joint.timeline.cursor.style.opacity")) > 0.5
    knee.tab.click("#presets button:text-is('medial lifted')")
    knee.drawn()
    assert float(knee.ask("joint.timeline.cursor.style.opacity")) < 0.5, "no frame of the cycle"


def test_what_was_drawn_coarsely_while_it_moved_is_drawn_in_full_at_rest(knee):
    wide = "joint.bodies.gl.canvas.width / joint.bodies.gl.canvas.clientWidth"
    knee.ask("joint.bodies.pace.level = 2")
    knee.ask("joint.bodies.pace.draw()")
    assert knee.ask(wide) == 1.0
    until(knee.tab, "joint.bodies.pace.watch === null")
    assert knee.ask(wide) == 2.0


def test_the_map_paints_the_area_in_contact(knee):
    """Of a flat dish seen from above, pixel by pixel."""
    knee.ask(
        "joint.map.draw([0, 1].map((p) => joint.models.contact.pressures(joint.pose, p)), 30, joint.state.contacts, [])"
    )
    code = """() => {
      const { map } = joint, [origin, one] = [0, 1].map((x) => map.placed(...[0, 1].map(
        (k) => map.canvas[["clientWidth", "clientHeight"][k]]))([x, 0])[0]);
      const [drawn, bare] = [map.picture.data, map.bare];
      return drawn.filter((value, i) => i % 4 === 2 && value !== bare[i]).length / (one - origin) ** 2;
    }"""
    area = knee.contact.summary(np.array(knee.ask("joint.pose"))[None]).area_mm2.sum()
    assert knee.ask(code) == pytest.approx(area, rel=0.15)


def test_the_light_warns_outside_what_was_learned(knee):
    assert knee.ask("document.getElementById('validity').dataset.state") == "good"
    knee.ask("joint.go(joint.pose.with(0, 60))")
    knee.drawn()
    assert knee.ask("document.getElementById('validity').dataset.state") == "outside"


def test_a_lifted_side_shows_its_gap(knee):
    knee.tab.get_by_role("button", name="lateral lifted").click()
    knee.drawn()
    assert knee.tab.inner_text("#gaps").split("\n")[0].split() == ["medial", "in", "contact"]
    gap = knee.contact.gaps(np.array(knee.ask("joint.pose")))[1]
    np.testing.assert_allclose(gap, 0.25, atol=1e-6)
    assert "0.250 mm" in knee.tab.inner_text("#gaps")


def saved(knee, button, tmp_path):
    with knee.tab.expect_download() as download:
        knee.tab.click(f"#{button}")
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    return path


def test_saved_tables_are_read_back_by_the_library(knee, tmp_path):
    poses = np.array(knee.ask("joint.content.cycle.poses"))
    np.testing.assert_array_equal(read_poses(saved(knee, "csv", tmp_path)), poses)
    path = saved(knee, "sto", tmp_path)
    np.testing.assert_allclose(read_poses(path), poses, atol=1e-12)
    table = read_opensim_table(path)
    loads = knee.surrogate(poses)
    np.testing.assert_allclose(table.columns["Fy_med"], loads[:, 0], atol=1e-8)
    np.testing.assert_allclose(table.columns["Tx"], loads[:, 4] / 1000.0, atol=1e-8)


def test_the_saved_picture_is_not_blank(knee, tmp_path):
    from matplotlib.image import imread

    assert imread(saved(knee, "png", tmp_path))[..., :3].std() > 0.05


def test_the_copied_code_finds_the_pose_that_carries_the_loads(knee, tmp_path):
    knee.ask("void (navigator.clipboard.writeText = () => Promise.reject(new Error('none')))")
    code = saved(knee, "opti", tmp_path).read_text("utf-8")
    scope = {}
    exec(compile(code.replace('"ipopt"', '"ipopt", {"print_time": 0, "ipopt.print_level": 0}'), "opti", "exec"), scope)
    found = scope["solution"].value(scope["loads"])
    assert isinstance(scope["opti"], ca.Opti)
    wanted = knee.ask("joint.wanted")
    np.testing.assert_allclose(np.ravel(found)[:2], wanted, atol=1e-4)
