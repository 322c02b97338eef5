from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import rotation
from casadi_contact.samples.domains import plan_domains
from casadi_contact.samples.reference import reference_motion, reference_poses
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.cycle import Cycle, read_cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from tests.support.shared_data import shared_file
from tests.support.two_spheres import TwoSpheres, cycles, knee

MODEL = TwoSpheres(knee())


def test_pose_estimation_finds_the_poses_the_loads_came_from():
    made, wanted = cycles(MODEL)
    poses, report = reference_poses(MODEL, made, frames=21)
    assert report.converged.all()
    np.testing.assert_allclose(poses, wanted, atol=1e-4)


def test_cycles_are_resampled_on_their_own_time():
    """A cycle of 21 unevenly timed frames gives, at 41 frames, ry and rz on its own percentage of the cycle."""
    (cycle, *_), _ = cycles(MODEL, count=1)
    stretched = replace(cycle, time_s=cycle.time_s**2 + 3.0)
    poses, _ = reference_poses(MODEL, [stretched], frames=41)
    percent = np.linspace(0.0, 1.0, 41)
    np.testing.assert_allclose(poses[0, :, 5], np.interp(percent, cycle.time_s**2, cycle.pose["rz"]), atol=1e-12)


def test_a_frame_that_pulls_is_interpolated_and_reported():
    made, wanted = cycles(MODEL, count=2)
    loads = {name: load.copy() for name, load in made[1].loads.items()}
    loads["Fy_lat"][7] = 50.0
    poses, report = reference_poses(MODEL, [made[0], replace(made[1], loads=loads)], frames=21)
    assert np.argwhere(~report.converged).tolist() == [[1, 7]]
    assert "pulls" in report.reason[1, 7]
    assert "cycle 1: frames 7 interpolated" in str(report)
    np.testing.assert_allclose(poses[1, 7], 0.5 * (wanted[1, 6] + wanted[1, 8]), atol=1e-4)


def test_a_cycle_without_any_pose_is_refused():
    """Loads that pull, and four loads in three unknowns, which have a solution by chance alone."""
    (cycle, *_), _ = cycles(MODEL)
    pulling = replace(cycle, loads={name: np.abs(load) + 1.0 for name, load in cycle.loads.items()})
    locked = TwoSpheres(Scene.from_tables({**MODEL.scene.tables, "pose": {"locked": {"tz": 3.0}}}))
    for model, given, said in ((MODEL, [pulling], "pulls"), (locked, [cycle], "tx, ty, rx"), (MODEL, [], "no cycles")):
        with pytest.raises(ValueError, match=said):
            reference_poses(model, given, frames=21)
    made, wanted = cycles(MODEL, count=2)
    poses, report = reference_poses(MODEL, [pulling, made[1]], frames=21, every_cycle=False)
    assert report.converged.all(axis=1).tolist() == [False, True]
    np.testing.assert_allclose(poses[1], wanted[1], atol=1e-4, err_msg="the other cycle settles all the same")


def test_motion_holds_estimated_poses_and_measured_loads_and_start_poses_near_them():
    made, wanted = cycles(MODEL)
    motion, _ = reference_motion(MODEL, made, SamplingSettings(frames=21))
    assert motion.point.inputs == ("tx", "Fy_med", "tz", "Fy_lat", "ry", "rz")
    np.testing.assert_allclose(motion.curves[..., 0], wanted[..., 0], atol=1e-4)
    np.testing.assert_allclose(motion.curves[2, :, 3], made[2].loads["Fy_lat"])
    np.testing.assert_allclose(motion.envelopes.upper[:, 5], wanted[..., 5].max(axis=0))
    lacking = SamplingSettings(frames=21, inputs=("tx", "Fy_med", "tz", "Ty", "ry", "rz"))
    with pytest.raises(ValueError, match="the cycles hold no load Ty"):
        reference_motion(MODEL, made, lacking)
    # starts take the free parameters of the nearest reference pose
    inputs = motion.curves[1, [3, 9]] + np.array([1e-4, -50.0, 1e-4, 80.0, 1e-5, 1e-5])
    starts = motion.starts(inputs)
    np.testing.assert_array_equal(starts[:, [1, 3]], motion.poses[1, [3, 9]][:, [1, 3]])
    np.testing.assert_array_equal(starts[:, [0, 2, 4, 5]], inputs[:, [0, 2, 4, 5]])


def test_a_single_cycle_is_sampled_about_by_widths_that_are_said():
    """ry has an offset of its own; the loads are known from one cycle, and so are the poses that carry them."""
    (cycle,), _ = cycles(MODEL, count=1)
    motion, report = reference_motion(MODEL, [cycle], SamplingSettings(frames=21))
    assert set(report.assumed) == {"tx", "Fy_med", "tz", "Fy_lat", "rz"}
    assert report.assumed["rz"] == pytest.approx(0.1, rel=1e-3)  # of the 1 rad that it flexes
    assert "the same in all cycles, taken to differ by tx 1 mm, Fy_med " in str(report)
    (d1,) = plan_domains(
        motion.envelopes, MODEL.scene.normal_loads, 5.0, SamplingSettings(frames=21, counts={"D1": 3000})
    )
    nearest = np.abs(d1.inputs[:, None, 5] - motion.curves[0, :, 5]).min(axis=1)
    assert nearest.max() == pytest.approx(0.05, rel=1e-3)


def test_a_pose_that_no_cycle_moves_is_sampled_about_as_well():
    """Both spheres are pressed alike in all cycles, so that none of them moves tz."""
    made, _ = cycles(MODEL, count=2)
    zero = 0.0 * made[0].time_s
    still = [replace(c, pose={**c.pose, "ry": zero}, loads={**c.loads, "Tx": zero}) for c in made]
    for cycle in still:
        cycle.loads["Fy_lat"] = cycle.loads["Fy_med"]
    motion, report = reference_motion(MODEL, still, SamplingSettings(frames=21))
    assert report.converged.all()
    assert report.assumed == {"tz": 1.0}
    (d3,) = plan_domains(motion.envelopes, MODEL.scene.normal_loads, 5.0, SamplingSettings(counts={"D3": 500}))
    assert np.ptp(d3.inputs[:, 2]) == pytest.approx(4.0, rel=0.02)


def test_measured_cycles_have_a_pose_in_every_frame():
    measured = [read_cycle(shared_file(f"data/jw/og{number}_loads.csv")) for number in (1, 2, 3, 4)]
    _, report = reference_poses(ElasticFoundation(knee(), (80, 40)), measured)
    assert report.converged.all(), str(report)


def test_a_body_whose_origin_lies_far_from_its_joint_is_found_in_its_socket_however_it_is_turned(tmp_path):
    """The ball's centre lies 30 mm from the origin: turned about that by a radian it would begin beside the dish."""
    from tests.support.meshes import cap_mesh, mesh_scene_text, sheet_mesh, write_obj

    (ball, faces), arm = cap_mesh(12.0, 1.5, 1.8), np.array([0.0, 30.0, 0.0])
    write_obj(tmp_path / "ball.obj", ball + arm, faces)
    dish = sheet_mesh(18.0, 1.0, lambda x, z: 12.8 - np.sqrt(12.8**2 - np.minimum(x**2 + z**2, 90.0)))
    write_obj(tmp_path / "dish.obj", *dish)
    said = f"start_pose = [0.0, -18.0, 0.0, 0.0, 0.0, 0.0]\n[geometry.patches.contact]\nanchor = {arm.tolist()}"
    text = mesh_scene_text("ball.obj", "dish.obj", extra=said, grid=(30, 30))
    (tmp_path / "scene.toml").write_text(text)
    time_s = np.linspace(0.0, 1.0, 5)
    turned = {"rx": 0.0 * time_s, "ry": 0.2 * time_s, "rz": -0.8 - 0.4 * time_s}
    wanted = {"Fx": 0.0 * time_s, "Fy": -300.0 + 0.0 * time_s, "Fz": 0.0 * time_s}
    model = ElasticFoundation(load_scene(tmp_path / "scene.toml"))
    poses, report = reference_poses(model, [Cycle("turned", time_s, turned, wanted)], frames=5)
    assert report.converged.all()
    centres = poses[0, :, :3] + rotation(poses[0, :, 3:]) @ arm
    np.testing.assert_allclose(centres[:, [0, 2]], 0.0, atol=0.05)
