"""Sampling joints that are not knees: a hip without a single direction, a patella pressed backwards."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.samples.chunk import lift
from casadi_contact.samples.domains import left_out
from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.cycle import scene_cycles
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene


def drawn(name, path):
    scene = load_scene(name)
    settings = SamplingSettings.from_scene(
        scene, frames=15, settle_grid=(40, 40), teacher_grid=(60, 60), counts={f"D{d}": 60 for d in range(1, 8)}
    )
    motion, report = reference_motion(ElasticFoundation(scene, (40, 40)), scene_cycles(scene)[:3], settings)
    assert report.converged.all()
    with ThreadPoolExecutor(1) as executor:
        return motion, draw_samples(scene, motion, path, settings=settings, executor=executor)


@pytest.mark.parametrize("name", ["hip", "planar_knee"])
def test_where_no_patch_is_lifted_off_alone_the_default_plan_tells_what_is_out_of_contact_too(name):
    """Only D5 and D7 know no contact there: as many as a tenth of the others."""
    tables = {**load_scene(name).tables, "sampling": {}}
    assert {"D4", "D6"} <= set(left_out(Scene.from_tables(tables).controllable_normal_loads, SamplingSettings()))
    counts = SamplingSettings.from_scene(Scene.from_tables(tables)).counts
    assert counts["D5"] + counts["D7"] >= 0.1 * (counts["D1"] + counts["D2"] + counts["D3"])
    asked = {**tables, "sampling": {"counts": {"D5": 40}}}
    assert SamplingSettings.from_scene(Scene.from_tables(asked)).counts["D5"] == 40


def test_a_hip_at_the_boundary_carries_it_in_any_direction_and_lifts_off_away_from_it(tmp_path):
    motion, samples = drawn("hip", tmp_path / "samples.h5")
    assert (motion.point.inputs, motion.point.free) == (("Fx", "Fy", "Fz", "rx", "ry", "rz"), ("tx", "ty", "tz"))
    assert sorted(set(samples.domain.tolist())) == [1, 2, 3, 5, 7]
    assert set(samples.provenance["left_out"]) == {"D4", "D6"}
    boundary = samples.select("D7").wrenches[:, 0, :3]
    np.testing.assert_allclose(np.linalg.norm(boundary, axis=1), 5.0, atol=0.5)
    assert np.ptp(boundary, axis=0).min() > 1.0
    apart = samples.select("D5")
    assert len(apart) > 30
    assert not apart.wrenches.any()
    assert (apart.gaps > 0.0).all()


def test_both_facets_of_a_patella_are_pressed_backwards_and_lifted_one_at_a_time(tmp_path):
    motion, samples = drawn("patellofemoral", tmp_path / "samples.h5")
    assert motion.point.inputs == ("Fx_med", "ty", "Fx_lat", "rx", "ry", "rz")
    assert samples.provenance["left_out"] == {}
    fx = samples.wrenches[:, :, 0]
    assert (fx >= 0.0).all()
    one = samples.select("D4")
    lifted = (one.wrenches == 0.0).all(axis=2)
    np.testing.assert_array_equal(lifted.sum(axis=1), 1)
    assert lifted.any(axis=0).all()
    np.testing.assert_allclose(
        samples.select("D7").loads(["Fx_med", "Fx_lat"]), 5.0, atol=2.0
    )  # these grids are coarse
    assert not samples.select("D5").wrenches.any()


def test_a_patella_is_lifted_off_to_the_front():
    scene = load_scene("patellofemoral")
    model = ElasticFoundation(scene, (60, 40))
    poses, report = settle(model, [[-49.85, 2.0, 0.0, 0.0, 0.0, -0.5]], ("tx", "tz"), {"Fx_med": 5.0, "Fx_lat": 5.0})
    assert report.converged.all()
    gaps = np.repeat([[0.2], [0.4], [0.6]], 2, axis=1)
    raised = lift(model, np.repeat(poses, 3, axis=0), gaps)
    np.testing.assert_allclose(model.gaps(raised), gaps, atol=1e-3)
    assert (raised[:, 0] < poses[0, 0] - 0.9 * gaps[:, 0]).all()
