"""OpenSim files: round trips to the bit, old headers, faults by line; their columns as curves, there and back."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.cli.commands import cycle
from casadi_contact.core.conventions import POSE_NAMES, rotation
from casadi_contact.scenes.cycle import read_cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.opensim import (
    ColumnMap,
    Table,
    femur_in_insert,
    mapped_curves,
    read_opensim_table,
    renamed_table,
    tibia_in_femur,
    write_table,
)
from casadi_contact.scenes.pose_file import poses_from_curves, read_poses
from casadi_contact.scenes.walking import reference_cycle
from tests.support.opensim import by_opensim
from tests.support.shared_data import shared_file

_TEXT = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters='=,;"'), max_size=12)
_TEXT = _TEXT.map(str.strip).filter(lambda text: text.lower() != "endheader")
_LABELS = st.lists(_TEXT.filter(lambda text: text and text.lower() != "time"), unique=True, max_size=4)
HEAD = "walk\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\nendheader\n"


@st.composite
def tables(draw):
    labels, rows = ["time", *draw(_LABELS)], draw(st.integers(0, 5))
    numbers = st.floats(allow_nan=False, allow_infinity=False)
    columns = {label: np.array(draw(st.lists(numbers, min_size=rows, max_size=rows))) for label in labels}
    return Table(draw(_TEXT), columns, draw(st.sampled_from([None, True, False])))


@given(tables())
def test_reading_gives_back_what_was_written_to_the_bit(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("sto") / "table.sto"
    write_table(table, path)
    back = read_opensim_table(path)
    assert (back.name, back.in_degrees, list(back.columns)) == (table.name, table.in_degrees, list(table.columns))
    for label, curve in table.columns.items():
        assert curve.tobytes() == back.columns[label].tobytes()


def read(tmp_path, text):
    (tmp_path / "walk.mot").write_text(text)
    return read_opensim_table(tmp_path / "walk.mot")


BODY = "time\ta\n0\t1\n0.5\t-2\n"


@pytest.mark.parametrize(
    ("text", "ending", "name", "in_degrees"),
    [
        ("walk\nversion=1\nnrows=2\nnColumns = 2\n\ninDegrees=no\nendheader\n" + BODY, "mot", "walk", False),
        ("name walk\ndatacolumns 2\ndatarows 2\nrange 0 1\nendheader\n" + BODY, "mot", "name walk", True),
        ("name walk\ndatacolumns 2\ndatarows 2\nendheader\n" + BODY, "sto", "name walk", None),
        ("version=3\nendheader\n time  a \n 0 1\n.5 -2 \n\n", "mot", "", None),
        ("walk\nversion=0\nendheader\n" + BODY, "mot", "walk", True),
        ("walk\nAngles are in degrees.\nendheader\n" + BODY, "sto", "walk", True),
        ("walk\nangles in radians\nendheader\n" + BODY, "mot", "walk", False),
        ("ModelForces\ninDegrees=no\nAngles are in degrees.\nendheader\n" + BODY, "mot", "ModelForces", None),
        ("walk\nINDEGREES Y\nEndHeader\n" + BODY, "mot", "walk", True),
        ('"walk"\t\n"inDegrees=True"\t\nendheader\t\n' + BODY.replace("\n", "\t\t\n"), "mot", "walk", True),
        ("walk,,\ninDegrees=n,,\nendheader,,\n" + BODY.replace("\t", ","), "mot", "walk", False),
    ],
)
def test_headers_of_all_versions_and_spreadsheets_are_understood(text, ending, name, in_degrees, tmp_path):
    (tmp_path / f"walk.{ending}").write_text(text)
    table = read_opensim_table(tmp_path / f"walk.{ending}")
    assert (table.name, table.in_degrees, table.column("a").tolist()) == (name, in_degrees, [1.0, -2.0])


def test_counts_that_are_off_and_angles_without_a_unit_are_said_and_only_columns_asked_for_count(tmp_path):
    with pytest.warns(UserWarning, match="ncolumns is 53"):
        table = read(tmp_path, "walk\nversion=1\nnColumns=53\nendheader\ntime\ta\ta\tb\tc\n0\t1\t2\tNaN\t4\n")
    with pytest.warns(UserWarning, match="c are taken in rad"):
        assert mapped_curves(table, [ColumnMap.parse("c=rz")])["rz"].tolist() == [4.0]
    for label, word in (("a", r"a \(column 2\)"), ("b", "row 1")):
        with pytest.raises(ValueError, match=word):
            table.column(label)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (HEAD + "time\ta\tb\n0\t1\t2\n1\t1\n", "line 9"),
        (HEAD + "time\ta\tb\n0\t1\t1,2,3\n", "vectors"),
        (HEAD + "time\ta\tb\n0\t1\tinf\n1\t1\t2\n", "line 8, b"),
        (HEAD + "a\tb\ttime\n", "first label"),
        (HEAD, "ends after"),
        ("walk\ninDegrees=maybe\nendheader\ntime\n", "inDegrees"),
        ("", "endheader"),
        ({"a": [1.0]}, "time"),
        ({"time": [0.0], "a\tb": [1.0]}, "tabs"),
        ({"time": [0.0], "a": [1.0, 2.0]}, "as time"),
    ],
)
def test_a_fault_of_a_file_is_named_by_line_and_a_table_that_no_file_can_hold_is_refused(tmp_path, text, word):
    with pytest.raises(ValueError, match=word):
        read(tmp_path, text) if isinstance(text, str) else Table("walk", text)


TABLE = Table("walk", {"time": [0.0, 1.0], "knee": [0.0, 90.0], "ty": [0.02, 0.03], "F": [1.0, 2.0]}, in_degrees=True)


@pytest.mark.parametrize(
    ("text", "curve"),
    [
        ("knee=-rz", [0.0, -np.pi / 2.0]),  # inDegrees=yes
        ("knee=rz:rad", [0.0, 90.0]),
        ("ty=ty", [20.0, 30.0]),  # metres
        ("ty=cop_ap:mm", [0.02, 0.03]),
        ("F=-Fy_med:kN", [-1000.0, -2000.0]),
        ("F=Tz", [1000.0, 2000.0]),
    ],
)
def test_units_and_signs(text, curve):
    np.testing.assert_allclose(ColumnMap.parse(text).curve(TABLE), curve)


@pytest.mark.parametrize(
    ("maps", "said"),
    [
        (["knee"], "COLUMN=NAME"),
        (["knee=rz:"], "understood"),
        (["knee=flexion"], "flexion"),
        (["knee=rz:mm"], "rad, deg"),
        (["hip=rz"], "it has time, knee"),
        (["knee=rz", "F=rz"], "twice"),
    ],
)
def test_a_map_that_cannot_be_is_refused(maps, said):
    with pytest.raises(ValueError, match=said):
        mapped_curves(TABLE, [ColumnMap.parse(text) for text in maps])


def written(folder, table, *maps, scene=None):
    """The CSV file that the command makes of a table, or of a file."""
    file = folder / "walk.mot"
    if isinstance(table, Table):
        write_table(table, file)
    cycle(file if isinstance(table, Table) else table, list(maps), folder / "out.csv", scene)
    return folder / "out.csv"


def test_the_command_writes_the_cycle_that_a_file_holds(tmp_path):
    walk = reference_cycle()
    columns = {
        "time": walk.time_s,
        "knee_angle_r": np.degrees(-walk.pose["rz"]),
        "knee_rot_r": np.degrees(-walk.pose["ry"]),
        "tibia_Fy_m": walk.loads["Fy_med"],
        "tibia_Fy_l": walk.loads["Fy_lat"],
        "cop_x": 1e-3 * walk.centres["cop_ap"],
        "tibia_Tx": 1e-3 * walk.targets()["Tx"],
    }
    table = Table("walk", columns, in_degrees=True)
    maps = ("knee_angle_r=-rz:deg", "knee_rot_r=-ry", "tibia_Fy_m=Fy_med:N", "tibia_Fy_l=Fy_lat", "cop_x=cop_ap:m")
    back = read_cycle(written(tmp_path, table, *maps, "tibia_Tx=Tx:Nm"))
    given = {**walk.pose, **walk.targets(), "cop_ap": walk.centres["cop_ap"]}
    for name, curve in {**back.pose, **back.loads, **back.centres}.items():
        np.testing.assert_allclose(curve, given[name], rtol=1e-12, atol=1e-12)
    assert (len(back.pose), list(back.loads), list(back.centres)) == (2, ["Tx", "Fy_med", "Fy_lat"], ["cop_ap"])


@pytest.mark.parametrize(("names", "said"), [(("F=Fy_med", "ty=gap_med"), "gap_med"), (("knee=rz", "ty=ty"), "poses")])
def test_a_mixture_that_is_neither_poses_nor_a_cycle_is_refused(tmp_path, names, said):
    with pytest.raises(ValueError, match=said):
        written(tmp_path, TABLE, *names)
    assert not (tmp_path / "out.csv").exists()


def test_a_cycle_of_another_joint_is_that_of_its_scene(tmp_path):
    columns = {"time": np.arange(3.0), "flexion": np.array([10.0, 20.0, 30.0]), "force": np.array([0.1, 0.9, 0.4])}
    path = written(tmp_path, Table("walk", columns, in_degrees=True), "flexion=-rz", "force=Fy:kN", scene="hip")
    back = read_cycle(path, load_scene("hip"))
    np.testing.assert_allclose(back.pose["rz"], -np.radians([10.0, 20.0, 30.0]), rtol=1e-15)
    np.testing.assert_allclose(back.loads["Fy"], [100.0, 900.0, 400.0], rtol=1e-15)


KNEE = "/jointset/knee_r"
LABELS = ("knee_tx_r", "knee_ty_r", "knee_tz_r", "knee_add_r", "knee_rot_r", "knee_flex_r")
MAPS = [f"{KNEE}/{label}/value={name}" for label, name in zip(LABELS, POSE_NAMES, strict=True)]
TIME = np.linspace(0.0, 0.3, 4)
STATES = np.random.default_rng(7).uniform(-0.5, 0.5, (4, 6)) * np.repeat([30.0, 1.0], 3)  # tibia in femur [mm, rad]
CURVES = {"time": TIME, **dict(zip(POSE_NAMES, STATES.T, strict=True))}
TABLE_OF_STATES = renamed_table(CURVES, map(ColumnMap.parse, MAPS), "states")
BY_OPENSIM = """
import json, sys
import opensim
read = opensim.TimeSeriesTable(sys.argv[1])
columns = {label: list(read.getDependentColumn(label).to_numpy()) for label in read.getColumnLabels()}
header = {"inDegrees": read.getTableMetaDataString("inDegrees")}
opensim.STOFileAdapter.write(read, sys.argv[2])
print(json.dumps({"time": list(read.getIndependentColumn()), "columns": columns, "header": header}))
"""


@pytest.mark.parametrize(
    ("coordinates", "pose"),
    [
        ([0, 0, 0, 0, 0, 0.3], [0, 0, 0, 0, 0, -0.3]),
        ([5, -27, 2, 0, 0, 0], [5, 27, 2, 0, 0, 0]),  # tibia anterior, below, lateral: femur posterior, above, medial
        ([0, -27, 0, 0, 0, np.pi / 2], [27, 0, 0, 0, 0, -np.pi / 2]),  # the femur's shaft points backwards
        ([5, 0, 0, 0, 0.2, 0], [5 * np.cos(0.2), 0, 5 * np.sin(0.2), 0, -0.2, 0]),  # inwards: femur outwards
        ([0, -27, 0, 0.2, 0, 0], [0, 27 * np.cos(0.2), 27 * np.sin(0.2), 0.2, 0, 0]),  # adduction: over the medial side
    ],
)
def test_the_femur_in_the_insert_from_the_tibia_in_the_femur(coordinates, pose):
    np.testing.assert_allclose(femur_in_insert([coordinates])[0], pose, atol=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_knee_is_turned_and_back_and_a_left_one_is_the_mirror_image(side):
    np.testing.assert_allclose(tibia_in_femur(femur_in_insert(STATES, side), side), STATES, atol=1e-13)
    mirrored = STATES * ([1, 1, -1, -1, -1, 1] if side == "left" else 1)
    np.testing.assert_array_equal(femur_in_insert(mirrored, side), femur_in_insert(STATES))
    with pytest.raises(ValueError, match="right or left"):
        femur_in_insert(STATES, "both")


def test_states_of_a_moco_knee_become_poses_by_the_command_and_with_loads_a_cycle(tmp_path):
    loads = {"Fy_med": -500.0, "Fy_lat": -300.0, "cop_ap": 0.004, "cop_ml": 0.006}
    columns = {name: np.full(4, value) for name, value in loads.items()}
    write_table(Table("walk", {**TABLE_OF_STATES.columns, **columns}, in_degrees=False), tmp_path / "walk.mot")
    cycle(tmp_path / "walk.mot", MAPS, tmp_path / "out.csv", None, "right")
    np.testing.assert_allclose(read_poses(tmp_path / "out.csv"), femur_in_insert(STATES), rtol=1e-12)
    cycle(tmp_path / "walk.mot", [*MAPS, *(f"{name}={name}" for name in loads)], tmp_path / "out.csv", None, "right")
    walk = read_cycle(tmp_path / "out.csv")
    np.testing.assert_allclose(
        np.column_stack([walk.pose["ry"], walk.pose["rz"]]), femur_in_insert(STATES)[:, 4:], rtol=1e-12
    )


def test_ligaments_of_jam_s_knee_are_as_long_as_it_stored():
    """Each PCL bundle runs straight from a point of the femur to one of the tibia."""
    folder = shared_file("data/jam_knee/lenhart2015.osim").parent
    states, forces = (read_opensim_table(folder / "passive_flexion" / name) for name in ("states.sto", "forces.sto"))
    poses = femur_in_insert(poses_from_curves(mapped_curves(states, map(ColumnMap.parse, MAPS))))
    model, turn = (folder / "lenhart2015.osim").read_text("utf-8"), np.array([-1.0, 1.0, -1.0])
    for bundle in ("PCLal1", "PCLpm5"):
        path = model.split(f'name="{bundle}"')[1].split("</objects>")[0]
        points = [1e3 * turn * np.array(text.split(), float) for text in re.findall("<location>(.*)</location>", path)]
        lengths = np.linalg.norm(poses[:, :3] + rotation(poses[:, 3:]) @ points[0] - points[1], axis=1)
        np.testing.assert_allclose(lengths, 1e3 * forces.column(f"{bundle}.length"), atol=1e-5)


def test_opensim_reads_what_is_written_and_what_it_writes_is_read(tmp_path):
    write_table(TABLE_OF_STATES, tmp_path / "ours.sto")
    found = json.loads(by_opensim(BY_OPENSIM, tmp_path, tmp_path / "ours.sto", tmp_path / "theirs.sto"))
    assert found["header"] == {"inDegrees": "no"}
    np.testing.assert_allclose(found["time"], TIME)
    np.testing.assert_allclose(found["columns"][f"{KNEE}/knee_tx_r/value"], 1e-3 * STATES[:, 0], rtol=1e-12)
    back = poses_from_curves(mapped_curves(read_opensim_table(tmp_path / "theirs.sto"), map(ColumnMap.parse, MAPS)))
    np.testing.assert_allclose(back, STATES, rtol=1e-6)


BY_JOINT = """
import json, re, sys
import opensim
text = re.sub(r"<(Smith2018\\w+) name=.*?</\\1>", "", open(sys.argv[1]).read(), flags=re.S)  # it does not know these
open("knee.osim", "w").write(text)
model, found = opensim.Model("knee.osim"), []
state, bodies = model.initSystem(), model.getBodySet()
for row in json.loads(sys.argv[2]):
    for name, value in row.items():
        model.updCoordinateSet().get(name).setValue(state, value, False)
    model.realizePosition(state)
    femur = bodies.get("femur_distal_r").findTransformBetween(state, bodies.get("tibia_proximal_r"))
    found.append([[*(femur.R().get(i, j) for j in range(3)), femur.p().get(i)] for i in range(3)])
print(json.dumps(found))
"""


def test_opensim_s_joint_puts_the_femur_there(tmp_path):
    rows = [dict(zip(LABELS, row, strict=True)) for row in (STATES / np.repeat([1e3, 1.0], 3)).tolist()]
    model = shared_file("data/jam_knee/lenhart2015.osim")
    found, turn = np.array(json.loads(by_opensim(BY_JOINT, tmp_path, model, json.dumps(rows)))), np.diag([-1, 1, -1])
    poses = femur_in_insert(STATES)
    np.testing.assert_allclose(rotation(poses[:, 3:]), turn @ found[..., :3] @ turn, atol=1e-12)
    np.testing.assert_allclose(poses[:, :3], 1e3 * found[..., 3] @ turn, atol=1e-9)


def test_the_external_loads_of_the_recipe_are_understood_by_opensim(tmp_path):
    """The recipe's own lines, run by OpenSim's Python; read back, each force stands where it should."""
    page = (Path(__file__).parents[2] / "docs/how-to/opensim.md").read_text("utf-8")
    code = page.split("python - <<'END'\n")[1].split("END\n")[0]
    code += "read = opensim.ExternalLoads('contact.xml', True)\n"
    code += "found = map(read.get, range(read.getSize()))\n"
    code += "print([(force.getAppliedToBodyName(), force.getForceExpressedInBodyName()) for force in found])\n"
    assert by_opensim(code, tmp_path) == "[('tibia_r', 'tibia_r'), ('femur_r', 'tibia_r')]"
