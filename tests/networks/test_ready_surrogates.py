"""The shipped surrogates at new poses: as right as their files say."""

import numpy as np

import casadi_contact as cc
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import LEVER_MM
from casadi_contact.samples.chunk import draw_chunk, plan_chunks
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.samples import DOMAINS, load_errors, rms_by_kind
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.walking import reference_motion_cycles


def poses_of_domain():
    """New poses of each domain, about 200 (D5: 30, D7: 90), drawn like the shipped samples but with another seed."""
    scene = cc.load_scene("knee")
    settings = SamplingSettings.from_scene(scene, scale=0.01, seed=7, counts={"D7": 10_000})
    model = ElasticFoundation(scene, settings.settle_grid)
    motion, _ = reference_motion(model, reference_motion_cycles(scene, ()), settings)
    poses: dict[str, list[np.ndarray]] = {name: [] for name in DOMAINS}
    for chunk in plan_chunks(scene, motion, settings):
        drawn = draw_chunk(model, model, chunk, settings)
        poses[DOMAINS[chunk.domain - 1]].append(drawn.poses)
    return {name: np.concatenate(parts) for name, parts in poses.items()}


def test_the_shipped_knee_errs_on_new_poses_as_its_file_says():
    """At most 1.5 times the RMS error of each load in each domain that the surrogate states (`casadi-contact info`).

    Single errors of 8 times that are rare but there, and a domain has 200 poses here.
    """
    knee = cc.load_surrogate("knee")
    teacher = ElasticFoundation(knee.scene, knee.scene.grids["teacher"])
    drawn = poses_of_domain()
    for domain, poses in drawn.items():
        errors = load_errors(knee.load_names, knee(poses), teacher(poses))
        if domain == "D7":  # stated on 4 poses, too few to hold it to: a tenth of the 5 N that they carry
            assert rms_by_kind(errors)["force"] < 0.5
            assert rms_by_kind(errors)["torque"] < 0.5 * LEVER_MM
            continue
        stated = knee.record["test_errors"][domain]
        for load in knee.load_names:
            assert errors[load]["rms"] <= 1.5 * stated[load]["rms"], (domain, load)
    assert not knee(drawn["D5"]).any()
    assert cc.load_scene("knee").digest == knee.scene.digest
