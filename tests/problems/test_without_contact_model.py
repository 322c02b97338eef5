"""A surrogate whose contact model is not at hand: what it says is written, what the contact model would say is not."""

import csv
import json
import sys
from importlib import import_module

import pytest

import casadi_contact as cc
from casadi_contact.scenes.load_cycle import write_cycle
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import reference_cycle

GONE = ("geometry", "material", "grids")
COMMANDS = {
    "pose_estimation": ("--cycle", "walk.csv"),
    "static_equilibrium": ("--flexions", "0,30", "--starts", "0"),
    "muscle_contact": (),
}


@pytest.fixture(scope="module")
def surrogates(tmp_path_factory):
    """The knee's networks, their scene without any geometry, and with mesh files that are gone."""
    folder, knee = tmp_path_factory.mktemp("surrogates"), cc.load_surrogate("knee")
    tables = {key: value for key, value in knee.scene.tables.items() if key not in GONE}
    patches = {
        name: {"anchor": anchor.tolist()}
        for name, anchor in zip(knee.scene.patch_names, knee.scene.anchors_mm, strict=True)
    }
    own = {**tables, "shape": "own_model", "geometry": {"patches": patches}}
    sides = {name: {**patch, "z": z} for (name, patch), z in zip(patches.items(), ([2, 40], [-40, -2]), strict=True)}
    bodies = {"moving": "/nowhere/femur.stl", "fixed": "/nowhere/insert.stl", "units": "mm", "elements": "grid"}
    mesh = {**knee.scene.tables, "shape": "mesh", "geometry": {**bodies, "patches": sides}}
    for name, scene in (("own_model", own), ("mesh", mesh)):
        type(knee)(Scene.from_tables(scene), knee.networks, knee.record, knee.trust).save(folder / f"{name}.h5")
    write_cycle(reference_cycle(frames=6), folder / "walk.csv")
    return folder


def exit_status(monkeypatch, folder, problem, surrogate, out):
    """Of a problem's command, run in a folder on a surrogate there."""
    arguments = ["--surrogate", f"{surrogate}.h5", *COMMANDS.get(problem, ()), "--out", str(out)]
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", [problem, *arguments])
    try:
        import_module(f"problems.{problem}.__main__").main()
    except SystemExit as end:
        return end.code or 0
    return 0


@pytest.mark.parametrize(
    ("problem", "surrogate"), [*((problem, "own_model") for problem in COMMANDS), ("pose_estimation", "mesh")]
)
def test_results_are_written_unchecked(surrogates, tmp_path, monkeypatch, capsys, problem, surrogate):
    assert exit_status(monkeypatch, surrogates, problem, surrogate, tmp_path) == 0
    assert "solved, not checked: the scene knee has no contact model at hand" in capsys.readouterr().out.splitlines()[0]
    with (tmp_path / f"{problem}.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["verdict"] for row in rows} == {"solved, not checked"}
    assert not [name for name in rows[0] if "_ef_" in name or "pressure" in name or "open_edges" in name]
    assert (tmp_path / f"{problem}.png").read_bytes().startswith(b"\x89PNG")
    summary = json.loads(next(tmp_path.glob("*.json")).read_text("utf-8"))
    assert "not checked" in summary["verdict"]
    assert "EF" not in json.dumps(summary.get("errors", {}))
    assert not [key for key in summary if key.startswith(("ef_grids", "largest_share"))]
    assert not (tmp_path / "pressures.sto").exists()
