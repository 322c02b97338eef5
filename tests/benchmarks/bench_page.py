"""The joint's page as a browser counts it: size, first paint, frames a second while the scrubber plays; run on demand:

python -m pytest -s tests/benchmarks/bench_page.py

The browser is headless and draws by software, in processes that share the processor with whatever else runs: what it
paints and how often it draws is printed, beside the first paint of an empty page, each in a new browser and in one that
runs. Held are the CPU seconds of the page's own thread, which neither changes: until all is there, and for each frame.
CASADI_CONTACT_PICTURES names a folder for a screenshot of each page.
"""

import os
from pathlib import Path
from statistics import median

import pytest

from casadi_contact.pictures.live.joint_page import write_joint_page
from tests.support.browser import opened, until
from tests.support.shared_data import shared_file

pytest.importorskip("ziglang", reason="pages need the extra: pip install casadi_contact[page]")

MESH = Path(__file__).parents[2] / "problems" / "scenes" / "tka_mesh.toml"
PLAYED_MS = 4000
FIRST_PAINT_S, FRAMES_A_SECOND, MOST_BYTES = 1.0, 30.0, 2_000_000  # bars
READY = "window.joint !== undefined && joint.later === null && joint.bodies.pace.watch === null"
FIRST_PAINT = "performance.getEntriesByName('first-contentful-paint')[0]"
PLAY = """(milliseconds) => new Promise((resolve) => {
  const draw = joint.draw.bind(joint), begun = performance.now();
  let drawn = 0;
  joint.draw = () => { draw(); drawn += 1; };
  joint.timeline.play();
  setTimeout(() => {
    joint.timeline.pause();
    joint.draw = draw;
    resolve([drawn, performance.now() - begun]);
  }, milliseconds);
})"""


def own_seconds(session):
    """CPU seconds of the page's thread since it was opened."""
    return {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}["TaskDuration"]


def first_paint(tab):
    """Milliseconds after the tab began to open what it shows."""
    until(tab, f"{FIRST_PAINT} !== undefined")
    return tab.evaluate(f"{FIRST_PAINT}.startTime")


def opened_anew(tab, path):
    """First paint of a page in another tab of a browser that has drawn before."""
    other = tab.context.browser.new_page(viewport=tab.viewport_size)
    other.goto(path.as_uri())
    found = first_paint(other)
    other.close()
    return found


@pytest.mark.parametrize("scene", ["knee", "hip", "tka_mesh"])
def bench_a_page_paints_and_plays(scene, tmp_path):
    if scene == "tka_mesh":
        shared_file("data/dm_tka/femoral_component.stl")
    path, empty = tmp_path / f"{scene}.html", tmp_path / "empty.html"
    empty.write_text("<!DOCTYPE html><title>empty</title><p>empty</p>", "utf-8")
    write_joint_page(str(MESH) if scene == "tka_mesh" else scene, path)
    with opened(empty) as (tab, _, _):
        nothing = [first_paint(tab), *(opened_anew(tab, empty) for _ in range(3))]
    with opened(path) as (tab, complaints, _):
        paint = [first_paint(tab)]
        until(tab, READY)
        session = tab.context.new_cdp_session(tab)
        session.send("Performance.enable", {"timeDomain": "threadTicks"})
        tab.reload()
        until(tab, READY)
        ready = own_seconds(session)
        drawn, milliseconds = tab.evaluate(PLAY, PLAYED_MS)
        frame = (own_seconds(session) - ready) / drawn
        if folder := os.environ.get("CASADI_CONTACT_PICTURES"):
            until(tab, READY)
            tab.screenshot(path=Path(folder) / f"{scene}.png")
        paint += [opened_anew(tab, path) for _ in range(3)]
        assert complaints == []
    size, load = path.stat().st_size, os.getloadavg()[0]
    print(f"\n{scene}: {size / 1e6:.2f} MB; load {load:.1f} on {os.cpu_count()} cores, drawn by software")
    for what, (first, *later) in (("first paint", paint), ("of an empty page", nothing)):
        print(f"  {what} after {first:.0f} ms in a new browser, {median(later):.0f} ms in a running one")
    print(f"  {1000 * drawn / milliseconds:.1f} frames a second")
    print(f"  of the page's own thread {ready:.2f} CPU s until all is there, {1000 * frame:.1f} CPU ms a frame")
    assert size <= MOST_BYTES
    assert ready <= FIRST_PAINT_S
    assert frame <= 1.0 / FRAMES_A_SECOND
