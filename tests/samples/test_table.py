"""Tables of samples: columns by name, a split into roles, mistakes named."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import WRENCH_NAMES
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION
from casadi_contact.samples.table import read_sample_table
from casadi_contact.scenes.scene import Scene
from tests.support.own_contact import SCENE, table_rows, write_csv


def test_rows_come_back_by_name_in_any_order(tmp_path):
    columns, path = table_rows(40), tmp_path / "t.csv"
    samples = read_sample_table(write_csv(path, dict(reversed(columns.items()))), SCENE)
    np.testing.assert_array_equal(samples.poses[:, 1], columns["ty"])
    np.testing.assert_array_equal(samples.loads(["Tz"])[:, 0], columns["Tz"])
    np.testing.assert_array_equal(samples.gaps[:, 0], columns["gap"])
    assert [int((samples.role == role).sum()) for role in (TRAIN, VALIDATION, TEST)] == [32, 4, 4]
    np.testing.assert_array_equal(read_sample_table(path, SCENE).role, samples.role)


def test_roles_and_domains_of_the_table_are_kept_and_else_rows_of_one_pose_have_one_role(tmp_path):
    columns = table_rows(40) | {"role": np.arange(40) % 3, "domain": 1 + np.arange(40) % 7}
    samples = read_sample_table(write_csv(tmp_path / "t.csv", columns), SCENE)
    np.testing.assert_array_equal(samples.role, columns["role"])
    np.testing.assert_array_equal(samples.domain, columns["domain"])
    repeated = {name: np.repeat(column, 5) for name, column in table_rows(40).items()}
    role = read_sample_table(write_csv(tmp_path / "t.csv", repeated), SCENE).role
    assert (role.reshape(40, 5) == role[::5, None]).all()
    assert np.bincount(role).tolist() == [160, 20, 20]


def test_several_patches_have_columns_of_their_own(tmp_path):
    scene, columns = cc.load_scene("patellofemoral"), table_rows(20)
    columns = {name: columns[name] for name in ("tx", "ty", "tz", "rx", "ry", "rz")}
    columns |= {
        f"{k}_{p}": np.full(20, 100.0 + i) for i, k in enumerate(("Fx", "Fy", "Fz", "Tx", "Ty")) for p in ("med", "lat")
    }
    samples = read_sample_table(write_csv(tmp_path / "t.csv", columns), scene)
    np.testing.assert_array_equal(samples.loads(["Fx_med", "Fz"])[0], [100.0, 204.0])
    assert np.isnan(samples.gaps).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: c.pop("Tx"), "lacks the columns Tx; it has"),
        (lambda c: c.update(Fy=np.full(20, np.nan)), "finite number"),
        (lambda c: c["Tx"].put(3, 1e30), r"Tx is 1e\+30 in row 4.*remove rows of missing"),
        (lambda c: c.update(role=np.full(20, 0.5)), "role is 0.5 in row 1, expected a whole number from 0 to 2"),
        (lambda c: c.update(domain=np.arange(20) % 9.0), "domain is 0 in row 1, expected a whole number from 1 to 7"),
        (lambda c: c.update({k: np.repeat(v[:2], 10) for k, v in c.items()}), "has 2 poses, none of them"),
        (lambda c: c.update(gap=-c["gap"]), r"row \d+: contact carries no load and has the gap -0\.0"),
        (lambda c: c.update(rz=np.degrees(c["rz"])), "radians"),
        (lambda c: c.update({k: c[k] / 1000 for k in ("tx", "ty", "tz")}), "convert m"),
        (lambda c: c.update({k: c[k] / 1000 for k in ("Fx", "Fy", "Fz")}), "kN"),
        (lambda c: c.update(role=np.zeros(20)), r"none of them with role 1 \(validation\), 2 \(test\), expected"),
        (lambda c: c.update({k: v[:5] for k, v in c.items()}), "5 rows, expected at least 10"),
        (lambda c: c.update(Tz=c["Tz"] + 300.0 * c["Fy"]), "origin"),
    ],
)
def test_mistakes_are_named(tmp_path, change, said):
    columns = table_rows(20)
    change(columns)
    with pytest.raises(ValueError, match=said):
        read_sample_table(write_csv(tmp_path / "t.csv", columns), SCENE)


def test_a_gap_may_change_its_sign_a_little_before_the_load_but_not_far(tmp_path):
    """Rows without load of which a few overlap, by less than a tenth of a millimetre; then one by more."""
    columns = table_rows(400)
    free = np.flatnonzero(columns["gap"] > 0.0)
    columns["gap"][free[:3]] = -0.09
    assert read_sample_table(write_csv(tmp_path / "t.csv", columns), SCENE).gaps.min() < -0.08
    columns["gap"][free[2]] = -0.3
    with pytest.raises(ValueError, match=rf"row {free[2] + 1}: contact carries no load and has the gap -0\.3 mm"):
        read_sample_table(write_csv(tmp_path / "t.csv", columns), SCENE)


PRESSED = Scene.from_toml(SCENE.to_toml().replace('"F"', '"+Fy"').replace('"tx", "ty", "tz"', '"ty"'))


@pytest.mark.parametrize(("scene", "word"), [(PRESSED, "pulls"), (SCENE, "falls")])
def test_loads_on_the_moving_body_are_refused(tmp_path, scene, word):
    columns = table_rows(400)
    assert len(read_sample_table(write_csv(tmp_path / "t.csv", columns), scene)) == 400
    turned = write_csv(tmp_path / "t.csv", columns | {name: -columns[name] for name in WRENCH_NAMES})
    with pytest.raises(ValueError, match=word):
        read_sample_table(turned, scene)
