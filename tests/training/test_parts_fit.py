"""Root loads of a patch's parts fitted on together, for what the patch carries."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.network import PartsRegression
from casadi_contact.training import TrainingSettings, fit_all_parts
from casadi_contact.training.levenberg_marquardt import LevenbergMarquardt
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


@pytest.fixture(scope="module")
def reordered(patch):
    """Its numbers in another order of memory, as they lie once parts are picked from samples."""
    return replace(patch, **{name: np.asfortranarray(getattr(patch, name)) for name in ROWS})


def residuals(patch, networks, parameters):
    parts = zip(unflatten_parts(parameters, networks), patch.inputs, strict=True)
    return patch.residuals(np.stack([network.value(x) for network, x in parts], axis=1)).ravel()


def test_true_root_loads_leave_nothing(patch):
    np.testing.assert_allclose(patch.residuals(patch.targets), 0.0, atol=1e-14)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("given", ["patch", "thinned", "reordered"])
def test_products_are_those_of_the_jacobian(given, compiled, networks, request):
    """Against central differences of the residuals."""
    patch = request.getfixturevalue(given)
    at, step = flatten_parts(networks), 1e-6
    mlp = PartsMlp(networks, patch, chunk_rows=128, compiled=compiled)
    columns = [
        residuals(patch, networks, at + step * e) - residuals(patch, networks, at - step * e) for e in np.eye(len(at))
    ]
    jacobian = np.stack(columns, axis=1) / (2.0 * step)
    _, loss = mlp.evaluate(at)
    r = residuals(patch, networks, at)
    assert loss == pytest.approx(0.5 * r @ r)
    np.testing.assert_allclose(mlp.accept(at), jacobian.T @ r, rtol=1e-6, atol=1e-6)
    direction = np.random.default_rng(0).normal(size=len(at))
    product = jacobian.T @ (jacobian @ direction)
    np.testing.assert_allclose(mlp.gram_product(direction), product, atol=1e-5 * np.abs(product).max())
    ends = np.cumsum([network.parameter_count for network in networks])
    for block, b in zip(mlp.gram(), ends, strict=True):
        a = b - len(block)
        want = np.triu(jacobian[:, a:b].T @ jacobian[:, a:b])
        np.testing.assert_allclose(np.triu(block), want, atol=1e-5 * np.abs(want).max())


@pytest.mark.parametrize("activation", ["algebraic", "tanh"])
@pytest.mark.parametrize(("hidden", "unit"), [((1,), 1e-12), ((5, 4), 1.0), ((9, 2, 3), 1e12)])
def test_parts_of_any_size_are_the_same_in_c_and_in_numpy(hidden, unit, activation, thinned):
    """More rows than a group holds, parts of different sizes, a count of rows that fills no block, any unit, and arrays
    in another order than C's."""
    rows = np.arange(1201) % 400
    many = replace(
        thinned, **{k: getattr(thinned, k)[rows] for k in ROWS}, inputs=tuple(x[rows] for x in thinned.inputs)
    )
    many = replace(
        many,
        shares=np.asfortranarray(unit * many.shares),
        wanted=unit * many.wanted,
        weights=np.asfortranarray(unit * many.weights),
    )
    sizes = (hidden, hidden, tuple(n + 1 for n in hidden))
    pairs = zip(many.inputs, many.targets.T, sizes, strict=True)
    networks = [initial_network(x, s, size, activation, 7) for x, s, size in pairs]
    at, direction = flatten_parts(networks), np.random.default_rng(1).normal(size=len(flatten_parts(networks)))
    seen = []
    for compiled in (True, False):
        mlp = PartsMlp(networks, many, compiled=compiled)
        _, loss = mlp.evaluate(at)
        gradient, product = mlp.accept(at), mlp.gram_product(direction)
        seen.append([loss, gradient, product, *map(np.triu, mlp.drawn_gram([3])), mlp.flop])
    assert seen[0][-1] == seen[1][-1]
    for in_c, in_numpy in zip(*seen, strict=True):
        np.testing.assert_allclose(in_c, in_numpy, rtol=0.0, atol=1e-5 * np.abs(in_numpy).max())
    np.testing.assert_allclose(seen[0][1], seen[1][1], rtol=1e-9, atol=1e-12 * np.abs(seen[1][1]).max())


@pytest.mark.parametrize("given", ["patch", "thinned"])
def test_the_patch_becomes_right(given, networks, request):
    fit = fit_parts(request.getfixturevalue(given), TrainingSettings(max_gflop=0.5), None, None, networks)
    training = fit.history["training_rms"]
    assert (np.diff(training) <= 0.0).all()
    assert fit.rms < 0.05 * training[0]
    assert fit.validation_rms < 0.1 * training[0]
    assert set(fit.networks) == set(NAMES)


def test_a_single_validation_row_does_not_choose_the_networks(patch, networks):
    """One that the start meets, and that goes far off with every step that is good for all others."""
    row = int(np.flatnonzero(patch.validation & (patch.wanted[:, 0] > 0.5))[0])
    start = np.array([network.value(x[[row]])[0] for network, x in zip(networks, patch.inputs, strict=True)])
    shares, wanted = patch.shares.copy(), patch.wanted.copy()
    shares[row] *= 1000.0
    wanted[row] = np.maximum(start, 0.0) ** 2 @ shares[row]
    odd = replace(patch, shares=shares, wanted=wanted)
    fit = fit_parts(odd, TrainingSettings(max_gflop=0.5), None, None, networks)
    assert fit.rms < 0.05 * fit.history["training_rms"][0]
    assert fit.validation_rms > 10.0, "what is told of the fit is true"


@pytest.mark.parametrize("compiled", [True, False])
def test_a_part_that_no_row_presses_stays_as_it_is(compiled, patch, networks):
    """Out of contact everywhere, without weight."""
    far = replace(networks[1], biases=(*networks[1].biases[:-1], networks[1].biases[-1] - 100.0))
    weights = patch.weights * np.array([1.0, 0.0, 1.0])
    mlp = PartsMlp([networks[0], far, networks[2]], replace(patch, weights=weights), compiled=compiled)
    at = flatten_parts([networks[0], far, networks[2]])
    lm = LevenbergMarquardt(mlp, at, 0)
    before = lm.loss
    assert lm.step()
    assert lm.loss < before
    own = slice(networks[0].parameter_count, networks[0].parameter_count + far.parameter_count)
    np.testing.assert_array_equal(lm.parameters[own], at[own])


def test_without_a_compiler_the_patch_becomes_right_too_and_a_warning_says_why_it_takes_long(
    patch, networks, monkeypatch
):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(RuntimeWarning, match=r"no C compiler: .*no-such-compiler.*; parts are trained in NumPy"):
        fit = fit_parts(patch, TrainingSettings(max_gflop=0.5), None, None, networks)
    assert fit.rms < 0.05 * fit.history["training_rms"][0]


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
    elsewhere = replace(patch, shares=patch.shares * (1.0 + np.finfo(float).eps))  # on a machine that rounds otherwise
    done = fit_parts(elsewhere, settings, tmp_path / "parts.npz", stop, networks)
    np.testing.assert_array_equal(done.history["gflop"], again.history["gflop"])
    with pytest.raises(ValueError, match="belongs to other data or settings"):
        fit_parts(replace(patch, shares=1.001 * patch.shares), settings, tmp_path / "parts.npz", None, networks)


def test_drawn_blocks_stand_for_all_rows(thinned, networks):
    """Each is the mean of those drawn with many seeds."""
    many = replace(
        thinned, **{k: np.tile(getattr(thinned, k), (3, *[1] * (getattr(thinned, k).ndim - 1))) for k in ROWS},
        inputs=tuple(np.tile(x, (3, 1)) for x in thinned.inputs),
    )  # fmt: skip
    mlp, at = PartsMlp(networks, many), flatten_parts(networks)
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
