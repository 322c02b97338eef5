"""The shipped surrogates: torch = NumPy = CasADi = compiled C at poses of every domain, and contact physics there."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import LEVER_MM
from casadi_contact.optimisation.starts import pose_bounds
from casadi_contact.samples.chunk import draw_chunk, plan_chunks
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.samples import DOMAINS, load_errors, rms_by_kind
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.walking import reference_motion_cycles
from casadi_contact.surrogate.load import ready_surrogates
from tests.support.agreement import CANCELLED, agree, evaluated

torch_oracle = pytest.importorskip("tests.support.torch_oracle", reason="torch is not installed", exc_type=ImportError)


@pytest.fixture(scope="module")
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


@pytest.mark.parametrize("name", ready_surrogates())
def test_all_evaluations_agree_in_every_domain(name, poses_of_domain):
    surrogate = cc.load_surrogate(name)
    poses = np.concatenate([part[:5] for part in poses_of_domain.values()])
    in_numpy = surrogate.jacobian(poses)
    weights = np.tile(np.linspace(-1.0, 1.0, len(surrogate.load_names)), (len(poses), 1))
    wanted = torch_oracle.oracles(surrogate, poses, weights)
    for order in range(2):
        agree(in_numpy[order], wanted[order], order, amplified=CANCELLED[surrogate.structure])
    for compiled in (False, True):
        found = evaluated(surrogate.function(compiled=compiled), poses, weights)
        for order, (got, want) in enumerate(zip(found, wanted, strict=True)):
            agree(got, want, order, amplified=CANCELLED[surrogate.structure])


def test_the_shipped_knee_errs_on_new_poses_as_its_file_says(poses_of_domain):
    """At most 1.5 times the RMS error of each load in each domain that the surrogate states (`casadi-contact info`).

    Single errors of 8 times that are rare but there, and a domain has 200 poses here.
    """
    knee = cc.load_surrogate("knee")
    teacher = ElasticFoundation(knee.scene, knee.scene.grids["teacher"])
    for domain, poses in poses_of_domain.items():
        errors = load_errors(knee.load_names, knee(poses), teacher(poses))
        if domain == "D7":  # stated on 4 poses, too few to hold it to: a tenth of the 5 N that they carry
            assert rms_by_kind(errors)["force"] < 0.5
            assert rms_by_kind(errors)["torque"] < 0.5 * LEVER_MM
            continue
        stated = knee.record["test_errors"][domain]
        for load in knee.load_names:
            assert errors[load]["rms"] <= 1.5 * stated[load]["rms"], (domain, load)
    assert not knee(poses_of_domain["D5"]).any()
    assert cc.load_scene("knee").digest == knee.scene.digest


def test_the_knee_of_the_whole_reach_is_right_where_both_sides_press_within_the_rim():
    """Settled from anywhere in its range, poses that it and the foundation know carry what is wanted (within 20 N)."""
    knee, random, pressed = cc.load_surrogate("knee_reach"), np.random.default_rng(5), ["Fy_med", "Fy_lat"]
    foundation = cc.foundation(knee.scene)
    starts = random.uniform(*pose_bounds(knee), (300, 6))
    wanted = dict(zip(pressed, -random.uniform(20.0, 1500.0, (2, 300)), strict=True))
    poses, report = cc.settle(knee, starts, ("ty", "rx"), wanted)
    poses = poses[report.converged]
    poses = poses[(knee.validity(poses) > 0.5) & ~foundation.at_edge(poses).any(axis=1)]
    poses = poses[(foundation(poses, pressed) < 0.0).all(axis=1)]
    assert len(poses) > 20
    assert np.abs(knee(poses, pressed) - foundation(poses, pressed)).max() < 20.0
