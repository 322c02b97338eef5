"""A joint that is its own mirror image learns one side; the other side's networks are reflections."""

from dataclasses import replace

import numpy as np

import casadi_contact as cc
from casadi_contact.core.conventions import REFLECTION
from casadi_contact.samples.samples import Samples, either_side, mirrored
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.random_surrogates import random_poses, random_surrogate
from tests.support.two_spheres import TwoSpheres


def drawn(count=200):
    model, poses = TwoSpheres(cc.load_scene("knee")), random_poses(count)
    flags = np.ones(count, np.uint8)
    return model, Samples(model.scene, poses, model.wrenches(poses), model.gaps(poses), flags, 0 * flags)


def test_mirrored_samples_of_a_symmetric_joint_are_the_model_s_own():
    """The contact model itself is the oracle: at mirrored poses it gives the mirrored wrenches and gaps."""
    model, samples = drawn()
    for image in (mirrored(samples), either_side(samples)):
        np.testing.assert_allclose(image.wrenches, model.wrenches(image.poses), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(image.gaps, model.gaps(image.poses), rtol=1e-9)


def test_half_of_the_samples_are_learned_in_the_mirror_and_both_images_where_a_side_is_free():
    _, samples = drawn(400)
    free = (samples.wrenches == 0.0).all(axis=2).any(axis=1)
    assert 20 < free.sum() < 380, "samples with and without a free side"
    learned = either_side(samples)
    assert len(learned) == len(samples) + free.sum()
    as_drawn, images = ({tuple(pose) for pose in learned.poses * sign} for sign in (1.0, REFLECTION))
    drawn_poses = {tuple(pose) for pose in samples.poses}
    assert drawn_poses <= as_drawn | images
    assert {tuple(pose) for pose in samples.poses[free]} <= as_drawn & images
    assert 0.3 < len(drawn_poses & as_drawn & {tuple(p) for p in samples.poses[~free]}) / (~free).sum() < 0.7


def test_a_surrogate_of_reflected_networks_mirrors_loads():
    scene = cc.load_scene("knee")
    networks = random_surrogate(scene, "patch", seed=2).networks
    twins = PatchSurrogate.twins(scene)
    networks |= {twin: PatchSurrogate.reflection(twin, networks[of], scene) for twin, of in twins.items()}
    assert set(twins) | set(twins.values()) == set(networks)
    surrogate, poses = PatchSurrogate(scene, networks), random_poses(40)
    image = surrogate.wrenches(poses * REFLECTION)[:, ::-1] * REFLECTION
    assert (surrogate.wrenches(poses) != 0.0).any()
    np.testing.assert_allclose(surrogate.wrenches(poses), image, rtol=1e-10, atol=1e-10)


def test_only_joints_of_equal_sides_are_symmetric():
    knee = cc.load_scene("knee")
    assert knee.symmetric
    assert cc.load_scene("planar_knee").symmetric
    other = {**knee.tables, "geometry": {**knee.geometry, "lat": {"frontal_radius": 21.0}}}
    assert not Scene.from_tables(other).symmetric
    assert not Scene.from_tables({**knee.tables, "pose": {"locked": {"tz": 1.0}}}).symmetric
    assert not cc.load_scene("hip").symmetric
    assert PatchSurrogate.twins(cc.load_scene("hip")) == {}
    for names, twins in (
        (("Fx_med", "Fz_lat"), {}),  # Fx of one side reflects to Fx of the other, not to Fz
        (("Fx_med", "Fx_lat"), {"root_lat": "root_med", "ratios_lat": "ratios_med"}),
        (("Fy",), {"root_lat": "root_med"}),
    ):
        assert PatchSurrogate.twins(replace(knee, load_names=names)) == twins


def test_the_side_that_is_learned_is_as_close_as_the_other_side_is_asked_to_be():
    """Its networks, mirrored, are the other side's: to ask one side for more is to ask the other one."""
    scene = replace(cc.load_scene("knee"), load_names=("Fy_med", "Fy_lat", "Tx_med", "Tx_lat", "Fx"))
    _, samples = drawn(400)

    def asked(**tolerances):
        wanted = replace(scene, tolerances={"Fx": 1.0, **tolerances})
        networks = PatchSurrogate.regressions(either_side(replace(samples, scene=wanted)))
        learned = [one for one in networks if one.name not in PatchSurrogate.twins(wanted)]
        return [np.mean(one.weights**2, axis=0) / one.tolerance**2 for one in learned]

    closer = asked(Fy_med=0.2, Fy_lat=0.2, Tx_med=1.0, Tx_lat=1.0)
    looser = asked(Fy_med=2.0, Fy_lat=2.0, Tx_med=10.0, Tx_lat=10.0)
    assert all((np.asarray(more) >= less).all() for more, less in zip(closer, looser, strict=True))
    assert any((np.asarray(more) > less).any() for more, less in zip(closer, looser, strict=True))
    for one_side in (
        asked(Fy_med=0.2, Fy_lat=2.0, Tx_med=1.0, Tx_lat=10.0),
        asked(Fy_med=2.0, Fy_lat=0.2, Tx_med=10.0, Tx_lat=1.0),
    ):
        for got, wanted in zip(one_side, closer, strict=True):
            np.testing.assert_allclose(got, wanted, rtol=0.01)  # levers differ a little from side to side
