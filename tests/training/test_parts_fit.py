"""Root loads of a patch's parts fitted on together, for what the patch carries."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.network import PartsRegression
from casadi_contact.training import TrainingSettings, fit_all_parts
from casadi_contact.training.parts_fit import fit_parts
from casadi_contact.training.parts_mlp import PartsMlp, flatten_parts, unflatten_parts
from casadi_contact.training.weights import initial_network

NAMES = ("root_a", "root_b", "root_c")
ROWS = ("shares", "wanted", "targets", "weights", "validation")  # of a regression, beside the inputs


@pytest.fixture(scope="module")
def patch():
    """Three parts that bear one after the other, and two components of what they carry together."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, (400, 2))
    roots = np.stack([0.6 + x[:, 0] - 0.5 * (x[:, 1] - at) ** 2 for at in (-1.0, 0.0, 1.0)], axis=1)
    shares = np.stack([np.ones((400, 3)), np.broadcast_to([-2.0, 0.1, 2.0], (400, 3)) + 0.1 * x[:, :1]], axis=2)
    wanted = np.einsum("nk,nkj->nj", np.maximum(roots, 0.0) ** 2, shares)
    validation = np.arange(400) % 5 == 0
    inputs = tuple(x + 0.1 * k for k in range(3))
    return PartsRegression("together_p", NAMES, inputs, shares, wanted, roots, 0.1 * np.ones((400, 3)), validation, 0.0)


@pytest.fixture(scope="module")
def networks(patch):
    pairs = zip(patch.inputs, patch.targets.T, strict=True)
    return [initial_network(x, s, (4, 3), "algebraic", k) for k, (x, s) in enumerate(pairs)]


@pytest.fixture(scope="module")
def thinned(patch):
    """Of the rows out of contact every second one weighs nothing."""
    skipped = (patch.targets < 0.0) & (np.arange(400) % 2 == 0)[:, None]
    return replace(patch, weights=np.where(skipped, 0.0, patch.weights))


def residuals(patch, networks, parameters):
    parts = zip(unflatten_parts(parameters, networks), patch.inputs, strict=True)
    return patch.residuals(np.stack([network.value(x) for network, x in parts], axis=1)).ravel()


def test_true_root_loads_leave_nothing(patch):
    np.testing.assert_allclose(patch.residuals(patch.targets), 0.0, atol=1e-14)


@pytest.mark.parametrize("given", ["patch", "thinned"])
def test_products_are_those_of_the_jacobian(given, networks, request):
    """Against central differences of the residuals."""
    patch = request.getfixturevalue(given)
    mlp, at = PartsMlp(networks, patch, np.arange(400), chunk_rows=128), flatten_parts(networks)
    step = 1e-6
    columns = [
        residuals(patch, networks, at + step * e) - residuals(patch, networks, at - step * e) for e in np.eye(len(at))
    ]
    jacobian = np.stack(columns, axis=1) / (2.0 * step)
    _, loss = mlp.evaluate(at)
    r = residuals(patch, networks, at)
    assert loss == pytest.approx(0.5 * r @ r)
    np.testing.assert_allclose(mlp.accept(at), jacobian.T @ r, rtol=1e-6, atol=1e-6)
    direction = np.random.default_rng(0).normal(size=len(at))
    np.testing.assert_allclose(mlp.gram_product(direction), jacobian.T @ (jacobian @ direction), rtol=1e-6, atol=1e-6)
    ends = np.cumsum([network.parameter_count for network in networks])
    for block, b in zip(mlp.gram(), ends, strict=True):
        a = b - len(block)
        np.testing.assert_allclose(np.triu(block), np.triu(jacobian[:, a:b].T @ jacobian[:, a:b]), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("given", ["patch", "thinned"])
def test_the_patch_becomes_right(given, networks, request):
    fit = fit_parts(request.getfixturevalue(given), TrainingSettings(max_gflop=0.5), None, None, networks)
    training = fit.history["training_rms"]
    assert (np.diff(training) <= 0.0).all()
    assert fit.rms < 0.05 * training[0]
    assert fit.validation_rms < 0.1 * training[0]
    assert set(fit.networks) == set(NAMES)


def test_an_interrupted_fit_goes_on_to_the_same_weights(patch, networks, tmp_path):
    settings = TrainingSettings(max_gflop=0.2, checkpoint_every_s=0.0)
    whole = fit_parts(patch, settings, None, None, networks)
    seen = []

    def stop(*told):
        seen.append(told)
        if len(seen) == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_parts(patch, settings, tmp_path / "parts.npz", stop, networks)
    again = fit_parts(patch, settings, tmp_path / "parts.npz", None, networks)
    assert len(again.history["gflop"]) == len(whole.history["gflop"])
    for name in NAMES:
        for got, want in zip(again.networks[name].weights, whole.networks[name].weights, strict=True):
            np.testing.assert_array_equal(got, want)
    done = fit_parts(patch, settings, tmp_path / "parts.npz", stop, networks)
    assert len(seen) == 5, "a finished fit is returned at once"
    np.testing.assert_array_equal(done.history["gflop"], again.history["gflop"])


def test_drawn_blocks_stand_for_all_rows(thinned, networks):
    """Each is the mean of those drawn with many seeds."""
    many = replace(
        thinned, **{k: np.tile(getattr(thinned, k), (3, *[1] * (getattr(thinned, k).ndim - 1))) for k in ROWS},
        inputs=tuple(np.tile(x, (3, 1)) for x in thinned.inputs),
    )  # fmt: skip
    mlp, at = PartsMlp(networks, many, np.arange(1200)), flatten_parts(networks)
    mlp.evaluate(at)
    mlp.accept(at)
    drawn = [mlp.drawn_gram([seed]) for seed in range(300)]
    for k, block in enumerate(mlp.gram()):
        mean = np.mean([np.triu(blocks[k]) for blocks in drawn], axis=0)
        np.testing.assert_allclose(mean, np.triu(block), atol=0.05 * np.abs(block).max())


def test_patches_side_by_side_are_those_alone(patch, networks, tmp_path):
    settings, starts = TrainingSettings(max_gflop=0.05), dict(zip(NAMES, networks, strict=True))
    told = []
    with ThreadPoolExecutor(1) as here:
        beside = fit_all_parts([patch], settings, starts, here, tmp_path, lambda *line: told.append(line))
    alone = fit_all_parts([patch], settings, starts)
    np.testing.assert_array_equal(
        beside["together_p"].networks["root_b"].weights[0], alone["together_p"].networks["root_b"].weights[0]
    )
    with pytest.raises(ValueError, match="other data"):
        fit_all_parts([patch], TrainingSettings(max_gflop=0.05, seed=1), starts, None, tmp_path)
