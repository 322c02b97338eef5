"""Surrogate files: exact round trips; damaged, foreign and newer files get one clear line."""

import h5py
import numpy as np
import pytest

from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.file import FORMAT
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.random_surrogates import random_confidence, random_poses, random_surrogate
from tests.support.shared_data import resealed

RECORD = {
    "samples": {"D1": 21600, "D5": 270},
    "training_errors": {"root_med": 0.61},
    "test_errors": {"D1": {"Fy_med": {"rms": 0.5, "max": 3.25}}},
    "command": "casadi-contact build knee",
}


@pytest.mark.parametrize("structure", ["patch", "two_stage"])
@pytest.mark.parametrize("scene", ["knee", "sphere_on_plane"])
def test_round_trip_is_exact(scene, structure, tmp_path):
    surrogate = random_surrogate(load_scene(scene), structure)
    surrogate.record.update(record := RECORD if scene == "knee" else {})
    path = tmp_path / "it.h5"
    surrogate.save(path)
    again = load_surrogate(path)
    assert type(again) is type(surrogate)
    assert again.record == record
    assert again.scene.digest == surrogate.scene.digest
    assert again.load_names == surrogate.load_names
    assert list(again.networks) == list(surrogate.networks)
    for got, want in zip(again.networks.values(), surrogate.networks.values(), strict=True):
        assert (got.hidden, got.activation) == (want.hidden, want.activation)
        np.testing.assert_array_equal(got.output_scale, want.output_scale)
        for a, b in zip((*got.weights, *got.biases), (*want.weights, *want.biases), strict=True):
            np.testing.assert_array_equal(a, b)
    poses = random_poses(20)
    np.testing.assert_array_equal(again(poses), surrogate(poses))
    assert [p.name for p in tmp_path.iterdir()] == ["it.h5"], "nothing is left beside the file"


def test_every_number_of_the_confidence_survives(tmp_path):
    surrogate, confidence = random_surrogate(load_scene("knee"), "two_stage"), random_confidence(2, 7)
    type(surrogate)(surrogate.scene, surrogate.networks, {}, confidence).save(tmp_path / "it.h5")
    again = load_surrogate(tmp_path / "it.h5").confidence
    for name, numbers in confidence.numbers().items():
        np.testing.assert_array_equal(again.numbers()[name], numbers, name)
    for a, b in zip(again.network.weights, confidence.network.weights, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_file_that_lacks_an_array_or_all_is_refused(saved):
    with resealed(saved) as file:
        del file["networks/root_med/weight_0"]
    for content in (saved.read_bytes(), b""):
        saved.write_bytes(content)
        with pytest.raises(ValueError, match=r"knee\.h5 is damaged"):
            load_surrogate(saved)


@pytest.mark.parametrize("other", [FORMAT - 1, FORMAT + 1])
def test_files_of_another_format_are_refused(saved, other):
    with resealed(saved) as file:
        file.attrs["format"] = other
    with pytest.raises(ValueError, match=f"format {other}, expected {FORMAT}"):
        load_surrogate(saved)


def test_foreign_files_are_refused(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1.0
    with pytest.raises(ValueError, match="not a file"):
        load_surrogate(tmp_path / "other.h5")
    (tmp_path / "my.toml").write_text("format = 1")
    with pytest.raises(ValueError, match=r"scene file, expected a surrogate.s \.h5: .* build makes a surrogate of it"):
        load_surrogate(tmp_path / "my.toml")


def test_unknown_names_and_missing_files_are_named(tmp_path):
    with pytest.raises(ValueError, match="unknown surrogate 'elbow'"):
        load_surrogate("elbow")
    with pytest.raises(ValueError, match=r"unknown surrogate 'hip', .* scene hip needs none: cc\.foundation\('hip'\)"):
        load_surrogate("hip")
    with pytest.raises(FileNotFoundError, match=r"none\.h5 does not exist"):
        load_surrogate(tmp_path / "none.h5")


def test_a_bad_record_is_refused(tmp_path):
    surrogate = random_surrogate(load_scene("sphere_on_plane"), "patch")
    bad = PatchSurrogate(surrogate.scene, surrogate.networks, {"error": float("nan")})
    with pytest.raises(ValueError, match="not plain JSON"):
        bad.save(tmp_path / "bad.h5")
    assert not list(tmp_path.iterdir())


def test_info_tells_structure_sizes_samples_and_errors():
    surrogate = random_surrogate(load_scene("knee"), "patch")
    empty = str(surrogate.info())
    assert "not recorded" in empty
    surrogate.record.update(RECORD)
    info = surrogate.info()
    assert info.structure == "patch"
    assert info.networks["root_med"].hidden == (14, 9)
    assert sum(n.parameter_count for n in info.networks.values()) == 2 * (2 * (7 * 14 + 15 * 9) + 10 + 5 * 10)
    assert info.test_errors["D1"]["Fy_med"]["max"] == 3.25
    text = str(info)
    for part in (
        "patch surrogate of scene knee",
        "14-9",
        "21870 samples",
        "D5 270",
        "0.5 / 3.25",
        "fit 0.61",
        "casadi-contact build knee",
    ):
        assert part in text
