"""Files between Moco and this library: names of states, units and signs there and back, read by OpenSim itself."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.scenes.opensim import ColumnMap, mapped_curves, read_opensim_table, renamed_table, write_table
from casadi_contact.scenes.pose_file import poses_from_curves

KNEE = "/jointset/knee_r"
LABELS = ("knee_tx_r", "knee_ty_r", "knee_tz_r", "knee_adduction_r", "knee_rotation_r", "knee_angle_r")
MAPS = [
    ColumnMap.parse(f"{KNEE}/{label}/value={'-' if name == 'rz' else ''}{name}")
    for label, name in zip(LABELS, POSE_NAMES, strict=True)
]
TIME = np.linspace(0.0, 0.3, 4)
POSES = np.random.default_rng(7).uniform(-0.5, 0.5, (4, 6)) * np.repeat([30.0, 1.0], 3)
CURVES = {"time": TIME, **dict(zip(POSE_NAMES, POSES.T, strict=True))}
BY_OPENSIM = """
import json, sys
import opensim
read = opensim.TimeSeriesTable(sys.argv[1])
columns = {label: list(read.getDependentColumn(label).to_numpy()) for label in read.getColumnLabels()}
header = {key: read.getTableMetaDataString(key) for key in ("inDegrees",)}
opensim.STOFileAdapter.write(read, sys.argv[2])
print(json.dumps({"time": list(read.getIndependentColumn()), "columns": columns, "header": header}))
"""

ROOT = Path(__file__).parents[2]
needs_opensim = pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")


def through_file(table, path, maps):
    write_table(table, path)
    return mapped_curves(read_opensim_table(path), maps)


def test_poses_go_to_the_states_of_a_moco_knee_and_back(tmp_path):
    table = renamed_table(CURVES, MAPS, "states")
    np.testing.assert_allclose(table.column(f"{KNEE}/knee_ty_r/value"), 1e-3 * POSES[:, 1])
    np.testing.assert_allclose(table.column(f"{KNEE}/knee_angle_r/value"), -POSES[:, 5])
    back = poses_from_curves(through_file(table, tmp_path / "states.sto", MAPS))
    np.testing.assert_allclose(back, POSES, rtol=1e-14)


def test_torques_leave_in_nm_and_the_femur_gets_the_opposite():
    curves = {"time": TIME, "Fy": np.full(4, -700.0), "Tx": np.full(4, 1500.0)}
    maps = [ColumnMap.parse(text) for text in ("tibia_vy=Fy", "tibia_torque_x=Tx", "femur_torque_x=-Tx:Nm")]
    table = renamed_table(curves, maps, "contact")
    assert [table.column(item.column)[0] for item in maps] == [-700.0, 1.5, -1.5]


@needs_opensim
def test_opensim_reads_what_is_written_and_what_it_writes_is_read(tmp_path):
    """In a process of its own, which has no casadi_contact."""
    write_table(renamed_table(CURVES, MAPS, "states"), tmp_path / "ours.sto")
    command = [sys.executable, "-c", BY_OPENSIM, str(tmp_path / "ours.sto"), str(tmp_path / "theirs.sto")]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout.strip().splitlines()[-1])
    assert found["header"] == {"inDegrees": "no"}
    np.testing.assert_allclose(found["time"], TIME)
    np.testing.assert_allclose(found["columns"][f"{KNEE}/knee_tx_r/value"], 1e-3 * POSES[:, 0], rtol=1e-12)
    back = poses_from_curves(mapped_curves(read_opensim_table(tmp_path / "theirs.sto"), MAPS))
    np.testing.assert_allclose(back, POSES, rtol=1e-6)


@needs_opensim
def test_the_external_loads_of_the_recipe_are_understood_by_opensim(tmp_path):
    """The recipe's own lines, run by OpenSim's Python; read back, each force stands where it should."""
    page = (ROOT / "docs/how-to/opensim.md").read_text("utf-8")
    code = page.split("python - <<'END'\n")[1].split("END\n")[0]
    code += "read = opensim.ExternalLoads('contact.xml', True)\n"
    code += "found = map(read.get, range(read.getSize()))\n"
    code += "print([(force.getAppliedToBodyName(), force.getForceExpressedInBodyName()) for force in found])\n"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip().splitlines()[-1] == "[('tibia_r', 'tibia_r'), ('femur_r', 'tibia_r')]"
