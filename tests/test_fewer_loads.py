"""A scene that asks for fewer loads is sampled, learned and evaluated for these, about a single cycle of its own."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.cli import pipeline
from casadi_contact.cli.tables import evaluation_tables, read_evaluation
from casadi_contact.scenes.load_cycle import write_cycle
from casadi_contact.scenes.loading import scene_from_text
from casadi_contact.scenes.walking import has_gait, reference_cycle
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.workflow.presets import PRESETS, Effort, Preset
from tests.support.two_spheres import TwoSpheres

TINY = Preset(0.02, {"patch": {"": Effort(((8, 8),), 3.0)}})


def asking_for(*names):
    text = f'format = 1\nname = "fewer"\nlike = "knee"\n[loads]\nnames = {list(names)}\n[tolerances]\n'
    return scene_from_text(text + "\n".join(f"{name} = 5.0" for name in names))


def test_one_side_is_built_about_one_cycle(tmp_path, monkeypatch):
    monkeypatch.setitem(PRESETS, "tiny", TINY)
    (tmp_path / "side.toml").write_text(asking_for("Fy_lat").to_toml())
    write_cycle(reference_cycle(frames=21), tmp_path / "squat.csv")
    model = TwoSpheres(cc.load_scene(tmp_path / "side.toml"))
    out = tmp_path / "out"
    built = cc.build(tmp_path / "side.toml", "tiny", model=model, cycles=[tmp_path / "squat.csv"], folder=out)
    assert set(built["patch"].networks) == {"root_med", "root_lat"}, "validity goes by both sides"
    assert built["patch"].load_names == ("Fy_lat",)
    samples = pipeline.Project.open(tmp_path / "side.toml", "tiny", out).samples()
    pressed = samples.select("D1")
    want = pressed.loads(["Fy_lat"])
    assert np.std(built["patch"](pressed.poses) - want) < 0.2 * np.std(want)
    content = read_evaluation(out / "evaluation.json")
    assert "walking" not in content, "an elastic foundation of the scene is not the model that was learned"
    assert len(evaluation_tables(content)) == 1 + len(content["domain_errors"])


@pytest.mark.parametrize("names", [["Fy_lat"], ["Fy_med", "Fy_lat"], ["Fy", "Fx"], ["Tz"]])
def test_a_knee_walks_whichever_loads_are_asked_for(names):
    assert has_gait(asking_for(*names))


def test_sides_of_which_different_loads_are_asked_for_are_no_mirror_images():
    """A network that gives Fx of one side reflects to one that gives Fx of the other, not Fz."""
    assert PatchSurrogate.twins(asking_for("Fx_med", "Fz_lat")) == {}
    assert set(PatchSurrogate.twins(asking_for("Fx_med", "Fx_lat"))) == {"root_lat", "ratios_lat"}
    assert PatchSurrogate.twins(asking_for("Fy")) == {"root_lat": "root_med"}
