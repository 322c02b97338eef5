"""A contact model of one's own, with no elastic foundation behind it: a ball of stiffness k in a spherical socket.

With the ball's centre displaced by e from the socket's: F = k·max(|e| - c, 0)²·e/|e|, T = centre × F.
"""

import csv

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES
from casadi_contact.scenes.scene import Scene

CLEARANCE_MM, STIFFNESS = 0.4, 2.0e5  # N/mm²
CENTRE_MM = np.array([5.0, -3.0, 2.0])

SCENE = Scene.from_toml("""
format = 1
name = "socket"
shape = "own_model"

[geometry.patches]
contact = { anchor = [0.0, 0.0, 0.0] }

[loads]
names = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]
sensitive = ["F"]
sensitive_pose = ["tx", "ty", "tz"]
reference_load = 1000.0
gap_slope = 14.0
boundary_load = 5.0

[motion]
cycles = 3

[motion.harmonics]
Fx_N = [20.0, 40.0, 10.0]
Fy_N = [500.0, 200.0, 30.0]
Fz_N = [50.0, 20.0, -40.0]
rx_rad = [0.0, 0.1, 0.0]
ry_rad = [0.1, 0.0, 0.1]
rz_rad = [0.0, 0.3, 0.1]

[sampling]
counts = { D1 = 4000, D2 = 2000, D3 = 4000, D4 = 0, D5 = 900, D6 = 0, D7 = 300 }
liftoff_mm = 0.4

[tolerances]
Fx = 2.0
Fy = 2.0
Fz = 2.0
Tx = 10.0
Ty = 10.0
Tz = 10.0
""")


def _displacement(poses):
    e = poses[:, :3] - CENTRE_MM
    return e, np.maximum(np.linalg.norm(e, axis=1), 1e-12)


def wrenches(poses):
    e, size = _displacement(poses)
    force = (STIFFNESS * np.maximum(size - CLEARANCE_MM, 0.0) ** 2 / size)[:, None] * e
    return np.concatenate([force, np.cross(CENTRE_MM, force)], axis=1)[:, None, :]


def gaps(poses):
    return CLEARANCE_MM - _displacement(poses)[1][:, None]


def table_rows(count=1200):
    """Columns of a table of samples, each (count,): the ball touches the socket, or nearly does."""
    rng = np.random.default_rng(0)
    directions = np.array([0.1, 0.9, 0.2]) + rng.uniform(-0.2, 0.2, (count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    size = CLEARANCE_MM + rng.uniform(-0.02, 0.08, (count, 1))
    poses = np.hstack([CENTRE_MM + size * directions, rng.uniform(-0.3, 0.3, (count, 3))])
    columns = dict(zip(POSE_NAMES, poses.T, strict=True))
    columns |= dict(zip(WRENCH_NAMES, wrenches(poses)[:, 0].T, strict=True))
    return columns | {"gap": gaps(poses)[:, 0]}


def write_csv(path, columns):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(np.column_stack(list(columns.values())).tolist())
    return path
