"""Networks trained in batches on a torch device are as good as those trained alone; products and steps are equal.

Tensors of the processor stand for a device in every test; where there is a GPU, it is tested as well.
"""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training on a device needs the extra train")

from casadi_contact.network import Regression  # noqa: E402
from casadi_contact.training import TrainingSettings, fit, fit_all  # noqa: E402
from casadi_contact.training.arrays import NumpyArrays, arrays_for  # noqa: E402
from casadi_contact.training.batch import Batch, Member  # noqa: E402
from casadi_contact.training.batch_mlp import BatchMlp  # noqa: E402
from casadi_contact.training.levenberg_marquardt import LevenbergMarquardt, State  # noqa: E402
from casadi_contact.training.mlp import Mlp  # noqa: E402
from casadi_contact.training.weights import flatten, initial_network  # noqa: E402
from tests.support.regressions import smooth  # noqa: E402

HAVE_GPU = torch.cuda.is_available()
DEVICES = ["cpu:0", pytest.param("cuda", marks=pytest.mark.skipif(not HAVE_GPU, reason="no GPU here"))]
DATA = [smooth(rows=400 + 137 * k, seed=k, name=f"member {k}") for k in range(3)]
DATA[1] = replace(DATA[1], targets=DATA[1].targets - 1.0, false_load=np.where(DATA[1].targets < 1.0, 50.0, 0.0))
SETTINGS = TrainingSettings(sizes=((6, 5),), max_gflop=300.0, max_iterations=60)


@pytest.fixture(params=DEVICES)
def device(request):
    return request.param


def columns(data: Regression, kept):
    part = data.of_rows(np.arange(len(data.targets))[kept])
    return part.inputs, part.targets, part.weights, part.false_load


def networks(hidden=(6, 5), activation="algebraic"):
    return [initial_network(d.inputs, d.targets, hidden, activation, seed=k) for k, d in enumerate(DATA)]


def same(member, alone, **accuracy):
    np.testing.assert_allclose(member, alone, **{"rtol": 1e-10, "atol": 1e-12 * np.abs(alone).max(), **accuracy})


@pytest.mark.parametrize("activation", ["algebraic", "tanh"])
def test_products_of_a_batch_are_those_of_its_members(device, activation):
    likes, everyone = networks(activation=activation), np.ones(3, dtype=bool)
    arrays = arrays_for(device)
    batch = BatchMlp(likes, [columns(d, slice(None)) for d in DATA], arrays, chunk_rows=97)
    parameters = arrays.array(np.stack([flatten(like) for like in likes]))
    solved, losses = batch.evaluate(parameters, everyone)
    gradients = arrays.numpy(batch.accept(parameters, everyone))
    products = arrays.numpy(batch.gram_product(parameters, everyone))
    chosen, scales = [np.arange(3, 9), np.arange(20)], [np.full(6, 0.5), np.linspace(1.0, 2.0, 20)]
    grams = arrays.numpy(batch.gram([0, 2], chosen, scales))
    for k, (like, data) in enumerate(zip(likes, DATA, strict=True)):
        mlp = Mlp(like, *columns(data, slice(None)), NumpyArrays())
        _, own_loss = mlp.evaluate(flatten(like))
        same(losses[k], own_loss)
        same(batch.losses(solved)[k], own_loss)
        mlp.evaluate(flatten(like), solve_output=False)
        same(gradients[k], mlp.accept(flatten(like)))
        same(products[k], mlp.gram_product(flatten(like)))
        if k != 1:
            upper = np.triu_indices(mlp.parameter_count)
            gram = mlp.gram(chosen[k // 2], scales[k // 2])
            same(grams[k // 2][upper], gram[upper])


def test_every_member_takes_the_steps_it_takes_alone(device):
    """Ten times one step from where the batch stands, preconditioned anew: several steps, and steps along a dozen
    conjugate directions, amplify rounding, alone on NumPy and alone on torch alike."""
    members = [
        Member(like, columns(d, ~d.validation), columns(d, d.validation), 7 + k, flatten(like))
        for k, (like, d) in enumerate(zip(networks(), DATA, strict=True))
    ]
    batch = Batch(members, arrays_for(device), chunk_rows=100)
    for _ in range(10):
        alone = [
            LevenbergMarquardt(
                Mlp(m.like, *m.training, NumpyArrays()), flatten(m.like), m.seed, m.state() if m.iterations else None
            )
            for m in members
        ]
        before = [(m.flop, lm.flop) for m, lm in zip(members, alone, strict=True)]
        batch.step()
        for m, lm, (in_batch, by_itself) in zip(members, alone, before, strict=True):
            lm.step()
            same(m.loss, lm.loss, rtol=1e-9)
            same(m.damping, lm.damping, rtol=1e-6)
            assert m.iterations == lm.state().iterations
            judged = 2 * len(m.validation[1]) * len(m.parameters)
            assert m.flop - in_batch == lm.flop - by_itself + judged


def test_a_batch_is_as_accurate_as_single_fits(device):
    """Over six fits: a single one differs from another by more than this, as two seeds do."""
    data = [smooth(rows=300, seed=k, name=f"fit {k}") for k in range(6)]
    together = fit_all(data, lambda r: replace(SETTINGS, max_iterations=100, device=device))
    alone = {d.name: fit(d, replace(SETTINGS, max_iterations=100)) for d in data}
    ratios = [together[d.name].rms / alone[d.name].rms for d in data]
    assert 0.6 < np.median(ratios) < 1.6
    assert max(together[d.name].rms for d in data) < 3.0 * max(fit.rms for fit in alone.values())
    for d in data:
        weighted = d.residuals(together[d.name].network)
        assert together[d.name].rms == pytest.approx(np.sqrt(np.mean(weighted[~d.validation] ** 2)))


def test_members_stop_grow_and_restart_each_for_itself(device):
    """A member that meets its tolerance ends while others go on, and grow into the batch of a larger shape."""
    sizes = ((2,), (6, 5))
    easy = replace(DATA[0], name="easy", tolerance=1e3)
    settings = replace(SETTINGS, sizes=sizes, max_iterations=120, stall_window=20, stall_improvement=0.5, device=device)
    fits = fit_all([easy, *DATA], lambda r: settings)
    assert fits["easy"].stop_reason == "error reached"
    assert fits["easy"].hidden == (2,)
    for data in DATA:
        assert fits[data.name].hidden == (6, 5)
        rms, size = fits[data.name].history["training_rms"], fits[data.name].history["size"]
        assert rms[size == 1].min() < 0.5 * rms[size == 0].min()


class KilledError(Exception):
    pass


def test_a_killed_batch_goes_on_from_its_checkpoints_on_any_device(device, tmp_path):
    settings = replace(SETTINGS, checkpoint_every_s=0.0, device=device)
    told = []

    def killer(*line):
        told.append(line)
        if len(told) == 50:
            raise KilledError

    with pytest.raises(KilledError):
        fit_all(DATA, lambda r: settings, None, tmp_path, killer)
    begun = fit_all(DATA, lambda r: replace(settings, max_iterations=1), None, tmp_path)
    done = {name: len(part.history["gflop"]) for name, part in begun.items()}
    assert set(done.values()) == {17, 18}, "50 whole iterations of three members, and one more that finds the limit"
    here = fit_all(DATA, lambda r: replace(settings, device="cpu"), None, tmp_path)
    for name, part in begun.items():
        np.testing.assert_array_equal(here[name].history["gflop"][: done[name]], part.history["gflop"])
        assert len(here[name].history["gflop"]) == SETTINGS.max_iterations
        assert here[name].rms < part.rms


def test_a_state_of_before_the_first_iteration_is_begun():
    """What a checkpoint holds that is written when a network has grown but not yet made a step."""
    like, data = networks()[0], DATA[0]
    member = Member(like, columns(data, ~data.validation), columns(data, data.validation), 3, flatten(like))
    state = member.state()
    assert isinstance(state, State)
    assert state.iterations == 0
    going_on = LevenbergMarquardt(Mlp(like, *member.training, NumpyArrays()), flatten(like) * 0.0, 3, state)
    begun = LevenbergMarquardt(Mlp(like, *member.training, NumpyArrays()), flatten(like), 3)
    assert going_on.loss == begun.loss


def test_several_devices_and_unknown_ones_are_refused():
    with pytest.raises(ValueError, match="devices cpu, cpu:0, expected one"):
        fit_all(
            DATA[:2], {d.name: replace(SETTINGS, device=f"cpu{end}") for d, end in zip(DATA, ("", ":0"), strict=False)}
        )
    with pytest.raises(ValueError, match="device 'magic' cannot be used"):
        fit_all(DATA[:1], lambda r: replace(SETTINGS, device="magic"))
    if not HAVE_GPU:
        with pytest.raises(ValueError, match=r"device 'cuda' cannot be used .* expected 'cpu' or a torch device"):
            fit_all(DATA[:1], lambda r: replace(SETTINGS, device="cuda"))


def test_networks_of_several_outputs_or_spots_are_fitted_beside_the_batches(device):
    spots = replace(DATA[0], name="spots", spots=2)
    several = Regression(
        "several", DATA[1].inputs, *(np.stack([a, 2.0 * a], 1) for a in (DATA[1].targets, DATA[1].weights)),
        DATA[1].validation, 0.0,
    )  # fmt: skip
    fits = fit_all([spots, DATA[2], several], lambda r: replace(SETTINGS, max_iterations=8, device=device))
    assert list(fits) == ["spots", DATA[2].name, "several"]
    assert [fits[name].network.outputs for name in fits] == [2, 1, 2]
    for fitted in fits.values():
        assert fitted.rms < 0.5 * fitted.history["training_rms"][0]


def test_data_that_is_not_finite_at_the_start_is_refused_by_a_batch():
    huge = replace(DATA[0], weights=np.full(len(DATA[0].weights), 1e300))
    with pytest.raises(ValueError, match="not finite"):
        fit_all([huge], lambda r: replace(SETTINGS, device="cpu:0"))
