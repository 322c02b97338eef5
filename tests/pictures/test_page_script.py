"""The page's own JavaScript in node: settling keeps to what a scene locks or ties."""

import json
import shutil
import subprocess
from importlib import resources

import numpy as np
import pytest

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
