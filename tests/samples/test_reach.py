"""The plan `reach`: ranges instead of a motion; and joints whose pose is locked."""

import numpy as np

import casadi_contact as cc
from casadi_contact.samples.chunk import Chunk, draw_chunk, lift
from casadi_contact.samples.domains import Envelopes, plan_domains
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.pose_file import write_poses
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow import stages
from casadi_contact.workflow.presets import Preset
from casadi_contact.workflow.project import Project
from tests.support.two_spheres import RADIUS_MM, TwoSpheres, knee

INPUTS = ("tx", "Fy_med", "tz", "Fy_lat", "ry", "rz")
REACH = {"tx": (-1.0, 2.0), "tz": (-1.0, 1.0), "ry": (-0.1, 0.1), "rz": (-2.0, 0.2)}
REACH |= {"Fy_med": (-2500.0, -5.0), "Fy_lat": (-2500.0, 0.0)}


def blocks(**settings):
    scene = cc.load_scene("knee")
    nowhere = Envelopes(INPUTS, np.zeros((1, 6)), np.zeros((1, 6)))
    return plan_domains(nowhere, scene.normal_loads, 5.0, SamplingSettings(reach=REACH, **settings))


def test_the_reach_is_filled_evenly_in_poses_and_in_roots_of_loads():
    assert {b.domain for b in blocks()} == {3, 4, 5, 6, 7}, "it follows no motion"
    inputs = next(b.inputs for b in blocks(counts={"D3": 4000}) if b.domain == 3)
    for column, name in enumerate(INPUTS):
        values, (low, high) = inputs[:, column], REACH[name]
        if name.startswith("Fy"):
            values, low, high = np.sqrt(-values), np.sqrt(5.0), np.sqrt(2500.0)
        counts, _ = np.histogram(values, bins=8, range=(low, high))
        assert counts.sum() == 4000
        assert np.abs(counts - 500).max() <= 25, name


def test_poses_of_the_reach_start_from_advance_to_contact_not_from_a_motion():
    """Starts metres away: without a first touch nothing would settle."""
    model = TwoSpheres(knee())
    starts = np.zeros((6, 6))
    starts[:, 1] = 5000.0
    loads = {"Fy_med": np.full(6, -300.0), "Fy_lat": np.full(6, -200.0)}
    settings = SamplingSettings(reach=REACH)
    drawn = draw_chunk(model, model, Chunk(3, -1, ("ty", "rx"), starts, loads, np.zeros(6, np.uint8)), settings)
    np.testing.assert_allclose(drawn.wrenches[:, :, 1], np.tile([-300.0, -200.0], (6, 1)), atol=1e-3)


def test_each_side_is_lifted_by_a_gap_of_its_own():
    """One side just off and the other farther out, as no lift of both alike gives; the gaps are those asked for."""
    model = TwoSpheres(knee())
    rng = np.random.default_rng(3)
    starts = rng.uniform(-1.0, 1.0, (40, 6)) * [3.0, 0.1, 3.0, 0.02, 0.1, 0.5] + [0.0, RADIUS_MM, 0.0, 0.0, 0.0, -0.5]
    wanted = rng.uniform(0.0, 3.0, (40, 2))
    lifted = lift(model, starts, wanted)
    np.testing.assert_allclose(model.gaps(lifted), wanted, atol=1e-6)
    held = [0, 2, 4, 5]
    np.testing.assert_array_equal(lifted[:, held], starts[:, held])


def test_the_plan_of_a_reach_lifts_sides_apart_and_that_of_a_motion_lifts_them_alike():
    model = TwoSpheres(knee())
    starts = np.tile([0.0, 30.0, 0.0, 0.0, 0.0, 0.0], (30, 1))
    loads = {"Fy_med": np.full(30, -5.0), "Fy_lat": np.full(30, -5.0)}
    chunk = Chunk(5, -1, ("ty", "rx"), starts, loads, np.zeros(30, np.uint8))
    for settings, alike in ((SamplingSettings(reach=REACH), False), (SamplingSettings(), True)):
        gaps = draw_chunk(model, model, chunk, settings).gaps
        assert (gaps > -0.2).all()
        assert gaps.max() > 0.9 * settings.liftoff_mm - 0.2
        assert (np.ptp(gaps, axis=1).max() < 1e-3) == alike


def test_around_known_poses_patches_carry_the_plan_s_loads_by_the_least_move(tmp_path):
    """No sensitive pose is asked; N is a magnitude, or along an axis; other poses lie within the motion's offsets."""
    shares = np.linspace(0.0, 1.0, 21)
    for scene, radius in ((cc.load_scene("sphere_on_plane", sensitive=["F"]), 30.0), (knee(), RADIUS_MM)):
        motion = np.outer(shares, [1.0, -0.2, 0.0, 0.0, 0.0, -0.5])
        motion[:, 1] += radius - 0.1
        write_poses(shares, motion, tmp_path / "motion.csv")
        tables = {**scene.tables, "loads": {k: v for k, v in scene.tables["loads"].items() if k != "sensitive_pose"}}
        scene = Scene.from_tables(tables)
        model = cc.ElasticFoundation(scene, (30, 30)) if radius == 30.0 else TwoSpheres(scene)
        preset = Preset(0.01, sampling={"frames": 21})
        project = Project(scene, "own", tmp_path / scene.name, own=preset)
        samples, report = stages.sample(project, [tmp_path / "motion.csv"], model=model)
        assert str(report) == "21 of 21 reference frames converged"
        assert not samples.dropped_shares()
        normal = normal_forces(scene.normal_loads, samples.wrenches)
        most = normal_forces(scene.normal_loads, model.wrenches(motion)).max(axis=0)
        touching = np.isin(samples.domain, (1, 2, 3))
        assert (normal[touching] > 0.99 * scene.boundary_load).all()
        assert (normal.max(axis=0) < 1.3 * most).all()
        assert (normal.max(axis=0) > 1.1 * most).all()
        assert (normal[samples.domain == 5] == 0.0).all()
        away = np.abs(samples.poses[:, None] - motion) / [2.0, 2.0, 2.0, 0.08, 0.08, 0.08]
        assert away.max(axis=2).min(axis=1).max() < 3.0
