"""Meshes of a joint: a scene is proposed once and kept, real components settle, cycles on a scene file are solved."""

from pathlib import Path

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.cycle import write_cycle
from casadi_contact.scenes.walking import reference_cycle
from problems import implant
from tests.support import meshes
from tests.support.compiler import needs_compiler
from tests.support.shared_data import shared_file

SCENE = Path(implant.__file__).parent / "scenes" / "tka_mesh.toml"
COLUMNS = ("knee_ant_r", "knee_sup_r", "knee_lat_r", "knee_flex_r", "knee_add_r", "knee_rot_r")  # tx ... rz, m and rad


def test_measured_poses_of_real_components_settle_under_normal_loads(tmp_path):
    folder = shared_file("data/dm_tka/femoral_component.stl").parent
    text = SCENE.read_text("utf-8").replace("../../../shared/data/dm_tka", str(folder))
    (tmp_path / "tka.toml").write_text(text.replace('units = "m"', 'units = "m"\nspacing = 1.4'))
    model = cc.ElasticFoundation(cc.load_scene(tmp_path / "tka.toml"), (80, 40))
    rows = (folder / "fluoroscopic_gait.sto").read_text().split("endheader\n")[1].splitlines()
    columns = [rows[0].split().index(name) for name in COLUMNS]
    measured = np.array([[float(v) for v in row.split()] for row in rows[1::40]])[:, columns]
    measured[:, :3] *= 1000.0
    assert np.abs(model.gaps(measured)).max() < 2.0  # as measured they touch, to what fluoroscopy can tell
    targets = {"Fy_med": -700.0, "Fy_lat": -500.0}
    poses, report = cc.settle(model, measured, free=("ty", "rx"), targets=targets)
    assert report.converged.all()
    assert np.abs(poses[:, 1] - measured[:, 1]).max() < 1.5
    flat = -cc.RayCastFoundation(model.scene).wrenches(poses)[:, :, 1].sum(axis=1)
    assert 0.85 < (flat / 1200.0).min() < (flat / 1200.0).max() < 1.0  # facets lose force


def test_two_meshes_have_a_scene_proposed_which_is_then_kept(tmp_path, monkeypatch):
    for name, mesh in {"ball": meshes.ball_mesh(20.0, 3.0), "dish": meshes.sheet_mesh(40.0, 4.0)}.items():
        meshes.write_obj(tmp_path / f"{name}.obj", *mesh)
    ball, dish, proposed = tmp_path / "ball.obj", tmp_path / "dish.obj", []

    def propose(moving, fixed, out):
        proposed.append((moving, fixed))
        out.write_text(meshes.mesh_scene_text(moving, fixed) + "# looked at")

    monkeypatch.setattr(implant, "propose_scene", propose)
    scene = implant.scene_of_meshes(ball, dish, tmp_path)
    assert implant.scene_of_meshes(ball, dish, tmp_path) == scene == tmp_path / "dish.toml"
    assert proposed == [(ball, dish)]
    assert scene.read_text().endswith("# looked at")
    with pytest.raises(ValueError, match="other meshes"):
        implant.scene_of_meshes(dish, dish, tmp_path)


@needs_compiler
def test_cycles_are_solved_on_the_foundation_of_a_scene_file(tmp_path):
    (tmp_path / "knee.toml").write_text(cc.load_scene("knee").to_toml(), "utf-8")
    write_cycle(reference_cycle(frames=5), tmp_path / "walk.csv")
    with pytest.raises(SystemExit) as ended:
        implant.main(tmp_path / "knee.toml", [tmp_path / "walk.csv"], out=tmp_path / "out")
    assert ended.value.code == 0
    assert (tmp_path / "out" / "walk" / "pose_estimation.csv").read_text("utf-8").count("\n") == 6


def test_mistakes_are_refused_before_any_work(tmp_path):
    walk = tmp_path / "walk.csv"
    write_cycle(reference_cycle(frames=5), walk)
    with pytest.raises(FileNotFoundError, match=r"none\.csv"):
        implant.main(Path("knee"), [tmp_path / "none.csv"], out=tmp_path / "out")
    with pytest.raises(ValueError, match="one name"):
        implant.main(Path("knee"), [walk, walk], out=tmp_path / "out")
    meshes.write_obj(tmp_path / "ball.obj", *meshes.ball_mesh(20.0, 3.0))
    with pytest.raises(ValueError, match="fixed body's mesh"):
        implant.main(tmp_path / "ball.obj", [walk], out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
