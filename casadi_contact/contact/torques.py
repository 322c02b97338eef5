"""Whether a contact model's torques belong to its forces: in N·mm on the fixed body, about its origin.

Contact without friction stores its energy: U(q) with -∂U/∂q = (F, Q), where F is the force of a patch and, for its
torque T about the fixed body's origin, Q = Eᵀ(T - t × F), E the map of `angular_velocity_map`. So

    ∂F_i/∂θ_j = ∂Q_j/∂t_i = [Eᵀ(∂T/∂t_i - e_i × F - t × ∂F/∂t_i)]_j

which elements with pressure along the fixed body's normals meet to 2 %. Torques of another unit, sign or origin do not.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.conventions import Array, angular_velocity_map

_OFF, _EXPLAINS = 0.2, 0.2  # of what the forces alone ask for; of what is off, that the cure may leave

CURES: Mapping[tuple[float, bool], str] = {
    (1000.0, True): "in N·m, expected N·mm: return 1000 times the torques",
    (-1.0, True): "of the wrong sign: return the negative torques, with forces as they are",
    (1.0, False): (
        "about the moving body's origin, expected the fixed body's: return T + t × F with the pose's translation t"
    ),
    (1000.0, False): (
        "in N·m about the moving body's origin, expected N·mm about the fixed body's: return 1000·T + t × F with the "
        "pose's translation t"
    ),
}
"""What may be wrong, by the factor of the torques and whether they are about the fixed body's origin."""


def wrong_torques(poses: Array, wrenches: Array, slopes: Array) -> str:
    """What is wrong with the torques of contacts, and its cure; "" where nothing is, where what is has another cause,
    and for a model without torques.

    poses (k, 6); wrenches (k, 6) of a patch each and slopes (k, 6, 6), their derivatives by the pose.
    """
    known = np.isfinite(wrenches).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
    poses, wrenches, slopes = poses[known], wrenches[known], slopes[known]
    turned = np.swapaxes(slopes[:, :3, 3:], 1, 2)  # ∂F_i/∂θ_j by j and i, as all that follows
    carried = np.swapaxes(np.cross(np.eye(3), wrenches[:, None, :3]), 1, 2)
    carried += np.swapaxes(np.cross(poses[:, None, :3], np.swapaxes(slopes[:, :3, :3], 1, 2)), 1, 2)
    powers = np.swapaxes(angular_velocity_map(poses[:, 3:]), 1, 2)

    def off(factor: float, about_fixed: bool) -> float:
        return float(np.linalg.norm(turned - powers @ (factor * slopes[:, 3:, :3] - about_fixed * carried)))

    if not wrenches[:, 3:].any():
        return ""
    here = off(1.0, True)
    best = min(CURES, key=lambda which: off(*which))
    if not here > _OFF * np.linalg.norm(powers @ carried) or off(*best) > _EXPLAINS * here:
        return ""
    return CURES[best]
