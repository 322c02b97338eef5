"""A tiny real front: sizes trained and kept, everything measured, a size chosen for fewer loads."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli import main as cli
from casadi_contact.cli import pipeline
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.files.containers import read_npz
from casadi_contact.core.quantities import FORCE, quantity
from casadi_contact.samples.errors import domain_errors, rms_by_kind
from casadi_contact.samples.samples import TEST, write_samples
from casadi_contact.workflow import benchmark
from casadi_contact.workflow.benchmark import at_hand
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.choose import SAME_TIME
from casadi_contact.workflow.benchmark.front_file import SECONDS, read_front
from casadi_contact.workflow.benchmark.sizes import chart_surrogates, sized_path, subset_of, train_sizes
from casadi_contact.workflow.benchmark.walking import unseen_walking
from casadi_contact.workflow.presets import PRESETS, ChartEffort, Effort, Preset
from problems.studies import seeds, two_stage_work

TINY = Preset(
    sampling_scale=0.005,
    efforts={"patch": {"": Effort(((5, 5),), 0.3)}},
    chart=ChartEffort(
        sizes={
            "patch": (Effort(((4, 4),), 0.2), Effort(((6, 6),), 0.6)),
            "two_stage": (Effort(((4,),), 0.05, "tanh", max_rows=300),),
        },
        swept=("patch", (6, 6)),
        sample_counts=(100,),
        training_gflop=(0.1,),
    ),
)


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("front")
    (folder / "knee.toml").write_text(cc.load_scene("knee", settle=(40, 20), teacher=(80, 40)).to_toml())
    PRESETS["tiny"] = TINY
    patch = pytest.MonkeyPatch()
    patch.setattr(
        import_module("casadi_contact.workflow.benchmark.measure"), "_MEASUREMENT_S", 0.0
    )  # each time is that of a few calls
    patch.setattr(
        import_module("casadi_contact.contact.polar.choice"), "LADDER", (Rays(8, 2),)
    )  # coarser than the chosen
    try:
        made = pipeline.Project.open(folder / "knee.toml", "tiny", folder / "out")
        with ThreadPoolExecutor(1) as here:
            pipeline.sample(made, executor=here)
            pipeline.train(made, executor=here)
            benchmark.measure_project(made, executor=here)
        yield made
    finally:
        patch.undo()
        del PRESETS["tiny"]


def test_sizes_are_trained_anew_for_other_tolerances_and_kept_for_the_same(project, tmp_path):
    shutil.copytree(project.folder, tmp_path / "out")
    half = project.scene.with_tolerances(**{name: 0.5 * most for name, most in project.scene.tolerances.items()})
    other = replace(project, scene=half, folder=tmp_path / "out")
    wanted, times = chart_surrogates(TINY.chart, half)[:1], []
    for _ in range(2):
        with ThreadPoolExecutor(1) as here:
            (path,) = train_sizes(other, wanted, executor=here)
        assert cc.load_surrogate(path).scene.tolerances == half.tolerances
        times.append(path.stat().st_mtime_ns)
    assert times[0] == times[1]


@pytest.fixture(scope="module")
def measured(project):
    return read_front(project.folder / "speed_accuracy.csv")


def test_everything_planned_is_measured(project, measured):
    names = [point.name for point in measured.points]
    assert names[-7:] == [
        "patch tiny",
        "patch tiny (CasADi MX)",
        *(sized.name for sized in chart_surrogates(TINY.chart, cc.load_scene("knee"))),
    ]
    assert {"EF 20×15", "EF 15×20", "EF 40×30", "EF 80×40"} <= set(names)
    for point in measured.points:
        assert not point.failure
        assert 0.0 < point.value.low_us <= point.value.median_us <= point.value.high_us
        assert (point.hessian is None) == (point.family == "EF")
        assert set(point.load_rms) == set(measured.loads)
        assert point.domain_force_rms_n["D1"] < 1000.0


def test_the_foundation_stands_beside_networks_coarser_and_finer(project, measured, walking):
    poses, converged = walking
    points = [point for point in measured.points if point.family == "foundation"]
    assert cc.foundation(project.scene).resolution in " ".join(point.name for point in points)
    errors = [point.force_rms_n for point in points]
    assert len(errors) == 2
    assert errors == sorted(errors, reverse=True)
    for point in points:
        line = at_hand.python_line(str(project.folder.parent / "knee.toml"), point.name, measured.loads, None)
        model = eval(line, {"cc": cc})
        assert model.resolution in point.name
        rms = np.sqrt(np.mean((model(poses) - converged) ** 2, axis=0))
        np.testing.assert_allclose([point.load_rms[load] for load in model.load_names], rms, rtol=1e-4)


@pytest.fixture(scope="module")
def walking(project):
    """The unseen walking poses and the converged EF's loads there, made anew."""
    poses = unseen_walking(ElasticFoundation(project.scene, (40, 20)), pipeline.read_motion(project)[0])
    return poses, ElasticFoundation(project.scene, (160, 80))(poses)


def test_its_errors_are_those_against_a_converged_elastic_foundation(project, measured, walking):
    poses, converged = walking
    surrogate = cc.load_surrogate(sized_path(project, chart_surrogates(TINY.chart, cc.load_scene("knee"))[1]))
    rms = np.sqrt(np.mean((surrogate(poses) - converged) ** 2, axis=0))
    point = next(p for p in measured.points if p.name == "patch 6-6")
    np.testing.assert_allclose([point.load_rms[load] for load in surrogate.load_names], rms, rtol=1e-4)


def test_sizes_on_disk_are_kept_and_damaged_ones_made_again(project):
    first, second = (sized_path(project, sized) for sized in chart_surrogates(TINY.chart, cc.load_scene("knee"))[:2])
    kept, good = first.stat().st_mtime_ns, cc.load_surrogate(second)
    second.write_bytes(b"damaged")
    with ThreadPoolExecutor(1) as here:
        benchmark.train_sizes(project, executor=here)
    assert first.stat().st_mtime_ns == kept
    again, poses = cc.load_surrogate(second), project.samples().poses[:20]
    np.testing.assert_array_equal(again(poses), good(poses))  # from its checkpoints: nothing was trained again


def test_sizes_that_learned_other_samples_are_trained_anew(project, tmp_path):
    sized = chart_surrogates(TINY.chart, cc.load_scene("knee"))[0]
    later = replace(project, folder=tmp_path / "later")
    shutil.copytree(project.folder, later.folder)
    path, samples = sized_path(later, sized), later.samples()
    write_samples(later.samples_path, samples.rows(np.arange(len(samples)) % 7 > 0))
    shutil.rmtree(later.training_folder("sizes", sized.stem), ignore_errors=True)
    with ThreadPoolExecutor(1) as here:
        benchmark.train_sizes(later, [sized], executor=here)
    trained = sum(cc.load_surrogate(path).record["samples"].values())
    assert trained == (later.samples().role != TEST).sum() < (samples.role != TEST).sum()


def test_a_sweep_over_samples_learns_from_fewer_but_is_tested_on_the_same(project):
    samples = project.samples()
    few = subset_of(samples, 100)
    np.testing.assert_array_equal(few.select(role=TEST).poses, samples.select(role=TEST).poses)
    assert (few.role != TEST).sum() == 100
    assert subset_of(samples, 10**9) is samples


def test_a_size_that_is_gone_is_trained_for_just_the_loads(project, measured):
    point = next(p for p in measured.points if p.name == "patch 6-6")
    sized = next(s for s in chart_surrogates(TINY.chart, cc.load_scene("knee")) if s.name == "patch 6-6")
    sized_path(project, sized).rename(project.folder / "kept.h5")
    try:
        file = at_hand.make_surrogate(project, point.name, ["Fy_med", "Fy_lat"], None)
        surrogate = cc.load_surrogate(file)
        assert set(surrogate.networks) == {"root_med", "root_lat"}
        assert surrogate.load_names == ("Fy_med", "Fy_lat")
        times = at_hand.times_for_loads(project, measured.points, ["Fy_med", "Fy_lat"])
        assert times["patch 6-6"][1] == "timed again for these loads"
    finally:
        (project.folder / "kept.h5").rename(sized_path(project, sized))


@pytest.mark.parametrize("place", range(5))
def test_the_choice_on_a_real_front_meets_its_tolerance_on_unseen_samples(place, project, measured, walking):
    poses, converged = walking
    aim = sorted(measured.models, key=lambda point: point.force_rms_n)[place]
    force_n, torque_nmm = 1.001 * aim.force_rms_n, 1.001 * aim.torque_rms_nmm
    choice = cc.choose(
        project.folder.parent / "knee.toml",
        force_tolerance_n=force_n,
        torque_tolerance_nmm=torque_nmm,
        preset="tiny",
        folder=project.folder,
    )
    assert choice.model.time_us <= SAME_TIME * aim.value.median_us
    made = eval(choice.python, {"cc": cc})
    got = made(poses) if choice.path is None else np.array(made.map(len(poses))(poses.T)).T
    squares = np.mean((got - converged) ** 2, axis=0)
    forces = np.array([quantity(load).kind == FORCE for load in measured.loads])
    assert np.sqrt(squares[forces].mean()) <= 1.001 * force_n
    assert np.sqrt(squares[~forces].mean()) <= 1.001 * torque_nmm


def test_a_candidate_that_fails_stays_in_the_table(project):
    class Broken:
        load_names = ("Fy_med",)

        def __call__(self, poses):
            raise RuntimeError("out of\nluck")

    candidates = [Candidate("none", "A", None, failure="did not fit"), Candidate("broken", "B", Broken())]
    poses = pipeline.read_motion(project)[0].poses[0][:10]
    points = benchmark.measure(candidates, project.scene, poses, project.samples()).points
    assert [point.failure for point in points] == ["did not fit", "out of luck"]


def test_command_line_names_the_choice(project):
    """Which one it is, the fastest on this machine, is not the test's to say."""
    runner = CliRunner()
    scene = str(project.folder.parent / "knee.toml")
    common = ["choose", scene, "--preset", "tiny", "--out", str(project.folder)]
    said = runner.invoke(cli.app, [*common, "--force-tol", "1000", "--torque-tol", "50000"], env={"COLUMNS": "200"})
    assert said.exit_code == 0, said.output
    assert "chosen" in said.output
    assert "in Python: " in said.output
    only = runner.invoke(cli.app, [*common, "--force-tol", "1000", "--loads", "Fy_med,Fy_lat"], env={"COLUMNS": "200"})
    assert only.exit_code == 0, only.output
    assert "Cheapest model for Fy_med, Fy_lat within tolerance" in only.output
    wrong = runner.invoke(cli.app, [*common, "--force-tol", "1e-9", "--torque-tol", "1"])
    assert isinstance(wrong.exception, ValueError)
    assert "the nearest" in str(wrong.exception)


def test_the_chart_leaves_out_structures_that_do_not_fit_the_scene():
    """The shoulder's head presses along +z, which two_stage clamps: it was tried, and failed after minutes."""
    chart = PRESETS["quick"].chart
    assert {sized.structure for sized in chart_surrogates(chart, cc.load_scene("knee"))} == {"patch", "two_stage"}
    assert {sized.structure for sized in chart_surrogates(chart, cc.load_scene("glenohumeral"))} == {"patch"}


def test_seeds_scatter_the_errors_of_a_size(project):
    scene, folder = str(project.folder.parent / "knee.toml"), str(project.folder)
    options = ["--preset", "tiny", "--seeds", "2", "--widest", "5", "--out", folder]
    done = CliRunner().invoke(seeds.app, [scene, *options])
    assert done.exit_code == 0, done.output
    found = json.loads((project.folder / "seeds.json").read_text())["sizes"]
    assert set(found) == {"patch 4-4", "two_stage 4"}
    first, other = found["patch 4-4"]["D1"]["force"]
    own = cc.load_surrogate(sized_path(project, chart_surrogates(TINY.chart, project.scene)[0]))
    assert first == rms_by_kind(domain_errors(own, project.samples())["D1"])["force"]
    assert 0.0 < other != first


def test_of_a_scene_without_torques_only_forces_scatter():
    errors = [{"D1": rms_by_kind({"Fy": {"rms": rms, "max": 2.0}})} for rms in (1.0, 1.5)]
    assert seeds.spread_of(errors) == {"D1": {"force": [1.0, 1.5]}}


def test_a_preset_without_so_small_a_size_is_refused(project):
    with pytest.raises(ValueError, match="no size of up to 3"):
        seeds.seeded_sizes(project, 2, 3)


def test_the_paper_s_method_is_measured_with_several_budgets(project, monkeypatch):
    efforts = {"": Effort(((3, 3), (4, 4)), 0.05, "tanh"), "root": Effort(((3,),), 0.05)}
    monkeypatch.setitem(PRESETS, "tiny", replace(TINY, efforts={"two_stage": efforts}))
    scene, options = str(project.folder.parent / "knee.toml"), ["--preset", "tiny", "--out", str(project.folder)]
    done = CliRunner().invoke(two_stage_work.app, [scene, *options, "--gflop", "0.02", "--gflop", "0.5"])
    assert done.exit_code == 0, done.output
    front = read_front(project.folder / "two_stage_work.csv")
    assert front.header["command"].endswith("--preset tiny --gflop 0.02 --gflop 0.5")
    (less,) = (p for p in front.points if p.sweep == SECONDS)
    more = next(p for p in front.models if p.name == "two_stage 4-4")
    assert less.name == "two_stage 4-4 (0.02 Gflop)"
    assert more.parameters > less.parameters, "with more work its networks grow"
    assert all(0.0 < point.force_rms_n < 1000.0 and point.value.median_us > 0.0 for point in (less, more))
    assert {"foundation", "EF"} <= {point.family for point in front.models}
    folders = (project.folder / "two_stage_work" / f"{gflop}_gflop" for gflop in ("0.02", "0.5"))
    first, gone_on = (read_npz(folder / "Fy_med.npz")["history_size"] for folder in folders)
    assert first[-1] == 1, "grown within the smaller budget"
    np.testing.assert_array_equal(gone_on[: len(first)], first, "the larger budget goes on from there")


def test_a_preset_without_two_stage_is_refused(project):
    with pytest.raises(ValueError, match="preset tiny trains no two_stage for scene knee, expected a preset with it"):
        two_stage_work.train_with_work(project, [1.0])
