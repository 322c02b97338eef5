"""Out-of-contact poses from poses at the contact boundary: one patch lifted off (D4), all patches (D5) [EF15 §3.3].

The paper lifts all patches alike. Networks that never saw one patch just off and another farther out claimed thousands
of newtons there, in a region as wide as a joint's whole reach: the plan `reach` lifts each by an amount of its own.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.contact.model import ContactModel, with_loads
from casadi_contact.contact.settle import NOT_FINITE, settle
from casadi_contact.core.conventions import Array, pose_index
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.scene import Scene

_NEWTON_STEPS = 5
_LEAST_DETERMINANT = 1e-9  # of the root loads' slopes: less, and no pose parameters lift the patches apart


def check_liftable(scene: Scene) -> None:
    """Raises ValueError unless two pose parameters are sensitive and the patches are pressed along directions."""
    if len(scene.sensitive_pose) != 2 or any(normal.component is None for normal in scene.normal_loads):
        raise ValueError(
            f"scene {scene.name}: D4 lifts one patch of several by the second of two sensitive pose parameters, each "
            "patch pressed along a direction; expected these, or sampling.counts.D4 = 0"
        )


def lift_one(
    model: ContactModel,
    poses: Array,
    lifted: int,
    free: tuple[str, ...],
    held: Mapping[str, Array],
    settings: SamplingSettings,
) -> tuple[Array, np.ndarray]:
    """Lift one patch off in equal increments of the second sensitive pose parameter (knee: r_x); other loads stay.

    poses (n, 6): the patch `lifted` at the contact boundary, the loads held (n,) elsewhere. It changes by k/steps·Δ
    for k = 1..steps; the other free parameters (knee: t_y) are settled anew for each k so that the held loads stay.
    Δ is such that the patch is `liftoff_mm` away in the end: predicted from the slopes of its root load at the boundary
    (by r_x, against by t_y), then corrected once by the gap that the prediction gives; the paper asks for
    "approximately", and a model without gaps keeps the prediction. The scene passes `check_liftable`.

    Returns the poses (n, steps, 6) and why each failed (n, steps), "" where it did not.
    """
    (rise, turn), space, steps = model.scene.sensitive_pose, model.scene.pose_space, settings.liftoff_steps
    tilt, rest = pose_index(turn), tuple(name for name in free if name != turn)
    others = [pose_index(name) for name in rest]
    s, ds = model.root_loads(poses)
    ds = space.pull_back(ds)
    # Along the held loads: dload/dothers·dothers/dtilt + dload/dtilt = 0.
    by_pose = np.stack([_slope(model, name, poses, ds) for name in held], axis=1)
    along = np.asarray(-np.linalg.solve(by_pose[:, :, others], by_pose[:, :, tilt, None])[..., 0])
    slope = ds[:, lifted, tilt] + np.einsum("no,no->n", ds[:, lifted][:, others], along)
    per_mm = np.abs(ds[:, lifted, pose_index(rise)])
    total: Array = -(per_mm * settings.liftoff_mm + np.maximum(s[:, lifted], 0.0)) / slope
    known = np.isfinite(total) & np.isfinite(along).all(axis=1)
    total, along = np.where(known, total, 0.0), np.where(known[:, None], along, 0.0)

    def tilted(change: Array, each: int = 1) -> tuple[Array, np.ndarray]:
        """Poses (n·each, 6) tilted by change (n·each,) and settled under the held loads, and why each failed."""
        start = np.repeat(poses, each, axis=0)
        start[:, tilt] += change
        start[:, others] += np.repeat(along, each, axis=0) * change[:, None]
        loads = {name: np.repeat(load, each) for name, load in held.items()}
        settled, report = settle(model, start, rest, loads, tolerance=settings.settle_tolerance_n)
        return settled, report.reason

    if model.has_gaps:
        before = model.gaps(poses)[:, lifted]
        reached = model.gaps(tilted(total)[0])[:, lifted] - before
        opened = reached > 0.0
        total[opened] *= (settings.liftoff_mm - before[opened]) / reached[opened]
    lifted_poses, reason = tilted(np.outer(total, np.arange(1, steps + 1) / steps).ravel(), steps)
    reasons = np.where(known[:, None], reason.reshape(-1, steps), NOT_FINITE)
    return lifted_poses.reshape(-1, steps, 6), reasons


def _slope(model: ContactModel, name: str, poses: Array, root_slopes: Array) -> Array:
    """Derivative (n, 6) by the pose of a named load, or of its root load where it is a patch's normal load."""
    for p, normal in enumerate(model.scene.normal_loads):
        if normal.loads == (name,):
            return root_slopes[:, p]
    model = with_loads(model, (name,))
    return model.scene.pose_space.pull_back(model.jacobian(poses)[1][:, model.load_names.index(name)])


def lift_all(model: ContactModel, poses: Array, settings: SamplingSettings) -> Array:
    """Move poses at the contact boundary apart in equal steps to `liftoff_mm`, along the sensitive translations.

    Apart is where the sum of the root loads falls: straight up for the knee, whose one sensitive translation is t_y;
    away from the contact for a hip. Returns poses (n, steps, 6), NaN where the model gives no finite loads; raises
    ValueError for a scene without a sensitive translation.
    """
    columns = [column for column in map(pose_index, model.scene.sensitive_pose) if column < 3]
    if not columns:
        raise ValueError(f"scene {model.scene.name} has no sensitive translation, expected one to lift along")
    space, ds = model.scene.pose_space, model.root_loads(poses)[1]
    apart = -space.pull_back(ds)[..., columns].sum(axis=1)
    apart /= np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-300)
    raised = np.repeat(poses[:, None, :], settings.liftoff_steps, axis=1)
    share = np.arange(1, settings.liftoff_steps + 1) / settings.liftoff_steps
    raised[..., columns] += apart[:, None, :] * (settings.liftoff_mm * share)[:, None]
    return space.project(raised)


def lift_each(model: ContactModel, poses: Array, gaps_mm: Array) -> Array:
    """Move poses (n, 6) at the contact boundary along the sensitive pose parameters until each patch is gaps_mm (n, P)
    away, as many as there are of both.

    Newton's method on the root loads, -c·gap out of contact. Returns poses (n, 6), NaN where the model gives no finite
    loads or its slopes no way there.
    """
    scene, columns = model.scene, [pose_index(name) for name in model.scene.sensitive_pose]
    found, wanted = poses.copy(), -scene.gap_slope * gaps_mm
    for _ in range(_NEWTON_STEPS):
        s, slope = model.root_loads(found)
        by_pose = scene.pose_space.pull_back(slope)[..., columns]
        finite = np.asarray(np.isfinite(by_pose).all(axis=(1, 2)) & np.isfinite(s).all(axis=1))
        apart = np.abs(np.linalg.det(np.where(finite[:, None, None], by_pose, 0.0))) > _LEAST_DETERMINANT
        found[~apart] = np.nan
        step = np.linalg.solve(by_pose[apart], (wanted - s)[apart][..., None])[..., 0]
        found[np.ix_(np.flatnonzero(apart), np.array(columns))] += step
    return scene.pose_space.project(found)
