"""The choice meets its tolerance, and nothing cheaper on the front does."""

import shlex
import shutil
from functools import partial

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.cli import main as cli
from casadi_contact.contact.polar.foundation import RayChoice
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.quantities import FORCE, quantity
from casadi_contact.scenes.tolerance import Tolerance
from casadi_contact.workflow.benchmark.choose import Offer, cheapest, within_tolerance
from casadi_contact.workflow.benchmark.front_file import read_front
from tests.support.shared_data import SPEED_ACCURACY as STORED

TOLERANCES = [(50.0, 1000.0), (5.0, 100.0), (2.0, 40.0), (0.5, 20.0), (0.12, 3.5)]


@pytest.fixture
def folder(tmp_path):
    """A folder that holds the stored measurements, and nothing else."""
    shutil.copy(STORED, tmp_path / "speed_accuracy.csv")
    return tmp_path


def rms(point, loads, force):
    squares = [point.load_rms[load] ** 2 for load in loads if (quantity(load).kind == FORCE) == force]
    return np.sqrt(np.mean(squares)) if squares else 0.0


@pytest.mark.parametrize("loads", [None, ["Fy_med", "Fy_lat"], ["Tz"]])
@pytest.mark.parametrize(("force_n", "torque_nmm"), TOLERANCES)
def test_the_choice_meets_its_tolerance_and_nothing_cheaper_does(force_n, torque_nmm, loads):
    front = read_front(STORED)
    names = loads or front.loads
    offers = within_tolerance(front, Tolerance.of_kinds(force_n, torque_nmm), names)
    choice, better = cheapest(offers, Tolerance.of_kinds(force_n, torque_nmm))
    points = {point.name: point for point in front.points}
    chosen = points[choice.name]
    assert rms(chosen, names, True) <= force_n
    assert rms(chosen, names, False) <= torque_nmm
    times = {offer.name: offer.time_us for offer in offers}
    assert choice.time_us == min(times.values())
    for point in front.models:
        if point.value.median_us < chosen.value.median_us:
            assert rms(point, names, True) > force_n or rms(point, names, False) > torque_nmm
    if better is not None:
        used, least = (
            max(rms(points[offer.name], names, True) / force_n, rms(points[offer.name], names, False) / torque_nmm)
            for offer in (choice, better)
        )
        assert least < used <= 1.0
        assert better.time_us >= choice.time_us


@pytest.mark.parametrize(
    ("models", "names"),
    [
        ({"rough": (0.212, 1.5), "fine": (0.213, 0.5), "finest": (0.3, 0.2)}, ("fine", "finest")),
        ({"dear": (9.0, 0.1), "worse": (2.0, 1.8), "next": (3.0, 0.9), "first": (1.0, 1.5)}, ("first", "next")),
    ],
)
def test_of_models_that_are_as_cheap_the_most_accurate_is_chosen_and_then_the_cheapest_better_one(models, names):
    offers = [Offer(name, time_us, force_n, float("nan")) for name, (time_us, force_n) in models.items()]
    assert tuple(each.name for each in cheapest(offers, Tolerance.of_kinds(2.0, None))) == names


def test_an_elastic_foundation_is_chosen_where_it_is_enough_and_told_how_to_make(folder):
    front = read_front(STORED)
    ef = min((p for p in front.points if p.family == "EF"), key=lambda p: p.value.median_us)
    lines = [line for line in STORED.read_text("utf-8").splitlines() if line[0] == "#" or line[:5] == "name,"]
    rows = [line for line in STORED.read_text("utf-8").splitlines() if line.startswith("EF ")]
    (folder / "speed_accuracy.csv").write_text("\n".join(lines + rows) + "\n", "utf-8")
    choice = cc.choose("knee", force_tolerance_n=100.0, torque_tolerance_nmm=3000.0, folder=folder)
    assert choice.model.name == ef.name
    assert choice.path is None
    model = eval(choice.python, {"cc": cc})
    assert model(np.array([[0.5, 27.4, 0.1, 0.0, -0.05, -0.3]])).shape == (1, 7)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"force_tolerance_n": 1e-6, "torque_tolerance_nmm": 1.0}, "no measured model .*the nearest"),
        ({"force_tolerance_n": 1.0}, "no torque tolerance given"),
        ({"force_tolerance_n": -1.0, "torque_tolerance_nmm": 1.0}, "force tolerance is -1.0, expected N above 0"),
        ({"force_tolerance_n": 1.0, "loads": "Fq"}, "loads Fq, expected some of Fy_med"),
    ],
)
def test_what_cannot_be_chosen_is_said_in_one_line(arguments, said, folder):
    with pytest.raises(ValueError, match=said) as caught:
        cc.choose("knee", folder=folder, **arguments)
    assert "\n" not in str(caught.value)


def test_without_measurements_it_measures_the_foundation_and_elements_of_the_scene(tmp_path, monkeypatch):
    monkeypatch.setattr("casadi_contact.contact.choice.POLAR_LADDER", (Rays(8, 2),))
    few = partial(RayChoice, poses=64, elements=(160, 80), poses_on_elements=16)
    monkeypatch.setattr("casadi_contact.contact.polar.foundation.RayChoice", few)
    monkeypatch.setattr("casadi_contact.workflow.benchmark.measure.built_in_motion", lambda scene: None)
    poses = np.array([[0.0, 29.9, 0.0, 0.0, 0.0, 0.0], [0.0, 29.8, 0.0, 0.0, 0.0, 0.0]])
    monkeypatch.setattr("casadi_contact.workflow.benchmark.measure.unseen_walking", lambda *_: poses)
    (tmp_path / "ball.toml").write_text(cc.load_scene("sphere_on_plane", teacher=(80, 40)).to_toml())
    wanted, told = {"force_tolerance_n": 1.0, "torque_tolerance_nmm": 50.0}, []
    choice = cc.choose(tmp_path / "ball.toml", **wanted, folder=tmp_path / "out", tell=told.append)
    assert any(name.startswith("foundation") for name in told)
    assert cc.choose(tmp_path / "ball.toml", **wanted, folder=tmp_path / "out") == choice, "from the file"


def test_measurements_of_another_scene_are_refused(folder):
    (folder / "other.toml").write_text(cc.load_scene("knee", settle=(40, 20)).to_toml())
    with pytest.raises(ValueError, match="another scene"):
        cc.choose(folder / "other.toml", force_tolerance_n=1.0, torque_tolerance_nmm=1.0, folder=folder)


def test_a_command_that_is_named_as_the_cure_finds_the_same_scene_and_folder(tmp_path, monkeypatch, capsys):
    """chart names sample, as it has to be typed, here of a scene file in another folder."""
    (tmp_path / "my scenes").mkdir()
    (tmp_path / "my scenes" / "ball.toml").write_text(cc.load_scene("sphere_on_plane").to_toml())
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr("sys.argv", shlex.split("casadi-contact chart '../my scenes/ball.toml' --out out"))
    with pytest.raises(SystemExit) as ended:
        cli.main()
    said = f"{ended.value.code} {capsys.readouterr().err}"
    assert "Traceback" not in said
    words = shlex.split(said.partition(": run ")[2].partition(" first")[0])
    assert words == ["casadi-contact", "sample", "../my scenes/ball.toml", "--preset", "quick", "--out", "out"]
