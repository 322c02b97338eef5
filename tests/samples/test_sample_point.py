import pytest

from casadi_contact.samples.settings import SamplePoint, SamplingSettings
from casadi_contact.scenes.loading import load_scene


def test_the_knee_of_the_paper():
    point = SamplePoint.of_scene(load_scene("knee"))
    assert point.inputs == ("tx", "Fy_med", "tz", "Fy_lat", "ry", "rz")
    assert point.free == ("ty", "rx")
    assert point.load_inputs == ("Fy_med", "Fy_lat")


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (("tx", "Fy", "tz", "rx", "ry"), "1 loads for 2 free"),
        (("tx", "ty", "tz", "rx", "ry", "rz", "Fy"), "1 loads for 0 free"),
        (("tx", "weight", "tz", "rx", "ry", "rz"), "'weight' is neither a pose parameter nor a load"),
        (("tx", "tx", "tz", "rx", "ry", "rz"), "each once"),
    ],
)
def test_impossible_definitions_are_refused(inputs, message):
    with pytest.raises(ValueError, match=message):
        SamplePoint(inputs)


def test_a_pose_parameter_that_cannot_move_is_no_input():
    with pytest.raises(ValueError, match="can move"):
        SamplePoint(("tx", "Fy", "rz"), ("ty", "rz"))


def test_settings_come_from_the_scene():
    settings = SamplingSettings.from_scene(load_scene("knee"), scale=0.5, seed=7, counts={"D3": 100})
    assert settings.settle_grid == load_scene("knee").grids["settle"]
    assert (settings.scale, settings.seed, settings.counts["D3"], settings.counts["D1"]) == (0.5, 7, 100, 24000)
    assert SamplingSettings.from_table(settings.to_table()) == settings


def test_the_scene_table_overrides_and_keywords_override_it():
    tables = {
        **load_scene("knee").tables,
        "sampling": {"liftoff_mm": 1.5, "seed": 3, "fixed_offsets": {"tz": [0.5, 1]}},
    }
    scene = type(load_scene("knee")).from_tables(tables)
    settings = SamplingSettings.from_scene(scene, seed=4)
    assert (settings.liftoff_mm, settings.seed) == (1.5, 4)
    assert settings.fixed_offsets == {"ry": (0.02, 0.06), "tz": (0.5, 1.0)}


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"liftof_mm": 2.0}, "unknown sampling setting liftof_mm"),
        ({"scale": 0.0}, "scale = 0.0, expected a number from"),
        ({"seed": 1.5}, "seed = 1.5, expected a whole number"),
        ({"counts": {"D8": 3}}, "expected samples for some of D1"),
        ({"counts": {"D1": -3}}, "counts.D1 = -3"),
        ({"fixed_offsets": {"ry": [0.3, 0.1]}}, "fixed_offsets.ry"),
        ({"test_fraction": 0.9}, "from 0 to 0.5"),
        ({"inputs": ["tx"]}, "loads for 5 free"),
    ],
)
def test_bad_settings_are_refused_by_name(setting, message):
    with pytest.raises(ValueError, match=message):
        SamplingSettings.from_scene(load_scene("knee"), **setting)
