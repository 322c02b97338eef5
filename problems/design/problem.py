"""Design: the dish radii of a knee insert that give the lowest peak pressure over walking at bounded laxity.

    min P    over radii (sagittal, frontal), P, and the free pose parameters (tx, ty, tz, rx) of every pose, with

    frames of walking:   Fy_med, Fy_lat as wanted, Fx = Fz = 0 at the cycle's rz and ry;   p_max <= P on both sides
    laxity:              a load of 350 N on each side and ±100 N along x, or ±50 N along z, at 20° of flexion;
                         the travel between + and -, along x and z, within bounds

p_max = K/h·d_max at the deepest point (linear law). The poses are in balance at every solution of the constraints, so
that the gradient of the peak by the radii holds how the femur moves. Derivatives are exact to first order
(`contact.polar.dish_slopes`); IPOPT builds up the Hessian (limited memory).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.polar.dish_slopes import RADII
from casadi_contact.contact.pressure_law import layer_modulus
from casadi_contact.core.conventions import POSE_NAMES, Array, pose_index
from casadi_contact.optimisation.knee import SIDES, check_knee
from casadi_contact.optimisation.starts import KNEE_STEPS
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import reference_cycle
from problems.design.dish import DishContact

FREE = ("tx", "ty", "tz", "rx")
BALANCED = (*SIDES, "Fx", "Fz")
LAXITY_PUSHES = {"ap": ("tx", "Fx", 100.0), "ml": ("tz", "Fz", 50.0)}  # [N], with its opposite
LAXITY_SIDE_N, LAXITY_FLEXION_DEG = 350.0, 20.0
_CLEARANCE_MM = 0.5  # least difference of radii between condyle and dish
_LARGEST_RADIUS_MM = 200.0
_AT_BOUND_MM = 1e-3
_RADIUS_STEP_MM, _PRESSURE_STEP_MPA, _FORCE_STEP_N = 5.0, 5.0, 30.0


@dataclass(frozen=True)
class Bounds:
    """Least and largest travel [mm] under the pushes of `LAXITY_PUSHES`, along x and z."""

    ap_mm: tuple[float, float]
    ml_mm: tuple[float, float]

    def __post_init__(self) -> None:
        for name in ("ap_mm", "ml_mm"):
            low, high = getattr(self, name)
            if not 0.0 <= low < high:
                raise ValueError(f"laxity {name} is {low:g},{high:g}, expected two rising numbers >= 0")


@dataclass(frozen=True)
class Design:
    """A problem that can be looked at unsolved. wanted (n, 4): loads of `BALANCED` at every pose; locked (n, 6): poses
    that hold rz and ry; the last four poses are those of laxity, x then z, each push then its opposite.

    x of the nlp: scaled radii (2), P, then scaled `FREE` of every pose; unpack: x -> radii (2), P, poses (6, n).
    """

    contact: DishContact
    bounds: Bounds
    wanted: Array
    locked: Array
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    lower_g: Array
    upper_g: Array
    unpack: ca.Function

    @property
    def frames(self) -> int:
        """Frames of walking."""
        return len(self.wanted) - 2 * len(LAXITY_PUSHES)


def wanted_loads(frames: int) -> tuple[Array, Array]:
    """Loads (n, 4) and locked poses (n, 6) of the built-in walking cycle and of the laxity tests."""
    cycle = reference_cycle(frames)
    walking = np.column_stack([cycle.fy_med, cycle.fy_lat, np.zeros((frames, 2))])
    pushes = [(load, sign * force) for _, load, force in LAXITY_PUSHES.values() for sign in (1.0, -1.0)]
    lax = np.zeros((len(pushes), len(BALANCED)))
    lax[:, :2] = -LAXITY_SIDE_N
    locked = np.zeros((frames + len(pushes), 6))
    for row, (load, force) in enumerate(pushes):
        lax[row, BALANCED.index(load)] = force
    locked[:frames, pose_index("rz")], locked[:frames, pose_index("ry")] = cycle.rz, cycle.ry
    locked[frames:, pose_index("rz")] = -np.radians(LAXITY_FLEXION_DEG)
    return np.vstack([walking, lax]), locked


def build(contact: DishContact, bounds: Bounds, frames: int = 12) -> Design:
    """Pose the problem. Raises ValueError for a pressure law whose peak is not K/h·d, and for a scene of no knee with
    two sides (`check_knee`)."""
    check_knee("the design of a dish", contact.scene, contact.load_names, BALANCED)
    material = contact.scene.material
    if material.law != "linear":
        raise ValueError(f"the pressure law is {material.law!r}, expected linear")
    wanted, locked = wanted_loads(frames)
    n, names = len(wanted), contact.load_names
    radii, peak, q = ca.MX.sym("radii", 2), ca.MX.sym("peak"), ca.MX.sym("q", len(FREE), n)
    steps = ca.diag(ca.DM(KNEE_STEPS[[pose_index(name) for name in FREE]]))
    moved = dict(zip(FREE, ca.vertsplit(ca.mtimes(steps, q)), strict=True))
    fixed = {name: ca.DM(locked[None, :, pose_index(name)]) for name in POSE_NAMES}
    poses = ca.vertcat(*(moved.get(name, fixed[name]) for name in POSE_NAMES))
    radii_mm = _RADIUS_STEP_MM * radii
    both = ca.reshape(contact.function(n)(ca.vertcat(ca.vec(poses), radii_mm)), -1, n)
    loads = both[[names.index(name) for name in BALANCED], :]
    pressures = layer_modulus(material) / material.thickness * both[len(names) :, :frames]
    room = peak - ca.vec(pressures) / _PRESSURE_STEP_MPA
    travel = [
        poses[pose_index(parameter), frames + 2 * k] - poses[pose_index(parameter), frames + 2 * k + 1]
        for k, (parameter, _, _) in enumerate(LAXITY_PUSHES.values())
    ]
    off = ca.vec(loads - ca.DM(wanted.T)) / _FORCE_STEP_N
    x = ca.vertcat(radii, peak, ca.vec(q))
    low, high = np.full(x.numel(), -np.inf), np.full(x.numel(), np.inf)
    low[:2], high[:2] = least_radii(contact.scene) / _RADIUS_STEP_MM, _LARGEST_RADIUS_MM / _RADIUS_STEP_MM
    laxity = np.array([bounds.ap_mm, bounds.ml_mm])
    return Design(
        contact=contact,
        bounds=bounds,
        wanted=wanted,
        locked=locked,
        nlp={"x": x, "f": peak, "g": ca.vertcat(off, room, *travel)},
        lower=low,
        upper=high,
        lower_g=np.concatenate([np.zeros(off.numel() + room.numel()), laxity[:, 0]]),
        upper_g=np.concatenate([np.zeros(off.numel()), np.full(room.numel(), np.inf), laxity[:, 1]]),
        unpack=ca.Function("unpack", [x], [radii_mm, _PRESSURE_STEP_MPA * peak, poses]),
    )


def least_radii(scene: Scene) -> Array:
    """The narrowest dish (2,) [mm] of the search, wider by `_CLEARANCE_MM` than condyle and half plateau of every side,
    which may have their own."""
    sides = [scene.patch_geometry(patch) for patch in scene.patch_names]
    condyles = [(max(side["sagittal_radii"]), side["frontal_radius"]) for side in sides]
    halves = [(0.5 * side["plateau_length"], 0.5 * side["plateau_width"]) for side in sides]
    return np.max([*condyles, *halves], axis=0) + _CLEARANCE_MM


def at_bounds(design: Design, radii_mm: Array) -> str:
    """The radii (2,) that a bound of the search holds, in words; "" for none. The bounds keep a dish wider than condyle
    and plateau, and below `_LARGEST_RADIUS_MM`."""
    low, high = (_RADIUS_STEP_MM * bound[: len(RADII)] for bound in (design.lower, design.upper))
    held = np.minimum(np.abs(radii_mm - low), np.abs(radii_mm - high)) < _AT_BOUND_MM
    return ", ".join(f"{RADII[k]} at {radii_mm[k]:.4g} mm" for k in np.flatnonzero(held))


def variables(design: Design, radii_mm: Array, poses: Array, peak_mpa: float) -> Array:
    """x at radii, balanced poses (n, 6) and a peak pressure."""
    columns = [pose_index(name) for name in FREE]
    head = [*(np.asarray(radii_mm) / _RADIUS_STEP_MM), peak_mpa / _PRESSURE_STEP_MPA]
    return np.concatenate([head, (poses[:, columns] / KNEE_STEPS[columns]).ravel()])
