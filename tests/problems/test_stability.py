"""Every row of the stability table of a knee, at a tiny scale: it measures what its name says."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.optimisation.starts import pose_bounds
from problems.studies.stability import (
    __main__,
    bad_training_data,
    clusters,
    consistency,
    derivative_steps,
    liftoff,
    methods,
    out_of_range,
    single_precision,
    starts,
    time_steps,
)
from problems.studies.stability.differences import by_differences
from problems.studies.stability.methods import EF_ANALYTIC, EF_COARSE, FOUNDATION, METHODS, PATCH, TWO_STAGE
from problems.studies.stability.peers import KRIGING, PEERS
from problems.studies.stability.picture import draw
from problems.studies.stability.table import Line, print_table, write_table
from tests.support.command import ended


@pytest.fixture(scope="module")
def bench():
    return methods.bench(peer_points=150, peer_gflop=10.0)


def only(bench, *chosen):
    return replace(bench, models={m: bench.models[m] for m in chosen})


def by_quantity(lines, method):
    return {(line.case, line.quantity): line.values.get(method) for line in lines}


class LinearModel(ContactModel):
    """Wrench = matrix·pose, as a contact model without contact."""

    load_names, patch_names = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"), ("all",)

    def __init__(self, matrix):
        self.matrix = np.asarray(matrix, dtype=float)

    def __call__(self, poses):
        return poses @ self.matrix.T

    def jacobian(self, poses):
        return self(poses), np.tile(self.matrix, (len(poses), 1, 1))


def test_starts_lie_at_the_stated_distance_and_the_patch_surrogate_solves_from_them(bench):
    gaps_of = ElasticFoundation(bench.scene, bench.scene.grids["coarse"])
    for lift in (5.0, -2.0):
        begun = starts.lifted(gaps_of, bench.poses[::25], lift, np.random.default_rng(0))
        np.testing.assert_allclose(gaps_of.gaps(begun).min(axis=1), lift, atol=1e-3)
    lines, row = starts.measure(only(bench, PATCH, EF_ANALYTIC, KRIGING), 4, (5.0, -2.0))
    assert row["shares"][PATCH] == row["shares"][EF_ANALYTIC] == [1.0, 1.0]
    assert row["shares"][KRIGING][0] == 0.0, "out of contact it has no slope to come back by"
    assert starts.measure(only(bench, FOUNDATION), 4, (5.0, -2.0))[1]["shares"][FOUNDATION] == [1.0, 1.0]
    assert by_quantity(lines, PATCH)["5 mm out", "of 4 solved [%]"] == 100.0
    used = [by_quantity(lines, method)["5 mm out", "iterations"] for method in (PATCH, EF_ANALYTIC)]
    assert used[0] == pytest.approx(used[1], abs=3), "of the same method on nearly the same loads"


def test_elements_by_differences_come_back_from_far_out_as_those_with_derivatives_do(bench):
    shares = starts.measure(only(bench, EF_COARSE, EF_ANALYTIC), 2, (20.0,))[1]["shares"]
    assert shares == {EF_COARSE: [1.0], EF_ANALYTIC: [1.0]}


@pytest.mark.parametrize("peer", PEERS)
def test_peers_are_contact_models_with_slopes_and_root_loads(bench, peer):
    if peer not in bench.models:
        pytest.skip(bench.missing[peer])
    model, poses = bench.models[peer], bench.poses[::20]
    loads, jacobian = model.jacobian(poses)
    step = 1e-5 * np.eye(6)[1]
    slope = (model(poses + step) - model(poses - step)) / 2e-5
    np.testing.assert_allclose(jacobian[:, :, 1], slope, atol=2e-3 * np.abs(slope).max())
    roots, _ = model.root_loads(poses)
    normal = -loads[:, [model.load_names.index(name) for name in bench.scene.sensitive_loads]]
    np.testing.assert_allclose(bench.scene.reference_load * roots**2, np.maximum(normal, 0.0), rtol=1e-9)


def test_at_lift_off_the_patch_surrogate_bends_where_two_stages_have_a_kink(bench):
    pose = bench.poses[0]
    patch, paper = bench.models[PATCH], bench.models[TWO_STAGE]
    height = liftoff.lift_off_height(patch, pose)
    edge = liftoff.one_sided(patch, pose, height)
    at = pose + height * np.eye(6)[1]
    slope = patch.root_loads(at[None])[1][0, 1, 1]
    bend = 2.0 * bench.scene.reference_load * slope**2  # d²/dty² of N0·s², where s = 0
    assert edge["N"][0] < 1e-3
    assert abs(edge["dN"][0]) < 1e-3 * bend
    assert edge["ddN"][0] == pytest.approx(bend, rel=0.02)
    assert edge["N"][1] == edge["dN"][1] == edge["ddN"][1] == 0.0
    kink = liftoff.one_sided(paper, pose, liftoff.lift_off_height(paper, pose))
    assert kink["dN"][0] < -100.0, "N/mm, from one side to the other"
    assert kink["dN"][1] == 0.0


def test_one_side_lifts_off_and_lands_where_it_came_from(bench):
    pose = bench.poses[0].copy()
    poses, used, solved = liftoff.path(bench.models[PATCH], pose, 9)
    assert solved.all()
    assert used.max() < 30
    np.testing.assert_allclose(poses, poses[::-1], atol=1e-7)
    gaps = bench.models[EF_ANALYTIC].gaps(poses)
    assert gaps[4, 1] > 0.5, "the lateral side is off"
    assert gaps[[0, 8], 1].max() < 0.0, "and on again"


def test_the_course_that_others_are_compared_with_is_named_after_its_grid(bench):
    coarse = replace(only(bench, PATCH), teacher=ElasticFoundation(bench.scene, (40, 30)))
    assert set(liftoff.measure(coarse, 3)[1]) == {"EF 40×30", PATCH}


def test_failures_out_of_range_are_counted(bench):
    patch = bench.models[PATCH]
    pose = bench.poses[33]
    tall = out_of_range.along(patch, pose, "ty", 7)
    low, high = (bound[1] for bound in pose_bounds(patch))
    assert np.ptp(tall[:, 1]) == pytest.approx(3.0 * (high - low))
    np.testing.assert_array_equal(tall[:, [0, 2, 3, 4, 5]], np.tile(pose[[0, 2, 3, 4, 5]], (7, 1)))

    class Wrong:
        scene, load_names = bench.scene, bench.scene.load_names

        def __call__(self, poses):
            loads = np.zeros((len(poses), len(self.load_names)))
            loads[0, 0], loads[1, 1], loads[2, 4] = -1.0, 1.0, np.nan
            return loads

    apart = np.tile(pose + 10.0 * np.eye(6)[1], (4, 1))
    assert out_of_range.count_failures(Wrong(), apart, bench.models[EF_ANALYTIC]) == (1, 1, 1, None)


def test_no_surrogate_or_foundation_breaks_far_out(bench):
    lines, _ = out_of_range.measure(only(bench, PATCH, EF_ANALYTIC), 2000, 20)
    for line in lines:
        for method in (PATCH, EF_ANALYTIC):
            broken, pulling, apart, valid = line.values[method].split(" / ")
            assert (broken, pulling) == ("0", "0")
            assert valid == ("0" if method == PATCH else "-")
            assert method == PATCH or apart == "0"


def test_central_differences_of_a_smooth_model_err_with_the_step_squared(bench):
    poses = bench.poses[::30]
    patch = bench.models[PATCH]
    true = patch.jacobian(poses)[1]
    errors = [
        derivative_steps.relative_error(by_differences(patch, poses, step, central=True), true, patch.load_names)
        for step in (1e-3, 2e-3, 1e-9)
    ]
    assert errors[1] == pytest.approx(4.0 * errors[0], rel=0.05)
    assert errors[2] > errors[0], "below it, rounding"


def test_differences_of_a_foundation_err_where_a_step_changes_what_touches(bench):
    lines, row = derivative_steps.measure(only(bench, PATCH, EF_COARSE, EF_ANALYTIC), 2, np.array([1e-3]))
    assert row["errors"][EF_COARSE][0] > 100.0 * row["errors"][PATCH][0]
    assert EF_ANALYTIC not in row["errors"]
    (last,) = [line for line in lines if "as used" in line.case]
    assert last.values[PATCH] < 0.02


def test_repeated_points_cannot_be_factorised_and_a_nugget_mends_it(bench):
    if KRIGING not in bench.models:
        pytest.skip(bench.missing[KRIGING])
    lines, _ = clusters.measure(bench, (0.0,), (0.0, 1e-6), points=120)
    cells = [line.values[KRIGING] for line in lines]
    clean, _, repeated, mended = cells
    assert "cannot" in repeated
    assert float(clean.split(" / ")[0]) < 1e12
    assert float(mended.split(" / ")[0]) < 1e12


def test_surrogate_and_foundation_allow_the_same_explicit_step(bench):
    _, curves = time_steps.measure(only(bench, PATCH, EF_ANALYTIC), (200.0, 800.0), ("rk4",), 40)
    np.testing.assert_allclose(curves[PATCH]["rk4"], curves[EF_ANALYTIC]["rk4"], rtol=0.05)
    assert curves[PATCH]["stiffness"][1] > curves[PATCH]["stiffness"][0]
    assert curves[PATCH]["rk4"][1] < curves[PATCH]["rk4"][0]


@pytest.mark.parametrize("method", [PATCH, TWO_STAGE])
def test_hessians_of_networks_are_the_slope_of_their_gradients(bench, method):
    network = next(iter(bench.models[method].networks.values()))
    at = network.input_shift + 0.3 * network.input_scale * np.random.default_rng(2).uniform(-1.0, 1.0, (3, 6))
    got = single_precision.hessian(network, at)
    for column, scale in enumerate(network.input_scale):
        step = 1e-5 * scale * np.eye(6)[column]
        slope = (network.value_and_gradient(at + step)[1] - network.value_and_gradient(at - step)[1]) / (2e-5 * scale)
        np.testing.assert_allclose(got[:, 0, :, column], slope, atol=1e-6 * np.abs(got[..., column]).max())


def test_float32_keeps_seven_digits_and_ipopt_notices(bench):
    patch = bench.models[PATCH]
    single = single_precision.in_single_precision(patch)
    poses = bench.poses[::20]
    off = np.abs(single(poses) - patch(poses))[:, :2].max()
    assert 1e-5 < off < 1.0
    rounded = single_precision.RoundedFunction(patch.function(), "rounded")
    slope = np.asarray(rounded.jacobian()(poses[0], 0))
    assert (slope == np.float32(slope)).all()
    np.testing.assert_allclose(slope, patch.jacobian(poses[:1])[1][0], rtol=1e-2, atol=1.0)
    lines, _ = single_precision.measure(only(bench, PATCH), 1)
    (converged,) = [line.values[PATCH] for line in lines if line.quantity.startswith("float64")]
    assert converged.startswith("1 / 1 / ")


def smooth_regression(count=300):
    x = np.random.default_rng(3).uniform(-1.0, 1.0, (count, 6))
    target = np.sin(x[:, 0]) + x[:, 1] * x[:, 2]
    return Regression("smooth", x, target, np.ones(count), np.arange(count) % 5 == 0, 0.0)


@pytest.mark.parametrize("case", list(bad_training_data.CASES))
def test_bad_training_data_end_with_numbers_a_reason_and_an_error_that_tells(case):
    clean = smooth_regression()
    settings = TrainingSettings(sizes=((6,),), max_iterations=60, restarts=0)
    truth = bad_training_data.constant_output(clean) if case == "constant output" else clean
    error, said, stop = bad_training_data.outcome(bad_training_data.CASES[case](clean), truth, settings)
    if case == "a NaN":
        assert "refused" in stop
        assert "row 7" in stop
        return
    assert stop
    assert np.isfinite(error)
    assert said >= 0.3 * error, "what the fit reports is no promise that clean rows break"
    if case == "constant output":
        assert error < 1e-6
    if case == "1 % outliers":
        usual, _, _ = bad_training_data.outcome(clean, clean, settings)
        assert error > usual


def test_a_spring_has_no_curl_and_a_shear_flow_has(bench):
    poses = bench.poses[:3]
    spring = np.diag([-3.0, -2.0, -1.0, 0.0, 0.0, 0.0])
    # Isotropic, its torque about the fixed origin is zero: t × F with F along t.
    k = consistency.stiffness(LinearModel(np.diag([-2.0, -2.0, -2.0, 0.0, 0.0, 0.0])), poses)
    assert consistency.curl(k).max() < 1e-12
    flow = np.zeros((6, 6))
    flow[0, 1] = 1.0
    assert consistency.curl(flow[None])[0] == pytest.approx(np.sqrt(0.5))
    assert consistency.curl(spring[None])[0] == 0.0


def test_stiffnesses_of_rotations_are_those_of_a_lever_of_25_mm():
    springs = np.array([3.0, 2.0, 1.0, 4e3, 5e3, 6e3])  # N/mm and N·mm/rad
    (k,) = consistency.stiffness(LinearModel(-np.diag(springs)), np.zeros((1, 6)))
    np.testing.assert_allclose(k, -np.diag([3.0, 2.0, 1.0, 6.4, 8.0, 9.6]), atol=1e-12)


def test_the_patch_surrogate_has_nearly_the_stiffness_of_the_foundation(bench):
    lines, _ = consistency.measure(only(bench, PATCH, TWO_STAGE))
    curl_patch, _, _, off_patch = (line.values[PATCH] for line in lines)
    curl_paper, _, _, off_paper = (line.values[TWO_STAGE] for line in lines)
    assert curl_patch < curl_paper < 2.0
    assert off_patch < off_paper < 5.0


def test_the_table_is_written_with_reasons_for_its_empty_cells(tmp_path, capsys):
    lines = [Line(5, "clusters [1]", "error", {KRIGING: 0.25}, {PATCH: "has no matrix"})]
    write_table(lines, tmp_path, {"count": 1}, {"1": {}})
    (row,) = csv.DictReader((tmp_path / "stability.csv").open(encoding="utf-8"))
    assert (row[KRIGING], row[PATCH], row["remarks"]) == ("0.25", "-", "patch: has no matrix")
    assert [name for name in row if name in METHODS] == [PATCH, KRIGING], "the methods that the lines tell of"
    assert json.loads((tmp_path / "stability.json").read_text("utf-8"))["lines"][0]["case"] == "clusters [1]"
    print_table(lines)
    assert "patch: has no matrix" in capsys.readouterr().out


def test_the_picture_shows_the_rows_there_are(tmp_path):
    draw({"2": {}}, tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()
    draw({"1": {"lifts_mm": [1.0, -1.0], "shares": {PATCH: [1.0, 0.5]}}}, tmp_path / "one.png")
    assert (tmp_path / "one.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("rows", ["0", "1,x", "10", ","])
def test_a_mistake_is_one_line(monkeypatch, tmp_path, rows):
    said = ended(monkeypatch, __main__.main, "--rows", rows, "--out", tmp_path)
    assert said.startswith(f"stability: rows is {rows!r}, expected some of 1, 2, 3, 4, 5, 6, 7, 8, 9")
