"""The contact model and the cycle of a problem, by name."""

from types import SimpleNamespace

import pytest

import casadi_contact as cc
from casadi_contact.scenes.load_cycle import write_cycle
from casadi_contact.scenes.walking import reference_cycle
from problems import contact_source
from problems.contact_source import load_contact, load_cycle


def test_a_surrogate_comes_by_name_and_knee_for_none():
    assert load_contact().scene.name == "knee"
    assert load_contact("knee_reach").scene.name == "knee_reach"
    with pytest.raises(ValueError, match="one of them"):
        load_contact("knee", "knee")


def test_a_scene_gives_its_foundation_with_the_whole_wrench_where_asked(monkeypatch):
    monkeypatch.setattr(contact_source, "foundation", lambda scene: SimpleNamespace(scene=scene))
    assert load_contact(scene="planar_knee").scene.load_names == ("Fy", "Fx")
    whole = load_contact(scene="planar_knee", whole=True).scene
    assert set(whole.load_names) == {"Fx", "Fy", "Fz", "Tx", "Ty", "Tz"}


def test_a_cycle_is_the_file_s_or_the_scene_s_own(tmp_path):
    knee, hip = cc.load_scene("knee"), cc.load_scene("hip")
    assert load_cycle(knee).name == "reference"
    assert "Fy" in load_cycle(hip).targets()
    write_cycle(reference_cycle(frames=5), tmp_path / "walk.csv")
    assert len(load_cycle(knee, tmp_path / "walk.csv")) == 5
