from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.samples import (
    TEST,
    TRAIN,
    Dropped,
    Samples,
    domain_errors,
    load_errors,
    partial_folder,
    read_samples,
    write_samples,
)
from casadi_contact.scenes.loading import load_scene
from tests.support.shared_data import resealed


def some_samples(count=20):
    rng = np.random.default_rng(0)
    return Samples(
        load_scene("knee"),
        rng.normal(size=(count, 6)),
        rng.normal(size=(count, 2, 6)),
        rng.normal(size=(count, 2)),
        (np.arange(count) % 7 + 1).astype(np.uint8),
        (np.arange(count) % 3).astype(np.uint8),
        {"seed": 1, "dropped": {"D1": {"pulls": 2}}},
    )


@pytest.mark.parametrize("count", [0, 20])
def test_a_file_gives_back_what_was_written(tmp_path, count):
    samples = some_samples(count)
    write_samples(tmp_path / "s.h5", samples)
    back = read_samples(tmp_path / "s.h5")
    assert back.scene == samples.scene
    assert back.provenance == samples.provenance
    for name in ("poses", "wrenches", "gaps", "domain", "role"):
        np.testing.assert_array_equal(getattr(back, name), getattr(samples, name))
        assert getattr(back, name).dtype == getattr(samples, name).dtype
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


def test_loads_and_selection_by_domain_and_role():
    samples = some_samples()
    med, lat = samples.wrenches[:, 0], samples.wrenches[:, 1]
    np.testing.assert_allclose(samples.loads(["Fy_lat", "Tx"]), np.column_stack([lat[:, 1], med[:, 3] + lat[:, 3]]))
    assert samples.loads().shape == (20, 7)
    chosen = samples.select(domain="D2", role=TEST)
    rows = (samples.domain == 2) & (samples.role == TEST)
    np.testing.assert_array_equal(chosen.poses, samples.poses[rows])
    assert len(samples.select(role=(TRAIN, TEST))) == ((samples.role == TRAIN) | (samples.role == TEST)).sum()
    assert samples.counts()["D2"]["train"] == ((samples.domain == 2) & (samples.role == TRAIN)).sum()
    with pytest.raises(ValueError, match="unknown domain 'D9'"):
        samples.select(domain="D9")


def test_samples_of_one_scene_are_joined_and_dropped_poses_stay_with_every_selection(tmp_path):
    dropped = Dropped(np.arange(12.0).reshape(2, 6), np.array([1, 3], dtype=np.uint8))
    samples = replace(some_samples(), dropped=dropped)
    write_samples(tmp_path / "s.h5", samples)
    for kept in (read_samples(tmp_path / "s.h5"), samples.select(role=TRAIN)):
        np.testing.assert_array_equal(kept.dropped.poses, dropped.poses)
        np.testing.assert_array_equal(kept.dropped.domain, dropped.domain)
    both = samples.join_samples(samples.select(role=TRAIN))
    np.testing.assert_array_equal(both.poses, [*samples.poses, *samples.poses[samples.role == TRAIN]])
    assert len(both.dropped.poses) == 4
    with pytest.raises(ValueError, match="another scene"):
        samples.join_samples(replace(samples, scene=load_scene("knee", youngs_modulus=400.0)))


def with_three_roles(path):
    with resealed(path) as samples:
        del samples["role"]
        samples["role"] = np.zeros(3, dtype=np.uint8)


def with_another_format(path):
    with resealed(path) as samples:
        samples.attrs["format_version"] = 99


HARM = {with_three_roles: "shape", with_another_format: "format 99"}


@pytest.mark.parametrize("harm", HARM)
def test_a_damaged_or_foreign_file_is_refused_in_one_line(tmp_path, harm):
    file = tmp_path / "s.h5"
    write_samples(file, some_samples())
    harm(file)
    with pytest.raises(ValueError, match=HARM[harm]) as error:
        read_samples(file)
    assert "\n" not in str(error.value)
    assert str(file) in str(error.value)


def test_what_is_not_there_not_complete_or_of_other_shapes_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        read_samples(tmp_path / "s.h5")
    partial_folder(tmp_path / "s.h5").mkdir()
    with pytest.raises(FileNotFoundError, match="is not complete"):
        read_samples(tmp_path / "s.h5")
    with pytest.raises(ValueError, match=r"wrenches has shape \(20, 1, 6\), expected \(20, 2, 6\)"):
        replace(some_samples(), wrenches=np.zeros((20, 1, 6)))


def test_errors_of_hand_worked_loads():
    names = ("Fx", "Tx", "Fz_med")
    errors = load_errors(
        names, np.array([[1.0, 0.0, 2.0], [4.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [0.0, -2.0, 3.0]])
    )
    assert errors["Fx"] == {"rms": pytest.approx(np.sqrt(8.5)), "max": 4.0, "mean": 2.5}
    assert errors["Tx"]["max"] == 2.0


def test_domain_errors_use_only_the_wanted_role_and_domain():
    scene = cc.load_scene("sphere_on_plane")
    model = cc.ElasticFoundation(scene, (40, 40))
    poses = np.zeros((4, 6))
    poses[:, 1] = [29.9, 29.8, 29.9, 29.8]
    wrenches = model.wrenches(poses)
    wrenches[3, 0, 1] += 7.0  # a wrong load in the one test sample of D3
    role = np.array([TRAIN, TRAIN, TEST, TEST], dtype=np.uint8)
    domain = np.array([1, 3, 1, 3], dtype=np.uint8)
    errors = domain_errors(model, Samples(scene, poses, wrenches, model.gaps(poses), domain, role))
    assert set(errors) == {"D1", "D3"}
    assert errors["D1"]["Fy"]["max"] == 0.0
    assert errors["D3"]["Fy"]["max"] == pytest.approx(7.0)
