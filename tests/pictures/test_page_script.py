"""The page's own JavaScript in node: settling keeps to what a scene locks or ties, and the copied Python runs."""

import json
import shutil
import subprocess
from importlib import resources

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.settle import settle
from casadi_contact.pictures.contact_picture import contact_pose
from casadi_contact.pictures.joint_page import settled_by
from casadi_contact.scenes.pose_space import PoseSpace

_SETTLE = """
import { settle } from "./settle.js";
const { space, slopes, start, wanted } = JSON.parse(process.argv[2]);
const root = (pose) => pose.reduce((sum, q, k) => sum + slopes[k] * q, 0);
// A patch of root load s = slopes·pose under N = N0 s², N0 = 100 N, pressed along -Fy.
const model = {
  names: ["Fy"],
  both: (what, pose) => what === "roots" ? { values: [root(pose)], slopes }
    : { values: [-100 * root(pose) ** 2], slopes: slopes.map((k) => -200 * root(pose) * k) },
};
const content = { space, referenceLoad: 100, normals: [{ loads: ["Fy"], directed: true, sign: -1 }] };
console.log(JSON.stringify(settle(model, content, start, [1], { names: ["Fy"], wanted: [wanted] })));
"""
_OPTI = """
globalThis.window = { addEventListener() {} };
const { optiOf } = await import("./save.js");
const { content, pose, wanted } = JSON.parse(process.argv[2]);
console.log(optiOf(content, pose, wanted));
"""
SLOPES = np.array([0.1, -0.5, 0.3, 0.7, 0.2, 0.1])
START = np.array([1.0, -4.0, 2.0, 0.3, 0.1, 0.2])


def run(folder, script, given):
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on the path")
    for file in resources.files("casadi_contact.pictures").joinpath("web").iterdir():
        if file.name.endswith(".js"):
            (folder / file.name).write_text(file.read_text("utf-8"), "utf-8")
    (folder / "package.json").write_text('{"type": "module"}')
    (folder / "run.js").write_text(script, "utf-8")
    command = [node, str(folder / "run.js"), json.dumps(given)]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


def table_of(space):
    return None if space.unconstrained else {"matrix": space.matrix.tolist(), "offset": space.offset.tolist()}


@pytest.mark.parametrize("pose", [{}, {"locked": {"rx": 0.05}, "tied": {"tz": {"to": "ty", "slope": 0.5}}}])
def test_a_pose_that_settles_is_one_that_the_joint_can_take(tmp_path, pose):
    space = PoseSpace.from_table(pose)
    given = {"space": table_of(space), "slopes": SLOPES.tolist(), "start": START.tolist(), "wanted": -400.0}
    found = json.loads(run(tmp_path, _SETTLE, given))
    assert found["converged"]
    at = np.array(found["pose"])
    np.testing.assert_allclose(at, space.project(at), atol=1e-12)
    assert SLOPES @ at == pytest.approx(2.0, abs=1e-6)  # 400 N = 100 N·2²
    free = [0, 4, 5]
    np.testing.assert_array_equal(at[free], START[free])


@pytest.mark.parametrize("model", ["cc.load_surrogate('knee')", "cc.foundation('hip')"])
def test_the_copied_code_is_an_opti_that_carries_the_loads_from_the_shown_pose_on(tmp_path, model):
    made = eval(model, {"cc": cc})
    scene, (free, names) = made.scene, settled_by(made.scene)
    pose, _ = settle(made, contact_pose(cc.ElasticFoundation(scene))[None], free, dict.fromkeys(names, -300.0))
    pose = pose[0].round(4)
    wanted = (0.5 * made(pose, names)).tolist()
    content = {
        "settle": {"free": free, "loads": names},
        "pose": [{"name": name} for name in ("tx", "ty", "tz", "rx", "ry", "rz")],
        "space": table_of(scene.pose_space),
        "python": model,
    }
    code = run(tmp_path, _OPTI, {"content": content, "pose": pose.tolist(), "wanted": wanted})
    scope = {}
    exec(code, scope)
    assert isinstance(scope["opti"], ca.Opti)
    assert isinstance(scope["contact"], cc.ContactInOpti)
    (found,) = scope["contact"].poses(scope["solution"])
    np.testing.assert_allclose(made(found, names), wanted, atol=1e-3)
    held = [k for k, name in enumerate(("tx", "ty", "tz", "rx", "ry", "rz")) if name not in free]
    np.testing.assert_allclose(found[held], pose[held], atol=1e-8)
