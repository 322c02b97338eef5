"""Poses and loads measured together, with the standard deviation of each; from a file, or made up with known truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.parameters import PLACEMENT
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.networks.frames import placed, pose_of, relative_pose
from casadi_contact.optimisation.knee import SIDES, check_knee
from casadi_contact.optimisation.starts import settle_in_range
from casadi_contact.scenes.columns import read_columns
from casadi_contact.scenes.pose_file import poses_from_curves
from casadi_contact.scenes.walking import reference_cycle
from problems.common.records import load_columns, pose_columns

TRUTH = {  # of the made-up measurement
    **{"youngs_modulus": 600.0, "poissons_ratio": 0.44, "thickness": 7.0},
    **{"fixed_tx": 0.8, "fixed_ty": -0.5, "fixed_tz": 0.6, "fixed_rx": 0.02, "fixed_ry": -0.03, "fixed_rz": 0.01},
}
_SWING_MM = {"tx": (2.0, 2.5), "tz": (0.0, 1.0)}  # middle and swing of the made-up motion, as by a joint simulator
_LEAST_FORCE_N = 150.0
MOTIONS = ("walking", "pressing")
_TOUCHING_N, _PRESSING_N = 30.0, 1000.0  # of each side, on the scene's own material; on the true one a third more


@dataclass(frozen=True)
class Measurement:
    """Poses (n, 6) and loads (n, L) in one frame, and the standard deviation of their errors: force_n, torque_nmm,
    length_mm, angle_rad. Raises ValueError for shapes that do not fit, and for a deviation that is not positive."""

    poses: Array
    loads: Array
    load_names: tuple[str, ...]
    force_n: float = 5.0
    torque_nmm: float = 100.0
    length_mm: float = 0.01
    angle_rad: float = 2e-4

    def __post_init__(self) -> None:
        if self.loads.shape != (len(as_poses(self.poses)), len(self.load_names)) or not np.isfinite(self.loads).all():
            expected = (len(self.poses), len(self.load_names))
            raise ValueError(f"loads have shape {self.loads.shape}, expected finite numbers {expected}")
        for name in ("force_n", "torque_nmm", "length_mm", "angle_rad"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"the standard deviation {name} is {getattr(self, name)}, expected a positive number")

    @property
    def load_deviation(self) -> Array:
        """Standard deviation of each load (L,) [N, N·mm]."""
        return np.array([self.force_n if name[0] == "F" else self.torque_nmm for name in self.load_names])

    @property
    def pose_deviation(self) -> Array:
        """Standard deviation of each pose parameter (6,) [mm, rad]."""
        return np.repeat([self.length_mm, self.angle_rad], 3)

    def columns(self) -> dict[str, Array]:
        """Columns of a file that `read_measurement` reads."""
        return {**pose_columns(self.poses), **load_columns(self.load_names, self.loads)}


def read_measurement(path: Path, model: SymbolicContact, **deviations: float) -> Measurement:
    """A CSV with tx_mm ... rz_rad and a column for each of the model's loads, such as Fy_med_N and Tx_Nmm.

    Raises FileNotFoundError, and ValueError naming file, line and column, also for angles beyond a whole turn and
    lengths beyond 1 m.
    """
    names = model.load_names
    columns = list(pose_columns(np.zeros((1, len(POSE_NAMES)))))
    loads = list(load_columns(names, np.zeros((1, len(names)))))
    found = read_columns(path, required=(*columns, *loads), what="measurement")
    try:
        poses = poses_from_curves({name: found[column] for name, column in zip(POSE_NAMES, columns, strict=True)})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return Measurement(
        poses,
        np.column_stack([found[name] for name in loads]),
        names,
        **deviations,
    )


def synthetic_measurement(
    model: CompiledFoundation,
    truth: Mapping[str, float],
    *,
    frames: int = 30,
    motion: str = "walking",
    noise: float = 1.0,
    seed: int = 1,
    **deviations: float,
) -> Measurement:
    """What would be measured of a joint with the true parameters while the femur swings by some mm, at flexion and
    rotation of the built-in walk, with normal errors: noise times the deviations.

    motion: "walking" with its medial and lateral forces, or "pressing": every other frame barely touches, the others
    press hard, by which stiffness and height of the insert are told apart. Raises ValueError for another one, and for
    a scene of no knee with two sides.
    """
    if motion not in MOTIONS:
        raise ValueError(f"motion is {motion!r}, expected one of {', '.join(MOTIONS)}")
    check_knee("a made-up measurement", model.scene, model.load_names, SIDES)
    cycle = reference_cycle(frames)
    share = 2.0 * np.pi * np.arange(frames) / frames
    relative = np.tile(model.scene.start_pose, (frames, 1))
    for name, curve in cycle.measured_pose().items():
        relative[:, POSE_NAMES.index(name)] = curve
    for turns, (name, (middle, swing)) in enumerate(_SWING_MM.items(), start=2):
        relative[:, POSE_NAMES.index(name)] = middle + swing * np.sin(turns * share)
    forces = dict(zip(SIDES, (cycle.fy_med, cycle.fy_lat), strict=True))
    targets = {name: np.minimum(curve, -_LEAST_FORCE_N) for name, curve in forces.items()}
    if motion == "pressing":
        targets = dict.fromkeys(forces, np.where(np.arange(frames) % 2, -_TOUCHING_N, -_PRESSING_N))
    relative = settle_in_range(model, relative, relative, POSE_NAMES, targets)
    place = np.array([truth.get(name, 0.0) for name in PLACEMENT])
    poses = in_scene_frame(relative, place)
    function = model.function(parameters=tuple(truth))
    loads = np.asarray(function.map(frames)(poses.T, ca.repmat(ca.DM(list(truth.values())), 1, frames))).T
    exact = Measurement(poses, loads, model.load_names, **deviations)
    draw = np.random.default_rng(seed)
    return Measurement(
        poses + noise * exact.pose_deviation * draw.standard_normal(poses.shape),
        loads + noise * exact.load_deviation * draw.standard_normal(loads.shape),
        model.load_names,
        **deviations,
    )


def in_scene_frame(relative: Array, place: Array) -> Array:
    """Poses (n, 6) in the scene's frame of a moving body at poses (n, 6) in a fixed body that lies at place (6)."""
    return _composed(relative, place, inverse=False)


def in_fixed_body(poses: Array, place: Array) -> Array:
    """The reverse of `in_scene_frame`."""
    return _composed(poses, place, inverse=True)


def _composed(poses: Array, place: Array, *, inverse: bool) -> Array:
    pose, at = ca.SX.sym("pose", 6), ca.SX.sym("at", 6)
    (t, R), (s, turn) = placed(ca.SX.zeros(6), pose), placed(ca.SX.zeros(6), at)
    out = relative_pose((s, turn), (t, R)) if inverse else pose_of(s + turn @ t, turn @ R)
    return np.asarray(ca.Function("composed", [pose, at], [out]).map(len(poses))(poses.T, place)).T
