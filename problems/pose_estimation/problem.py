"""Pose estimation: the poses of a cycle that carry measured medial and lateral forces and centres of pressure (§3.3).

ry and rz are locked to the measured curves; tx, ty, tz and rx of every frame are free. All frames stand in one IPOPT
problem with exact Hessian:

    min ½ Σ |r_k(q_k)|² + ½ smoothness·Σ |q_{k+1} - q_k|²    with q_k in the learned range

    r = ( 2·√(N0·N*_med)·(s_med - s*_med),  2·√(N0·N*_lat)·(s_lat - s*_lat),
          (Tz - cop_ap*·Fy)/L,  (Tx + cop_ml*·Fy)/L )    [N]

with starred values wanted, s = √(N/N0) the signed root load, Fy the surrogate's own total, and L = 10 mm. Forces are
compared as root loads because those are nearly linear in the pose and keep their slope out of contact (near the
solution the residual is the force error); the centre of pressure is written without dividing by the load. Variables
are scaled by the moves that change the residuals alike, so that IPOPT's regularisation bears on all of them alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.motion.load_cycle import LoadCycle
from casadi_contact.optimisation import KNEE_STEPS, ContactFrames
from casadi_contact.structures import Surrogate

FREE = ("tx", "ty", "tz", "rx")
FREE_COLUMNS = [pose_index(name) for name in FREE]
FREE_STEPS = KNEE_STEPS[FREE_COLUMNS]
LOADS = ("Fy_med", "Fy_lat", "Tx", "Tz")
_WANTED = ("Fy_med", "Fy_lat", "cop_ap_mm", "cop_ml_mm")  # and with them ry and rz


@dataclass(frozen=True)
class PoseEstimation:
    """A problem that can be looked at unsolved: CasADi's nlp, its variables' bounds and scales (`ContactFrames`), and
    what it came from. residuals: scaled free parameters (4, n) -> residuals (4, n) [N]."""

    surrogate: Surrogate
    cycle: LoadCycle
    smoothness: float
    compiled: bool
    contact: ContactFrames
    nlp: dict[str, Any]
    residuals: ca.Function

    def one_frame(self) -> dict[str, Any]:
        """The nlp of one frame alone, with what is wanted of it (`wanted_of`) as parameters (6)."""
        wanted = ca.MX.sym("wanted", 6)
        contact, residuals = _residuals(self.surrogate, ca.vertsplit(wanted), 1, compiled=self.compiled)
        return {"x": ca.vec(contact.q), "p": wanted, "f": 0.5 * ca.sumsqr(residuals)}

    def start_poses(self) -> Array:
        """Start poses (n, 6): the middle of the learned range at ry and rz of the cycle."""
        return self.contact.start_poses()


def cop(loads: Array) -> Array:
    """Centre of pressure (n, 2): (Tz/Fy, -Tx/Fy) [mm], NaN without load, for loads (n, 4) as in `LOADS`."""
    fy = loads[:, 0] + loads[:, 1]
    fy = np.where(fy < 0.0, fy, np.nan)
    return np.column_stack([loads[:, LOADS.index("Tz")] / fy, -loads[:, LOADS.index("Tx")] / fy])


def wanted_of(cycle: LoadCycle) -> Array:
    """Forces [N], centre of pressure [mm], ry and rz [rad] of all frames (6, n)."""
    return np.stack([cycle.fy_med, cycle.fy_lat, cycle.cop_ap_mm, cycle.cop_ml_mm, cycle.ry, cycle.rz])


def _residuals(surrogate: Surrogate, wanted: Any, count: int, *, compiled: bool) -> tuple[ContactFrames, ca.MX]:
    """Frames whose variables are `FREE`, and their residuals (4, count) [N] for wanted rows as in `wanted_of`."""
    *targets, ry, rz = wanted
    contact = ContactFrames(surrogate, count, locked={"ry": ry, "rz": rz}, loads=LOADS, compiled=compiled)
    return contact, contact.misfit(dict(zip(_WANTED, targets, strict=True)))


def build(surrogate: Surrogate, cycle: LoadCycle, smoothness: float = 0.0, *, compiled: bool = False) -> PoseEstimation:
    """Pose the problem for all frames of a cycle; smoothness [N²/mm²] weighs the change from frame to frame.

    compiled: the surrogate as a C kernel, which solves several times faster once it is compiled (`Surrogate.function`).
    Raises ValueError for a negative smoothness or a surrogate without the needed loads.
    """
    if not smoothness >= 0.0:
        raise ValueError(f"smoothness is {smoothness}, expected a number >= 0")
    count = len(cycle)
    contact, residuals = _residuals(surrogate, wanted_of(cycle), count, compiled=compiled)
    q, objective = contact.q, 0.5 * ca.sumsqr(residuals)
    if smoothness > 0.0 and count > 1:
        steps_mm = (q[:, 1:] - q[:, :-1]) * ca.repmat(ca.DM((POSE_IN_MM * KNEE_STEPS)[FREE_COLUMNS]), 1, count - 1)
        objective += 0.5 * smoothness * ca.sumsqr(steps_mm)
    nlp = {"x": ca.vec(q), "f": objective}
    all_residuals = ca.Function("all_residuals", [q], [residuals])
    return PoseEstimation(surrogate, cycle, smoothness, compiled, contact, nlp, all_residuals)
