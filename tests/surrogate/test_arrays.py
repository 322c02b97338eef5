"""Arrays of poses: the compiled kernel on all cores equals NumPy, whatever the number of poses and of cores."""

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.threads import at_most_threads
from casadi_contact.surrogate.kernel import BATCH_FROM
from tests.support.agreement import close
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import (
    POSE_SPREAD,
    THREE,
    random_confidence,
    random_poses,
    random_surrogate,
    scene_called,
)

POSES = random_poses(BATCH_FROM + 5, seed=1)


def surrogates(scene, structure):
    """The same random surrogate with a random confidence, by the kernel and in NumPy."""
    made = random_surrogate(scene_called(scene), structure)
    size = 800.0 if structure == "two_stage" else 1.0
    confidence = random_confidence(len(made.patch_names), len(made.load_names), root_size=size)
    return [
        type(made)(made.scene, made.networks, made.record, confidence, compiled=compiled) for compiled in (True, False)
    ]


@needs_compiler
@pytest.mark.usefixtures("as_shipped")
@pytest.mark.parametrize(
    ("scene", "structure"), [("knee", "patch"), (THREE, "patch"), ("hip", "patch"), (THREE, "two_stage")]
)
def test_the_kernel_gives_loads_derivatives_validity_and_expected_error_of_numpy(scene, structure):
    kernel, plain = surrogates(scene, structure)
    values, slopes = kernel.jacobian(POSES)
    wanted, wanted_slopes = plain.jacobian(POSES)
    close(kernel(POSES), wanted, 10)
    close(values, wanted, 10)
    close(slopes, wanted_slopes, 10)
    close(kernel.validity(POSES), plain.validity(POSES), 9)
    close(kernel.expected_error(POSES), plain.expected_error(POSES), 9)
    assert plain.validity(POSES).std() > 0.01, "the poses differ in validity"
    assert (plain.expected_error(POSES).std(axis=0) > 0.01).all(), "and in expected error"
    subset = plain.load_names[::-2]
    close(kernel(POSES, subset), plain(POSES, subset), 10)
    weights = np.random.default_rng(2).normal(size=(len(POSES), len(subset)))
    few = POSES[:20]
    close(kernel.hessian(POSES, weights, subset)[:20], plain.hessian(few, weights[:20], subset), 10)
    with pytest.raises(ValueError, match="weights has shape"):
        plain.hessian(few, np.ones(99))


@needs_compiler
@pytest.mark.parametrize("output", ["validity", "expected_error"])
@pytest.mark.parametrize(
    ("scene", "structure"), [("knee", "patch"), (THREE, "patch"), ("hip", "patch"), (THREE, "two_stage")]
)
def test_functions_of_confidence_have_the_graph_s_derivatives_in_the_kernel(scene, structure, output):
    """Value, Jacobian, Hessian of a weighted sum: kernel = graph, slopes = differences; NaN for poses not finite."""
    kernel, plain = surrogates(scene, structure)
    made = [getattr(each, f"{output}_function")(compiled=each is kernel) for each in (kernel, plain)]
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", made[0].numel_out(0))
    by_kernel, by_graph = (
        ca.Function("f", [pose, weights], [f(pose), ca.jacobian(f(pose), pose), *ca.hessian(weights.T @ f(pose), pose)])
        for f in made
    )
    drawn, steps = np.random.default_rng(3).normal(size=weights.numel()), 1e-5 * np.diag(POSE_SPREAD)
    for at in POSES[:25]:
        found = by_kernel(at, drawn)
        for got, wanted in zip(found, by_graph(at, drawn), strict=True):
            close(got.full(), wanted.full(), 10)
        slopes = [(by_kernel(at + h, drawn)[0] - by_kernel(at - h, drawn)[0]) / 2e-5 for h in steps]
        close(ca.horzcat(*slopes).full(), found[1].full() * POSE_SPREAD, 6)
    together = getattr(kernel, f"{output}_function")(batch=25)(POSES[:25].T)
    close(together.full().T, np.array([made[0](at).full().ravel() for at in POSES[:25]]), 12)
    assert all(np.isnan(part.full()).all() for part in by_kernel([np.inf, 0.0, 0.0, 0.0, 0.0, 0.0], drawn))


@needs_compiler
def test_results_do_not_depend_on_how_many_poses_and_cores_there_are():
    kernel, plain = surrogates("knee", "patch")
    poses = np.tile(POSES, (3, 1))
    shorter = poses[: BATCH_FROM + 2]

    def all_of(given):
        loads, slopes = kernel.jacobian(given)
        return kernel(given), loads, slopes, kernel.validity(given), kernel.expected_error(given)

    few = poses[: BATCH_FROM - 1]
    np.testing.assert_array_equal(kernel(few), plain(few), "few stay with NumPy")
    with at_most_threads(2):
        together = all_of(poses)
    for a, b in zip(together, all_of(shorter), strict=True):
        np.testing.assert_array_equal(a[: len(shorter)], b)


@needs_compiler
def test_a_loaded_surrogate_compiles_once_says_so_and_can_be_sent_to_other_processes(tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("CASADI_CONTACT_CACHE", str(tmp_path / "cache"))
    plain = surrogates("sphere_on_plane", "patch")[1]
    plain.save(tmp_path / "ball.h5")
    loaded = cc.load_surrogate(tmp_path / "ball.h5")
    close(loaded(POSES), plain(POSES), 10)
    said = capfd.readouterr().err
    assert said.startswith("casadi_contact: compiling the kernel of the surrogate sphere_on_plane")
    assert str(tmp_path / "cache") in said
    sent = pickle.loads(pickle.dumps(loaded))
    np.testing.assert_array_equal(sent(POSES), loaded(POSES))
    np.testing.assert_array_equal(cc.load_surrogate(tmp_path / "ball.h5")(POSES), loaded(POSES))
    assert capfd.readouterr().err == ""


def test_without_a_compiler_numpy_answers_after_one_warning(monkeypatch):
    kernel, plain = surrogates("punch_on_plane", "patch")
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(RuntimeWarning, match="NumPy"):
        np.testing.assert_array_equal(kernel(POSES), plain(POSES))
    np.testing.assert_array_equal(kernel.validity(POSES), plain.validity(POSES))


@pytest.mark.parametrize("field", ["centres", "growth"])
def test_a_confidence_of_too_few_numbers_is_refused_before_c_could_read_beyond_them(field):
    made, confidence = random_surrogate(scene_called("knee"), "patch"), random_confidence(2, 7)
    values = getattr(confidence, field)
    short = replace(confidence, **{field: values[:, :5] if values.ndim == 2 else values[:1]})
    with pytest.raises(ValueError, match="shape"):
        type(made)(made.scene, made.networks, {}, short, compiled=True).validity(POSES)


# --- in NumPy, many poses as few, loads and root loads together as each alone

MANY = random_poses(4500)  # more than two blocks
CASES = [("knee", "patch"), (THREE, "patch"), ("knee", "two_stage"), ("planar_knee", "patch")]


@pytest.fixture(params=CASES, ids="-".join)
def surrogate(request):
    scene, structure = request.param
    return random_surrogate(scene_called(scene), structure, seed=4)


def test_rows_do_not_know_how_many_there_are_nor_loads_of_roots(surrogate):
    few, alone = MANY[1990:2010], (*surrogate.jacobian(MANY), *surrogate.root_loads(MANY))
    for whole, part, together in zip(
        alone, (*surrogate.jacobian(few), *surrogate.root_loads(few)), surrogate.jacobian_and_roots(MANY), strict=True
    ):
        np.testing.assert_allclose(whole[1990:2010], part, rtol=1e-12, atol=1e-9)
        np.testing.assert_array_equal(whole, together)
    for method in (surrogate, surrogate.confidence_roots):
        np.testing.assert_allclose(method(MANY)[1990:2010], method(few), rtol=1e-12, atol=1e-10)
    if surrogate.structure != "two_stage":  # two_stage has other networks for them
        np.testing.assert_allclose(surrogate.confidence_roots(MANY), alone[2], rtol=1e-13, atol=1e-13)
