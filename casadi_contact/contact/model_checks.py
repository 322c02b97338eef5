"""What loads tell of a contact model: mistakes, at a few poses, and which pose changes change them most [EF15 §2.1].

Contact without friction stores its energy: U(q) with -∂U/∂q = (F, Q), where F is the force of a patch and, for its
torque T about the fixed body's origin, Q = Eᵀ(T - t × F), E the map of `angular_velocity_map`. So

    ∂F_i/∂θ_j = ∂Q_j/∂t_i = [Eᵀ(∂T/∂t_i - e_i × F - t × ∂F/∂t_i)]_j

which elements with pressure along the fixed body's normals meet to 2 %. Torques of another unit, sign or origin do not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.approach import loading_directions, press_until
from casadi_contact.contact.model import ContactModel, with_loads
from casadi_contact.core.conventions import (
    LEVER_MM,
    POSE_NAMES,
    Array,
    angular_velocity_map,
    as_poses,
    check_above_zero,
    evenly_spaced_indices,
    pose_text,
)
from casadi_contact.core.quantities import FORCE, newton_scales, of_kind, two_digits

TORQUE_REMEDIES: Mapping[tuple[float, bool], str] = {
    (1000.0, True): "in N·m, expected N·mm: return 1000 times the torques",
    (-1.0, True): "of the wrong sign: return the negative torques, with forces as they are",
    (1.0, False): "about the moving body's origin, expected the fixed body's: return T + t × F with the translation t",
    (1000.0, False): "in N·m about the moving body's origin, expected N·mm about the fixed: return 1000·T + t × F",
}
"""What may be wrong, by the factor that mends the torques and whether they are about the fixed body's origin."""


def check_contact_model(
    model: ContactModel, touching: Array, target: Mapping[str, Array], tolerance_n: float, *, most_poses: int = 5
) -> None:
    """Raise ValueError for a model with loads of the wrong sign, unit or origin, or that is no function of the pose.

    It is evaluated at up to most_poses of the poses (n, 6) at the first touch, pressed on until they carry about the
    target loads (n,) by name. tolerance_n [N]: within which poses settle. Poses without a finite load are left out.
    """
    if not len(touching):
        return
    chosen = evenly_spaced_indices(len(touching), most_poses)
    forces_n = np.linalg.norm([target[name][chosen] for name in of_kind(list(target), FORCE)], axis=0)
    along = loading_directions(model, len(touching), target)[chosen]

    def force_of(at: Array) -> Array:
        return np.nan_to_num(np.linalg.norm(model.wrenches(at)[..., :3].sum(axis=1), axis=1))

    poses, _ = press_until(force_of, touching[chosen], along, np.maximum(forces_n, 1.0), 0.05)
    forces = model.wrenches(poses)[..., :3]
    sizes = np.nan_to_num(np.linalg.norm(forces, axis=2))
    rows, patches = np.nonzero(sizes > 0.0)
    if len(rows):
        poses, forces = poses[rows], forces[rows, patches]
        stiffness = _check_sign(model, poses, patches, forces)
        _check_function_of_pose(model, poses, patches, forces, stiffness, tolerance_n)
        wrenches, jacobians = (found[np.arange(len(poses)), patches] for found in model.wrench_jacobian(poses))
        if wrong := wrong_torques(poses, wrenches, jacobians):
            where = _text(model, poses[0], patches[0], forces[0])
            raise ValueError(f"the contact model's torques are {wrong}; seen at its {where}")


def _text(model: ContactModel, pose: Array, patch: int, force: Array) -> str:
    numbers = ", ".join(f"{value:.4g}" for value in force)
    return f"force ({numbers}) N of patch {model.patch_names[patch]} at {pose_text(pose, model.patch_names)}"


def _check_sign(
    model: ContactModel, poses: Array, patches: np.ndarray, forces: Array, step_mm: float = 0.1, clearly: float = 0.01
) -> Array:
    """The stiffness (k,) [N/mm] along the forces; ValueError for loads on the moving body instead of the fixed one.

    A force F on the fixed body grows as the moving body goes its way: |F(t + δ·F/|F|)| > |F(t - δ·F/|F|)|.
    """
    along = step_mm * forces / np.linalg.norm(forces, axis=1, keepdims=True)
    sizes = []
    for sign in (-1.0, 1.0):
        moved = poses.copy()
        moved[:, :3] += sign * along
        sizes.append(np.linalg.norm(model.wrenches(moved)[np.arange(len(poses)), patches, :3], axis=1))
    behind, ahead = sizes
    if (ahead < (1.0 - clearly) * behind).all():
        where = _text(model, poses[0], patches[0], forces[0])
        raise ValueError(
            f"the contact model's loads are those on the moving body: its {where} falls to {ahead[0]:.4g} N "
            f"{step_mm} mm ahead, expected more than behind: return -wrenches, the loads on the fixed body"
        )
    return np.asarray((ahead - behind) / (2.0 * step_mm))


def _check_function_of_pose(
    model: ContactModel, poses: Array, patches: np.ndarray, forces: Array, stiffness: Array, tolerance_n: float
) -> None:
    """ValueError for forces that differ by more than twice the tolerance when the same poses are evaluated again, in
    reverse order and between others: noise, hysteresis, or a solver that goes on from its last solution."""
    lifted = poses.copy()
    lifted[:, :3] -= 0.1 * forces / np.linalg.norm(forces, axis=1, keepdims=True)
    mixed = np.stack([lifted, poses], axis=1).reshape(-1, 6)  # each pose comes after a lighter one, then a deeper one
    up = model.wrenches(mixed)[1::2][np.arange(len(poses)), patches, :3]
    down = model.wrenches(mixed[::-1])[::-1][1::2][np.arange(len(poses)), patches, :3]
    off = np.nan_to_num(np.max([np.linalg.norm(found - forces, axis=1) for found in (up, down)], axis=0))
    row = int(off.argmax())
    if off[row] > 2.0 * tolerance_n:
        step = f", step_mm = {two_digits(100.0 * off[row] / stiffness[row])}" if stiffness[row] > 0.0 else ""
        raise ValueError(
            f"the contact model is no function of the pose: its {_text(model, poses[row], patches[row], forces[row])} "
            f"differs by {two_digits(off[row])} N when evaluated in another order, expected {2.0 * tolerance_n:g} N at "
            "most: reset its solver before every pose, without friction or other hysteresis; or, if this is noise, set "
            f"settle_tolerance_n = {two_digits(3.0 * off[row])} in the scene's [sampling]"
            f"{step and f' and give cc.CallableModel larger steps{step}'}"
        )


def wrong_torques(poses: Array, wrenches: Array, jacobians: Array, *, off: float = 0.2, explains: float = 0.2) -> str:
    """What is wrong with the torques of contacts, and its remedy; "" where nothing is, or none of these mistakes.

    poses (k, 6); wrenches (k, 6) of a patch each and jacobians (k, 6, 6), their derivatives by the pose. off: the
    residual, as a share of what forces ask for, from which torques are wrong; explains: the share of it that a remedy
    may leave. Forces act along the normals of one body: those of a cup have no torque about its centre, which looks
    like that of a ball about its own. So the origin is only doubted where torques have a lever.
    """
    finite = np.isfinite(wrenches).all(axis=1) & np.isfinite(jacobians).all(axis=(1, 2))
    poses, wrenches, jacobians = poses[finite], wrenches[finite], jacobians[finite]
    turned = np.swapaxes(jacobians[:, :3, 3:], 1, 2)  # ∂F_i/∂θ_j by j and i, as all that follows
    carried = np.swapaxes(np.cross(np.eye(3), wrenches[:, None, :3]), 1, 2)
    carried += np.swapaxes(np.cross(poses[:, None, :3], np.swapaxes(jacobians[:, :3, :3], 1, 2)), 1, 2)
    powers = np.swapaxes(angular_velocity_map(poses[:, 3:]), 1, 2)

    def residual(factor: float, about_fixed: bool) -> float:
        return float(np.linalg.norm(turned - powers @ (factor * jacobians[:, 3:, :3] - about_fixed * carried)))

    found = residual(1.0, True)
    levers, ways = np.linalg.norm(wrenches[:, 3:]), np.linalg.norm(poses[:, :3, None] * wrenches[:, None, :3])
    doubted = (each for each in TORQUE_REMEDIES if each[1] or each[0] * levers > explains * ways)
    best = min(doubted, key=lambda which: residual(*which))
    wrong = found > off * np.linalg.norm(powers @ carried) and residual(*best) <= explains * found
    return TORQUE_REMEDIES[best] if wrong else ""


@dataclass(frozen=True)
class SensitiveDirections:
    """How strongly a contact model's loads answer to its pose parameters, in comparable units [N/mm].

    names: pose parameters, most sensitive first; stiffness by name: root of the sum of squares of the loads' changes
    (torques over the lever) by 1 mm, or by the rotation that moves a point at the lever by 1 mm. directions (6, 6):
    the unit directions of pose change (tx ty tz [mm], rx ry rz [rad times lever]) in rows, strongest first, and
    their stiffnesses (6,): the right singular vectors and singular values of the scaled Jacobian.
    """

    names: tuple[str, ...]
    stiffness: dict[str, float]
    directions: Array
    stiffnesses: Array

    def __str__(self) -> str:
        lines = [f"  {name}  {self.stiffness[name]:12.1f}" for name in self.names]
        return "\n".join(["stiffness [N/mm], rotations at the lever:", *lines])


def sensitive_directions(
    model: ContactModel, pose: ArrayLike, *, lever_mm: float = LEVER_MM, loads: Sequence[str] | None = None
) -> SensitiveDirections:
    """Rank the pose parameters by the loads they change at a pose (6,) in contact.

    With S = D_loads⁻¹·(d loads/d pose)·D_pose, D = 1 for forces and translations, the lever for torques and 1/lever
    for rotations. loads: which (see `ContactModel`), the model's load_names if left out. Parameters that the scene ties
    follow; those that it locks or ties are ranked last, with a stiffness of zero. Raises ValueError for a bad pose,
    lever or load, and out of contact, where no load changes.
    """
    check_above_zero(lever_mm=lever_mm)
    model = model if loads is None else with_loads(model, loads)
    poses = as_poses(np.atleast_2d(np.asarray(pose, dtype=float)))
    if len(poses) != 1:
        raise ValueError(f"got {len(poses)} poses, expected one: tx ty tz [mm] rx ry rz [rad]")
    of_load = newton_scales(model.load_names, lever_mm)
    of_pose = np.array([1.0] * 3 + [lever_mm] * 3)
    scaled = model.scene.pose_space.pull_back(model.jacobian(poses)[1][0]) / of_load[:, None] / of_pose
    if not np.isfinite(scaled).all():
        raise ValueError("the model's loads are not finite at this pose, expected a pose at which it gives numbers")
    if not scaled.any():
        raise ValueError("no load changes at this pose, expected a pose in contact")
    columns = np.linalg.norm(scaled, axis=0)
    _, values, directions = np.linalg.svd(np.vstack([scaled, np.zeros((6, 6))]), full_matrices=False)
    ranked = tuple(POSE_NAMES[k] for k in np.argsort(-columns, kind="stable"))
    return SensitiveDirections(ranked, dict(zip(POSE_NAMES, columns.tolist(), strict=True)), directions, values)
