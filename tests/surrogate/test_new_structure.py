"""A new structure is one class (`tests/surrogate/direct`) and one line in the registry: the whole way works."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.cli import pipeline
from casadi_contact.surrogate.calibration import calibrate
from casadi_contact.surrogate.load import STRUCTURES
from casadi_contact.workflow import samples as sampling
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.presets import PRESETS, Effort, Preset
from tests.support.agreement import close, second_derivatives
from tests.support.compiler import needs_compiler
from tests.support.two_spheres import TwoSpheres
from tests.surrogate.direct.surrogate import DirectSurrogate

PRESET = Preset(0.004, {"direct": {"": Effort(((5,),), 0.3)}})


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Sampled and trained through the stages that the command line runs, on a contact model that costs nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(STRUCTURES, "direct", DirectSurrogate)
        patch.setitem(PRESETS, "direct", PRESET)
        made = pipeline.Project.open("knee", "direct", tmp_path_factory.mktemp("direct"))
        with ThreadPoolExecutor(1) as here:
            sampling.sample(made, executor=here, model=TwoSpheres(made.scene))
            samples, efforts = made.samples(), PRESET.efforts["direct"]
            trained = fit_surrogate(made, samples, Fitting("direct", efforts, made.folder, "a test"), executor=here)
            calibrate(trained, samples).save(made.surrogate_path("direct"))
        yield made


@pytest.fixture(scope="module")
def surrogate(project):
    return cc.load_surrogate(project.surrogate_path("direct"))


def test_it_is_trained_and_read_back_as_itself(project, surrogate):
    assert type(surrogate) is DirectSurrogate
    samples = project.samples()
    want, got = samples.loads(["Fy_med"]), surrogate(samples.poses, ["Fy_med"])
    assert np.std(got - want) < 0.7 * np.std(want), "the network learned nothing"
    assert surrogate.info().structure == "direct"
    far = surrogate.validity(2.0 * samples.poses.max(axis=0) - samples.poses.min(axis=0))
    assert far < surrogate.validity(samples.poses).max()  # a network this small is wrong at most poses


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_compiler)], ids=["graph", "kernel"])
def test_its_functions_and_their_derivatives_are_those_of_its_networks(project, surrogate, compiled):
    function = surrogate.load_and_root_function(compiled=compiled)
    assert (function.class_name() == "External") is compiled
    pose = ca.MX.sym("pose", 6)
    stacked = ca.Function("stacked", [pose], [ca.vertcat(*function(pose))])
    hessian, steps = second_derivatives(stacked), 1e-4 * project.samples().poses.std(axis=0)
    weights = np.arange(1.0, 1.0 + stacked.numel_out(0))
    batch = surrogate.function(compiled=compiled, batch=19)
    poses = project.samples().poses[:19]
    close(batch(poses.T).full().T, surrogate(poses), 10)
    for x in poses[::6]:
        (loads, d_loads), (roots, d_roots) = surrogate.jacobian(x), surrogate.root_loads(x)
        close(stacked(x).full().ravel(), np.concatenate([loads, roots]), 10)
        close(stacked.jacobian()(x, 0).full(), np.vstack([d_loads, d_roots]), 9)

        def gradient(x):
            return weights @ np.vstack([surrogate.jacobian(x)[1], surrogate.root_loads(x)[1]])

        differences = [(gradient(x + step) - gradient(x - step)) / 2.0 for step in np.diag(steps)]
        close(np.outer(steps, steps) * hessian(x, weights).full(), differences * steps, 6)
        assert np.isnan(stacked(np.where(np.arange(6) == 2, np.inf, x)).full()).all()
