"""A page that cannot run as it should says so, in headless Chromium, instead of standing there dead."""

import re

import numpy as np
import pytest

from casadi_contact.pictures.live.joint_page import write_joint_page
from casadi_contact.scenes.pose_file import write_poses
from tests.support.browser import opened, until

pytest.importorskip("ziglang", reason="pages need the extra: pip install casadi_contact[page]")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    poses = np.outer([29.8, 29.9], np.eye(6)[1])
    write_poses(np.array([0.0, 1.0]), poses, folder / "poses.csv")
    write_joint_page("sphere_on_plane", folder / "page.html", str(folder / "poses.csv"))
    return folder / "page.html"


def test_a_page_whose_kernel_is_damaged_says_so_in_place_of_its_controls(page, tmp_path):
    text = page.read_text("utf-8")
    damaged, count = re.subn(r'("name":"kernel","kind":"u1","offset":)\d+', r"\g<1>1", text)
    assert count == 1
    (tmp_path / "page.html").write_text(damaged, "utf-8")
    with opened(tmp_path / "page.html") as (tab, complaints, _):
        until(tab, "!document.body.inert")
        said = tab.inner_text("[role=alert]")
        assert said.startswith("Nothing can be computed here: got “CompileError")
        assert "expected an undamaged file in a browser with WebAssembly" in said
        assert "casadi-contact page" in said
        assert tab.query_selector("input, button") is None
        assert any("CompileError" in complaint for complaint in complaints)


def test_without_webgl_the_page_says_so_where_the_bodies_would_be_and_goes_on(page):
    with opened(page, "--disable-3d-apis") as (tab, _, _):
        until(tab, "window.joint !== undefined && joint.later === null")
        assert "got no WebGL 2, expected a browser that allows it" in tab.inner_text(".view [role=alert]")
        before = tab.inner_text("#rows")
        tab.evaluate("joint.go(joint.content.cycle.poses[1])")
        until(tab, "joint.later === null")
        assert tab.inner_text("#rows") != before
