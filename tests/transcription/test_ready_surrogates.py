"""The shipped surrogates: torch = NumPy = CasADi = compiled C at poses of every domain, and contact physics there."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact import ElasticFoundation
from casadi_contact.dataset import DOMAINS
from casadi_contact.motion.walking import reference_cycles
from casadi_contact.sampling import SamplingSettings, plan_chunks, reference_motion
from casadi_contact.sampling.chunk import draw_chunk
from casadi_contact.structures.load import ready_surrogates
from tests.support.agreement import CANCELLED, agree
from tests.transcription.test_consistency import evaluated, torch_oracle


@pytest.fixture(scope="module")
def poses_of_domain():
    """A few real sample poses of each domain."""
    scene = cc.load_scene("knee")
    settings = SamplingSettings.from_scene(scene, scale=0.001, teacher_grid=(80, 40))
    model = ElasticFoundation(scene, (80, 40))
    motion, _ = reference_motion(model, reference_cycles(count=4), settings)
    poses: dict[str, list[np.ndarray]] = {name: [] for name in DOMAINS}
    for chunk in plan_chunks(scene, motion, settings):
        drawn = draw_chunk(model, model, chunk, settings)
        poses[DOMAINS[chunk.domain - 1]].append(drawn.poses[:5])
    return {name: np.concatenate(parts)[:5] for name, parts in poses.items()}


@pytest.mark.parametrize("name", ready_surrogates())
def test_all_evaluations_agree_in_every_domain(name, poses_of_domain):
    surrogate = cc.load_surrogate(name)
    poses = np.concatenate(list(poses_of_domain.values()))
    in_numpy = surrogate.jacobian(poses)
    weights = np.tile(np.linspace(-1.0, 1.0, len(surrogate.load_names)), (len(poses), 1))
    wanted = torch_oracle.oracles(surrogate, poses, weights)
    for order in range(2):
        agree(in_numpy[order], wanted[order], order, amplified=CANCELLED[surrogate.structure])
    for compiled in (False, True):
        found = evaluated(surrogate.function(compiled=compiled), poses, weights)
        for order, (got, want) in enumerate(zip(found, wanted, strict=True)):
            agree(got, want, order, amplified=CANCELLED[surrogate.structure])


def test_the_shipped_knee_is_as_accurate_as_the_readme_says(poses_of_domain):
    knee = cc.load_surrogate("knee")
    teacher = ElasticFoundation(knee.scene, knee.scene.grids["teacher"])
    bounds = {"D1": (1.0, 25.0), "D2": (2.0, 50.0), "D3": (4.0, 100.0)}
    for domain, poses in poses_of_domain.items():
        off = np.sqrt(np.mean((knee(poses) - teacher(poses)) ** 2, axis=0))
        force, torque = bounds.get(domain, (3.0, 75.0))
        if domain == "D5":
            assert not knee(poses).any()
        assert off[:4].max() < 1.5 * force  # a handful of poses: half as much again as the bar for the whole domain
        assert off[4:].max() < 1.5 * torque
    assert cc.load_scene("knee").digest == knee.scene.digest
