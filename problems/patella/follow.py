"""The poses of a patella, frame by frame, on a femur whose poses are known, under the pull of the quadriceps.

Nothing of it is measured: it stands where its contact with the femur, the patellar tendon and the quadriceps balance
(`Settling`). Frames begin at their solved neighbour's pose, outwards from the frame whose flexion is nearest to that of
the assembly's start, or each at a start of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import LEVER_MM, POSE_NAMES, Array, as_poses
from casadi_contact.core.quantities import TORQUE
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.settle import Settling
from casadi_contact.optimisation.verification.verdict import Verdict, judge, own_model

TOLERANCE_N = 1e-4
LEAST_TENSION_N = 1.0  # of the quadriceps: nothing says where a patella stands that they do not hold
SAME_N = 0.01
ASIDE_MM, ASIDE_RAD = 2.0, 0.05


@dataclass(frozen=True)
class Ride:
    """Poses (n, 2, 6) of femur and patella in the tibia, loads (n, L) of ``assembly.load_names``, what is left on the
    patella [N] (n,), and whether it is in equilibrium (n,)."""

    assembly: Assembly
    poses: Array
    loads: Array
    residual_n: Array
    converged: np.ndarray

    def contact_poses(self, name: str) -> Array:
        """Poses (n, 6) of a contact's moving body in its fixed one."""
        return self.assembly.contact_poses(name, self.poses)

    def loads_apart_n(self, other: Ride) -> Array:
        """Largest difference of loads (n,) [N], see `loads_apart_n`."""
        return loads_apart_n(self.assembly, self.loads, other.loads)

    def verdict(self, name: str) -> Verdict:
        """What the elastic foundation says of a contact at these poses."""
        model = self.assembly.contact(name).model
        return judge(model, self.contact_poses(name), self.converged, own_model(model.scene))


def follow(
    assembly: Assembly,
    femur: Array,
    tension_n: Array,
    start: Array | None = None,
    *,
    tolerance_n: float = TOLERANCE_N,
) -> Ride:
    """Settle the patella in every frame.

    femur: poses (n, 6) in the tibia. tension_n: pull of the quadriceps (n,), slack ones pull by `LEAST_TENSION_N`.
    start: poses (n, 6) of the patella, each frame's own. tolerance_n: what may be left on the patella, torques over
    25 mm [N]. Raises ValueError for wrong shapes, quadriceps that push, and an assembly of other bodies or pulls.
    """
    femur, tension_n = as_poses(femur), np.asarray(tension_n, dtype=float)
    if assembly.bodies != ("femur", "patella"):
        raise ValueError(
            f"assembly {assembly.name} has the bodies {', '.join(assembly.bodies)}, expected femur, patella"
        )
    if len(assembly.pulls) != 1:
        pulls = ", ".join(pull.name for pull in assembly.pulls) or "none"
        raise ValueError(f"assembly {assembly.name} has the pulls {pulls}, expected one, the quadriceps")
    tension_n = _taut(tension_n, len(femur))
    settle, function = Settling(assembly, {"patella": POSE_NAMES}), assembly.function()
    poses = np.stack([femur, np.tile(assembly.start_poses()[1], (len(femur), 1)) if start is None else start], axis=1)
    residual = np.full(len(femur), np.inf)
    first = int(np.abs(femur[:, 5] - assembly.start_poses()[0, 5]).argmin())
    for frame, neighbour in outwards(first, len(femur)):
        if start is None and neighbour is not None:
            poses[frame, 1] = poses[neighbour, 1]
        held = settle(poses[frame], tensions=[float(tension_n[frame])], tolerance=tolerance_n)
        residual[frame] = held.residual
        poses[frame] = held.poses if held.converged else poses[frame]
    loads = np.array([np.asarray(function(pair.T)).ravel() for pair in poses])
    return Ride(assembly, poses, loads, residual, residual <= tolerance_n)


def _taut(tension_n: Array, frames: int) -> Array:
    """Tensions (n,), those of slack quadriceps raised to `LEAST_TENSION_N`: solvers let a zero slip below itself."""
    if tension_n.shape != (frames,):
        raise ValueError(f"tensions have shape {tension_n.shape}, expected ({frames},): one [N] for each frame")
    odd = np.flatnonzero(~(np.isfinite(tension_n) & (tension_n > -LEAST_TENSION_N)))
    if len(odd):
        raise ValueError(
            f"the tension of frame {odd[0]} is {tension_n[odd[0]]:g} N, expected 0 or more: quadriceps never push"
        )
    return np.maximum(tension_n, LEAST_TENSION_N)


def loads_apart_n(assembly: Assembly, loads: Array, others: Array) -> Array:
    """Largest difference of an assembly's loads (n, L) [N], torques over 25 mm, (n,). Where nothing presses a body its
    place is not determined, but its loads are."""
    scales = [LEVER_MM if kind == TORQUE else 1.0 for kind in assembly.load_kinds.values()]
    return np.asarray(np.abs((loads - others) / scales).max(axis=1))


def start_poses(ride: Ride, rng: np.random.Generator) -> Array:
    """Poses (n, 6) of the patella at random about where it rides, up to `ASIDE_MM` and `ASIDE_RAD` off."""
    spread = np.repeat([ASIDE_MM, ASIDE_RAD], 3)
    return np.asarray(ride.poses[:, 1] + rng.uniform(-1.0, 1.0, ride.poses[:, 1].shape) * spread)


def outwards(first: int, count: int) -> list[tuple[int, int | None]]:
    """Frames and the neighbour that each begins at, from the first one on to both ends."""
    after = [(frame, frame - 1) for frame in range(first + 1, count)]
    before = [(frame, frame + 1) for frame in range(first - 1, -1, -1)]
    return [(first, None), *after, *before]
