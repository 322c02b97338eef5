"""Real knee components, from their mesh files: measured poses settle under wanted loads."""

from pathlib import Path

import numpy as np

import casadi_contact as cc
from tests import meshes  # noqa: F401  (skips without the extra `mesh`)
from tests.shared_data import shared_file

SCENE = Path(__file__).parents[2] / "problems" / "tka_mesh.toml"
COLUMNS = ("knee_ant_r", "knee_sup_r", "knee_lat_r", "knee_flex_r", "knee_add_r", "knee_rot_r")  # tx ... rz, m and rad


def test_measured_poses_of_real_components_settle_under_wanted_loads(tmp_path):
    folder = shared_file("data/dm_tka/femoral_component.stl").parent
    text = SCENE.read_text("utf-8").replace("../../shared/data/dm_tka", str(folder))
    (tmp_path / "tka.toml").write_text(text.replace('units = "m"', 'units = "m"\nspacing = 1.0'))
    model = cc.ElasticFoundation(cc.load_scene(tmp_path / "tka.toml"), (80, 40))
    rows = (folder / "fluoroscopic_gait.sto").read_text().split("endheader\n")[1].splitlines()
    columns = [rows[0].split().index(name) for name in COLUMNS]
    measured = np.array([[float(v) for v in row.split()] for row in rows[1::20]])[:, columns]
    measured[:, :3] *= 1000.0
    assert np.abs(model.gaps(measured)).max() < 2.0  # as measured they touch, to what fluoroscopy can tell
    targets = {"Fy_med": -700.0, "Fy_lat": -500.0}
    poses, report = cc.settle(model, measured, free=("ty", "rx"), targets=targets)
    assert report.converged.all()
    assert np.abs(poses[:, 1] - measured[:, 1]).max() < 1.5
    assert model.at_edge(poses).sum() <= 1  # in deep flexion the lateral contact nears the corner of the insert
    named = dict(zip(model.load_names, model(poses).T, strict=True))
    np.testing.assert_allclose(named["Fy_med"], -700.0, atol=0.1)
    flat = -cc.RayCastFoundation(model.scene).wrenches(poses)[:, :, 1].sum(axis=1)
    assert 0.85 < (flat / 1200.0).min() < (flat / 1200.0).max() < 1.0  # facets lose force
