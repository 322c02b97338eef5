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
from tests.transcription.test_consistency import close, second_derivatives, torch_oracle


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
@pytest.mark.parametrize("domain", DOMAINS)
def test_all_evaluations_agree_in_every_domain(name, domain, poses_of_domain):
    surrogate = cc.load_surrogate(name)
    functions = [surrogate.function(), surrogate.function(compiled=True)]
    weights = np.linspace(-1.0, 1.0, len(surrogate.load_names))
    # Near zero load, digits are lost in differences of numbers of the size of a usual load: that size is the measure.
    usual = np.abs(surrogate(poses_of_domain["D1"])).max(axis=0)
    # Trained two_stage networks add up last-layer terms of thousands of times their sum: one more digit is lost.
    digits = 12 if surrogate.structure == "patch" else 11
    for pose in poses_of_domain[domain]:
        want, want_jacobian, want_hessian = torch_oracle.oracle(surrogate, pose, loads=True)
        loads, jacobian = surrogate.jacobian(pose[None])
        close(loads[0] / usual, want / usual, digits, least=1.0)
        close(jacobian[0] / usual[:, None], want_jacobian / usual[:, None], 9, least=1.0)
        weighted = np.einsum("l,lij->ij", weights, want_hessian)
        for function in functions:
            close(function(pose).full().ravel() / usual, want / usual, digits, least=1.0)
            got = function.jacobian()(pose, 0).full()
            close(got / usual[:, None], want_jacobian / usual[:, None], 9, least=1.0)
            got = second_derivatives(function)(pose, weights).full()
            close(got / usual.max(), weighted / usual.max(), 9, least=1.0)


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
