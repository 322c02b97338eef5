"""A knee with two sides: its loads, the six coordinates of its inverse dynamics, and poses without shear.

    Σ_m arm_m·F_m + contact on the femur = inverse dynamics        [N, N·m]

The femoral component moves. The load of a translation is a force in the fixed frame, on the femur. The load of a
rotation is the moment about the moving origin, along the axis of rx, ry or rz: Eᵀ(T - t×F), with T, F on the femur
about the fixed origin and E of `angular_velocity_map`.
"""

import itertools
import warnings
from collections.abc import Sequence

import casadi as ca
import numpy as np

from casadi_contact.contact.settle import settle
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import LEVER_MM, POSE_NAMES, Array
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from casadi_contact.optimisation.starts import middle_pose, pose_bounds
from casadi_contact.scenes.scene import Scene

SIDES = ("Fy_med", "Fy_lat")
KNEE_LOADS = (*SIDES, "Fx", "Fz", "Tx", "Ty", "Tz")
FREE = ("tx", "ty", "tz", "rx")
PRESSED_N = 500.0  # of each side, where a pose without shear is sought


def check_knee(what: str, scene: Scene, load_names: Sequence[str]) -> None:
    """Raise ValueError unless a contact model with these loads gives `KNEE_LOADS` and its scene leaves all six pose
    parameters free; what: the problem that needs such a knee, with its article."""
    if not set(KNEE_LOADS) <= set(load_names):
        got = f"scene {scene.name} has the loads {', '.join(load_names)}"
        raise ValueError(f"{what} needs a knee with two sides: {got}, expected {', '.join(KNEE_LOADS)}")
    scene.pose_space.check_unconstrained(what)


# Coordinates of inverse dynamics, each with the pose parameter it belongs to.
COORDINATES = {"knee_tx": "tx", "knee_ty": "ty", "knee_tz": "tz"}
COORDINATES |= {"knee_adduction": "rx", "knee_rotation": "ry", "knee_flexion": "rz"}


def coordinate_unit(coordinate: str) -> str:
    """N for a translation, Nm for a rotation."""
    return "N" if COORDINATES[coordinate].startswith("t") else "Nm"


def in_newtons(coordinate: str) -> float:
    """Comparable newtons of one N or N·m of a coordinate's load."""
    return 1.0 if coordinate_unit(coordinate) == "N" else 1000.0 / LEVER_MM


def contact_on_femur(pose: ca.MX, loads: ca.MX) -> dict[str, ca.MX]:
    """Generalised loads [N, N·m] on the femur by coordinate, for a pose (6) and loads (7) as in `KNEE_LOADS`."""
    wrench = ca.mtimes(ca.DM(total_selection(KNEE_LOADS, ("med", "lat"))), loads)
    on_tibia = generalised_forces(pose, wrench) * ca.DM([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
    return dict(zip(COORDINATES, ca.vertsplit(-on_tibia), strict=True))


def shear_free_poses(model: SymbolicContact, ry: Array, rz: Array) -> Array:
    """Poses (n, 6) at given rotations (n,), (n,) [rad] where vertical forces of 500 N on both sides cause no shear,
    Fx = Fz = 0. That fixes the pose parameters that nothing else does.

    Frames that find none settle from a neighbour's pose. Where there is none the femur stands where shear is least,
    with a RuntimeWarning. Raises ValueError where rotations lie outside what the surrogate learned, the least shear
    exceeds 50 N, or the scene locks or ties pose parameters."""
    model.scene.pose_space.check_unconstrained("a pose without shear")
    low, high = pose_bounds(model)
    poses = np.tile(middle_pose(model), (len(rz), 1))
    for name, angle in (("ry", ry), ("rz", rz)):
        column = POSE_NAMES.index(name)
        poses[:, column] = angle
        if angle.min() < low[column] or angle.max() > high[column]:
            learned = f"the surrogate learned {low[column]:.3g} to {high[column]:.3g}: train one around your own cycles"
            raise ValueError(f"{name} reaches from {angle.min():.3g} to {angle.max():.3g} rad, {learned}")
    poses, shear = _without_shear(model, poses)
    for frame, beside in (*itertools.pairwise(range(len(rz) - 1, -1, -1)), *itertools.pairwise(range(len(rz)))):
        if shear[frame] == 0.0 and shear[beside] > 0.0:  # from a neighbour's pose
            tried, left = _without_shear(model, np.append(poses[frame, :4], poses[beside, 4:])[None])
            if left[0] < shear[beside]:
                poses[beside], shear[beside] = tried[0], left[0]
    if (rows := shear > 0.0).any():
        said = f"{rows.sum()} of {len(rows)} frames have no pose without shear under {PRESSED_N:g} N on each side"
        if (none := np.isinf(shear)).any():
            raise ValueError(f"{said}, frame {none.argmax()} none with little: are rotations those of this knee?")
        warnings.warn(f"{said}: {shear.max():.2g} N are left where it is least", RuntimeWarning, stacklevel=2)
    return poses


def _without_shear(model: SymbolicContact, poses: Array) -> tuple[Array, Array]:
    """Poses (n, 6) settled without shear, and the shear left (n,) [N]: 0 where settled, infinite where the sides do not
    carry 500 N or more than a tenth of it is left."""
    sides = dict.fromkeys(model.scene.sensitive_loads, -PRESSED_N)
    poses, _ = settle(model, poses, ("ty", "rx"), sides, tolerance=1.0)
    poses, report = settle(model, poses, FREE, {**sides, "Fx": 0.0, "Fz": 0.0}, tolerance=0.1)
    loads = dict(zip(model.load_names, model(poses).T, strict=True))
    shear = np.hypot(loads["Fx"], loads["Fz"])
    carried = np.all([np.abs(loads[name] - force) < 0.1 * PRESSED_N for name, force in sides.items()], axis=0)
    left = np.where(carried & (shear <= 0.1 * PRESSED_N), shear, np.inf)
    return poses, np.where(report.converged, 0.0, left)
