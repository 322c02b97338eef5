"""The joint in a page, driven in headless Chromium: its numbers are Python's, and its controls do what they say."""

import re

import numpy as np
import pytest
import trimesh

import casadi_contact as cc
from casadi_contact.core.conventions import pose_index
from casadi_contact.pictures.drawn_bodies import fixed_surfaces
from casadi_contact.pictures.joint_page import joint_page, page_contact
from casadi_contact.scenes.opensim import read_opensim_table
from casadi_contact.scenes.pose_file import read_poses, write_poses
from tests.support.agreement import agree
from tests.support.browser import opened, require_browser, until
from tests.support.meshes import ball_mesh, scene_of, sheet_mesh

pytest.importorskip("ziglang", reason="pages need the extra: pip install casadi_contact[page]")

MOST_BYTES = 2_500_000
READY = "window.joint !== undefined && joint.later === null"
POSES = {  # pressed on all patches, pressed otherwise, apart
    "knee": [[5.8, 27.94, 0.2, 0.01, -0.06, 0.05], [0.5, 27.4, 0.1, 0.03, 0.0, -0.3], [0.0, 29.5, 0.0, 0.0, 0.1, -1.0]],
    "hip": [[69.9, -65.56, -83.9, 0.0, 0.1, -0.2], [70.1, -65.8, -84.0, 0.0, 0.0, 0.3], [70.0, -66.0, -84.0, 0, 0, 0]],
    "meshes": [[0.2, 19.7, -0.1, 0.0, -0.05, 0.07], [0.5, 19.8, 0.3, 0.1, 0.0, -0.2], [0.0, 21.0, 0.0, 0.0, 0.0, 0.0]],
}


class Live:
    """A page of a scene in the browser, and the models that it was made of."""

    def __init__(self, contact, tab):
        self.contact, self.tab, self.ask = contact, tab, tab.evaluate
        self.poses = np.array(POSES[contact.scene.name])
        self.surrogate = cc.load_surrogate("knee") if contact.scene.name == "knee" else None

    def of_poses(self, expression, poses):
        """An array from an expression in m (the page's models) and pose, at each of the poses."""
        code = f"(poses) => poses.map((pose) => {{ const m = joint.models; return {expression}; }})"
        return np.array(self.ask(code, np.asarray(poses).tolist()), dtype=float)

    def go(self, pose):
        self.ask("(pose) => joint.go(pose)", list(pose))
        until(self.tab, READY)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Pages by scene, each written once, with a cycle that lifts the moving body."""
    folder, pages = tmp_path_factory.mktemp("pages"), {}

    def page(scene):
        require_browser()
        if scene not in pages:
            poses = np.array(POSES[scene][0]) + np.linspace(0.0, 0.1, 7)[:, None] * np.eye(6)[1]
            write_poses(np.linspace(0.0, 1.0, len(poses)), poses, folder / "poses.csv")
            path, named = folder / f"{scene}.html", scene
            if scene == "meshes":
                dish = sheet_mesh(24.0, 1.0, lambda x, z: x**2 / 80.0 + z**2 / 100.0)
                scene_of(folder, ball_mesh(20.0, 2.0), dish, grid=(20, 20))
                named = str(folder / "scene.toml")
            path.write_text(joint_page(named, str(folder / "poses.csv"))[0], "utf-8")
            pages[scene] = (path, page_contact(cc.load_scene(named)))
        return pages[scene]

    return page


def test_a_page_whose_kernel_is_damaged_says_so_in_place_of_its_controls(made, tmp_path):
    text = made("hip")[0].read_text("utf-8")
    damaged, count = re.subn(r'("name":"kernel","kind":"u1","offset":)\d+', r"\g<1>1", text)
    assert count == 1
    (tmp_path / "page.html").write_text(damaged, "utf-8")
    with opened(tmp_path / "page.html") as (tab, complaints, _):
        until(tab, "!document.body.inert")
        said = tab.inner_text("[role=alert]")
        assert said.startswith("Nothing can be computed here: got “CompileError")
        assert "expected an undamaged file" in said
        assert "casadi-contact page" in said
        assert tab.query_selector("input, button") is None
        assert any("CompileError" in complaint for complaint in complaints)


def test_without_webgl_the_page_says_so_where_the_bodies_would_be_and_goes_on(made):
    with opened(made("hip")[0], "--disable-3d-apis") as (tab, _, _):
        until(tab, READY)
        assert "got no WebGL 2, expected a browser that allows it" in tab.inner_text(".view [role=alert]")
        before = tab.inner_text("#rows")
        tab.evaluate("joint.at(1)")
        until(tab, "joint.later === null")
        assert tab.inner_text("#rows") != before


@pytest.fixture(scope="module", params=list(POSES))
def live(request, made):
    path, contact = made(request.param)
    with opened(path) as (tab, complaints, asked):
        until(tab, READY)
        yield Live(contact, tab)
        assert complaints == []
        assert all(url.startswith(("file:", "blob:", "data:")) for url in asked)
    text = path.read_text("utf-8")
    assert len(text.encode()) < MOST_BYTES
    assert "default-src 'none'" in text
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)


@pytest.fixture
def knee(live):
    if live.surrogate is None:
        pytest.skip("once is enough: the knee's page has all of it")
    live.ask("joint.at(0)")
    until(live.tab, READY)
    return live


def test_loads_root_loads_and_confidence_in_the_page_are_those_of_python(live):
    for name, model in (("contact", live.contact), ("surrogate", live.surrogate)):
        if model is None:
            continue
        loads, slopes = model.jacobian(live.poses)
        s, ds = model.root_loads(live.poses)
        found = live.of_poses(f'Array.from(m.{name}.both("jacobian", pose).slopes)', live.poses)
        agree(live.of_poses(f"Array.from(m.{name}.loads(pose))", live.poses), loads)
        agree(found.reshape(slopes.shape), slopes, 1)
        agree(live.of_poses(f'Array.from(m.{name}.both("roots", pose).values)', live.poses), s)
        agree(live.of_poses(f'Array.from(m.{name}.both("roots", pose).slopes)', live.poses).reshape(ds.shape), ds, 1)
    if live.surrogate is not None:
        poses = np.array([*live.poses, [40.0, 27.0, 9.0, 1.0, 1.0, 1.0]])
        found = live.of_poses("((c) => [c.validity, ...c.errors])(m.surrogate.confidence(pose))", poses)
        agree(found[:, :1], live.surrogate.validity(poses)[:, None])
        agree(found[:, 1:], live.surrogate.expected_error(poses))


def test_areas_peaks_and_centres_in_the_page_are_those_of_python(live):
    summary = live.contact.summary(live.poses)
    values = np.concatenate([summary.area_mm2, summary.largest_mpa, summary.centre_mm.reshape(len(live.poses), -1)], 1)
    code = "[...c.map((p) => p.area), ...c.map((p) => p.peak), ...c.flatMap((p) => p.centre ?? [0, 0, 0])]"
    agree(live.of_poses(f"((c) => {code})(m.contact.contact(pose))", live.poses), np.nan_to_num(values))


def test_forces_on_the_drawn_points_add_up_to_the_patch_s_load(live):
    """A picture of pressure whose sum is not the load would be a picture of something else."""
    pose = live.poses[0]
    for p, surface in enumerate(fixed_surfaces(live.contact)):
        (found,) = live.of_poses(f"Array.from(m.contact.pressures(pose, {p}))", [pose])
        drawn = surface.triangles
        thirds = trimesh.Trimesh(drawn.points_mm, drawn.corners, process=False).area_faces / 3.0
        areas = np.bincount(drawn.corners.ravel(), np.repeat(thirds, 3), len(drawn.normals))
        force = -(found * areas) @ drawn.normals
        wanted = live.contact.wrenches(pose)[p, :3]
        assert np.linalg.norm(force - wanted) < 0.02 * np.linalg.norm(wanted)


def test_a_slider_moves_the_loads(live):
    before = live.ask("joint.pose[1]")
    live.ask("document.getElementById('ty').value = joint.pose[1] - 0.05")
    live.ask("document.getElementById('ty').dispatchEvent(new Event('change'))")
    until(live.tab, READY)
    pose = np.array(live.ask("joint.pose"))
    assert pose[1] == pytest.approx(before - 0.05)
    np.testing.assert_allclose(live.ask("Array.from(joint.state.contact)"), live.contact(pose), rtol=1e-9, atol=1e-8)


def test_settling_in_the_page_ends_where_python_s_does(live):
    scene = live.contact.scene
    names, begun = live.ask("[joint.content.settle.loads, joint.content.settle.start]")
    wanted = {name: 0.8 * value for name, value in zip(names, begun, strict=True)}
    live.go(live.poses[2].tolist())
    for name, value in wanted.items():
        live.tab.fill(f"#target-{name}", repr(value))
    live.tab.click("#settle button")
    until(live.tab, READY)
    assert live.tab.inner_text("#settled").startswith("settled in ")
    model = live.surrogate or live.contact
    poses, report = cc.settle(model, live.poses[2:], scene.sensitive_pose, wanted)
    assert report.converged.all()
    free = [pose_index(name) for name in scene.sensitive_pose]
    np.testing.assert_allclose(np.array(live.ask("joint.pose"))[free], poses[0, free], atol=1e-7)


def test_loads_that_pull_are_not_settled_and_the_page_says_so(knee):
    knee.tab.fill("#target-Fy_med", "300")
    knee.tab.click("#settle button")
    assert "no equilibrium" in knee.tab.inner_text("#settled")
    knee.go(knee.poses[0].tolist())
    assert knee.tab.inner_text("#settled") == "", "it was of another pose"
    knee.ask("joint.settle(Array.from(joint.state.contact).slice(0, 2))")
    assert "outside" not in knee.tab.inner_text("#settled")


def test_the_page_is_as_wide_as_a_phone(knee):
    knee.tab.set_viewport_size({"width": 420, "height": 800})
    assert knee.ask("document.documentElement.scrollWidth") == 420
    knee.tab.set_viewport_size({"width": 1280, "height": 800})


def test_the_scrubber_plays_stops_and_is_at_the_frame_that_a_button_leads_to(knee):
    knee.tab.click("#play")
    until(knee.tab, "joint.frame === joint.content.cycle.poses.length - 1")
    until(knee.tab, "joint.frame === 0")
    knee.tab.click("#play")
    assert knee.ask("joint.timeline.playing") is None
    poses = np.array(knee.ask("joint.content.cycle.poses"))
    pressed = -knee.contact(poses, ["Fy_med", "Fy_lat"]).sum(axis=1)
    for name, frame in (("stance", pressed.argmax()), ("swing", pressed.argmin())):
        knee.tab.click(f"#presets button:text-is('{name}')")
        assert int(knee.tab.input_value("#frame")) == frame


def test_the_map_paints_the_area_in_contact(knee):
    """Of a flat dish seen from above, pixel by pixel."""
    code = """() => {
      const { map } = joint;
      map.draw([0, 1].map((p) => joint.models.contact.pressures(joint.pose, p)), 30, [], []);
      const [origin, one] = [0, 1].map((x) => map.place([x, 0])[0]), bare = map.bare.data;
      const drawn = map.canvas.getContext("2d").getImageData(0, 0, map.canvas.width, map.canvas.height).data;
      return drawn.filter((value, i) => i % 4 === 2 && value !== bare[i]).length / (one - origin) ** 2;
    }"""
    knee.tab.set_viewport_size({"width": 1920, "height": 1000})
    area = knee.contact.summary(np.array(knee.ask("joint.pose"))[None]).area_mm2.sum()
    assert knee.ask(code) == pytest.approx(area, rel=0.2)


def test_the_light_warns_outside_what_was_learned_and_a_lifted_side_shows_its_gap(knee):
    state = "document.getElementById('validity').dataset.state"
    assert knee.ask(state) == "good"
    knee.go([60.0, *knee.ask("joint.pose")[1:]])
    assert knee.ask(state) == "outside"
    knee.go(knee.poses[2].tolist())
    gaps = -knee.contact.root_loads(knee.poses[2])[0] / knee.contact.scene.gap_slope
    assert (gaps > 1.0).all()
    assert knee.tab.inner_text("#gaps").split() == ["medial", f"{gaps[0]:.2f}", "mm", "lateral", f"{gaps[1]:.2f}", "mm"]


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
    table, loads = read_opensim_table(path), knee.surrogate(poses)
    np.testing.assert_allclose(table.columns["Fy_med"], loads[:, 0], atol=1e-8)
    np.testing.assert_allclose(table.columns["Tx"], loads[:, 4] / 1000.0, atol=1e-8)
