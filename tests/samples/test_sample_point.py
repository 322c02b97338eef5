import pytest

from casadi_contact.samples.settings import SamplePoint, SamplingSettings
from casadi_contact.scenes.loading import load_scene


@pytest.mark.parametrize(
    ("name", "inputs", "free"),
    [
        ("knee", ("tx", "Fy_med", "tz", "Fy_lat", "ry", "rz"), ("ty", "rx")),
        ("planar_knee", ("tx", "Fy", "rz"), ("ty",)),
    ],
)
def test_a_knee_is_set_by_its_normal_loads_and_the_pose_parameters_that_are_not_sensitive(name, inputs, free):
    point = SamplePoint.of_scene(load_scene(name))
    assert (point.inputs, point.free) == (inputs, free)
    assert point.load_inputs == tuple(name for name in inputs if name.startswith("F"))


@pytest.mark.parametrize(
    ("definition", "message"),
    [
        ([("tx", "Fy", "tz", "rx", "ry")], "1 loads for 2 free"),
        ([("tx", "weight", "tz", "rx", "ry", "rz")], "'weight' is neither a pose parameter nor a load"),
        ([("tx", "tx", "tz", "rx", "ry", "rz")], "each once"),
        ([("tx", "Fy", "rz"), ("ty", "rz")], "can move"),
    ],
)
def test_impossible_definitions_are_refused(definition, message):
    with pytest.raises(ValueError, match=message):
        SamplePoint(*definition)


def test_settings_come_from_the_scene_whose_table_overrides_and_keywords_override_it():
    knee = load_scene("knee")
    settings = SamplingSettings.from_scene(knee, scale=0.5, seed=7, counts={"D3": 100})
    assert settings.settle_grid == knee.grids["settle"]
    assert (settings.scale, settings.seed, settings.counts["D3"], settings.counts["D1"]) == (0.5, 7, 100, 24000)
    assert SamplingSettings(**settings.to_table()) == settings
    own = {"liftoff_mm": 1.5, "seed": 3, "fixed_offsets": {"tz": [0.5, 1]}}
    settings = SamplingSettings.from_scene(type(knee).from_tables({**knee.tables, "sampling": own}), seed=4)
    assert (settings.liftoff_mm, settings.seed) == (1.5, 4)
    assert settings.fixed_offsets == {"ry": (0.02, 0.06), "tz": (0.5, 1.0)}


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"liftof_mm": 2.0}, "unknown sampling setting liftof_mm"),
        ({"scale": 0.0}, "scale = 0.0, expected a number from"),
        ({"seed": 1.5}, "seed = 1.5, expected a whole number"),
        ({"counts": {"D8": 3}}, "expected samples for some of D1"),
        ({"fixed_offsets": {"ry": [0.3, 0.1]}}, "fixed_offsets.ry"),
        ({"inputs": ["tx"]}, "loads for 5 free"),
        ({"reach": {"tx": (1.0, 0.0)}}, "smaller one first"),
        ({"reach": {"tx": (0.0, 1.0)}}, "a range of each input: tx, Fy_med"),
    ],
)
def test_bad_settings_are_refused_by_name(setting, message):
    with pytest.raises(ValueError, match=message):
        SamplingSettings.from_scene(load_scene("knee"), **setting).sample_point(load_scene("knee"))
