"""The reference motion: cycles of pose parameters and loads that the envelopes are drawn around [EF15 §3.3]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from casadi_contact.contact.approach import advance_to_contact, rotate_about_anchors
from casadi_contact.contact.continuity import Motion
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.model_checks import check_contact_model, sensitive_directions
from casadi_contact.contact.settle import SettleReport, settle
from casadi_contact.core.conventions import POSE_NAMES, Array, Progress, pose_index
from casadi_contact.core.quantities import quantity
from casadi_contact.samples.domains import Envelopes
from casadi_contact.samples.settings import SamplePoint, SamplingSettings
from casadi_contact.scenes.joint_cycle import JointCycle, driving_loads
from casadi_contact.scenes.load_cycle import LoadCycle
from casadi_contact.scenes.pose_space import PoseSpace

Cycle = LoadCycle | JointCycle


@dataclass(frozen=True)
class ReferenceReport:
    """Convergence of each frame (cycles, frames), and why each failed.

    Frames that did not converge are interpolated between neighbours that did. assumed: assumed widths of inputs with
    the same curve in all cycles (see `domains`).
    """

    names: tuple[str, ...]
    converged: np.ndarray
    reason: np.ndarray
    assumed: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = [f"{int(self.converged.sum())} of {self.converged.size} reference frames converged"]
        for name, converged, reason in zip(self.names, self.converged, self.reason, strict=True):
            if not converged.all():
                frames = ", ".join(map(str, np.flatnonzero(~converged)))
                lines.append(f"{name}: frames {frames} interpolated ({reason[~converged][0]})")
        if self.assumed:
            by = ", ".join(f"{name} {width:.2g} {quantity(name).unit}" for name, width in self.assumed.items())
            lines.append(f"the same in all cycles, taken to differ by {by}: sampling.fixed_offsets says otherwise")
        return "\n".join(lines)


@dataclass(frozen=True)
class ReferenceMotion:
    """curves (cycles, frames, inputs) of the sample-point inputs, and the poses (cycles, frames, 6) they belong to."""

    point: SamplePoint
    curves: Array
    poses: Array

    def __post_init__(self) -> None:
        expected = (*self.poses.shape[:2], len(self.point.inputs))
        if self.poses.ndim != 3 or self.poses.shape[2] != 6 or self.curves.shape != expected:
            raise ValueError(
                f"reference motion has curves {self.curves.shape} and poses {self.poses.shape}, "
                f"expected (cycles, frames, {len(self.point.inputs)}) and (cycles, frames, 6)"
            )

    @property
    def envelopes(self) -> Envelopes:
        """The reference envelopes of the inputs."""
        return Envelopes.over(self.point.inputs, self.curves)

    def starts(self, inputs: Array, space: PoseSpace | None = None) -> Array:
        """Start poses (n, 6) for static analyses of inputs (n, inputs).

        The free parameters are those of the reference pose nearest in the pose inputs, each measured in its range
        over the reference motion; locked and tied ones are as the space says.
        """
        columns = self.point.columns(self.point.pose_inputs)
        curves = self.curves.reshape(-1, self.curves.shape[2])[:, columns]
        scale = np.ptp(curves, axis=0)
        scale[scale == 0.0] = 1.0
        _, nearest = cKDTree(curves / scale).query(inputs[:, columns] / scale)
        starts = self.poses.reshape(-1, 6)[nearest]
        starts[:, [pose_index(name) for name in self.point.pose_inputs]] = inputs[:, columns]
        return starts if space is None else space.project(starts)


def reference_motion(
    model: ContactModel, cycles: Sequence[Cycle], settings: SamplingSettings, progress: Progress | None = None
) -> tuple[ReferenceMotion, ReferenceReport]:
    """Estimate the poses of the cycles and pick the sample-point inputs: pose parameters from the estimated poses,
    loads from the measured ones. progress: as in `reference_poses`.

    Raises ValueError, before it seeks poses, for an input that is neither a pose parameter nor a load of the cycles,
    and for a load that is zero throughout; see `reference_poses`.
    """
    point = settings.sample_point(model.scene)
    _check_alike(cycles)
    targets = [_on_frames(cycle, settings.frames) for cycle in cycles]
    if missing := [name for name in point.load_inputs if name not in targets[0]]:
        raise ValueError(
            f"the cycles hold no load {', '.join(missing)}, only {', '.join(cycles[0].targets())}: give its column in "
            "the cycle files, or choose other sampling.inputs in the scene"
        )
    loads = Envelopes.over(point.load_inputs, [np.stack([t[n] for n in point.load_inputs], axis=1) for t in targets])
    if zero := [name for name, width in _assumed(loads, settings).items() if not width]:
        raise ValueError(
            f"{', '.join(zero)} without any load in all cycles, expected a range to sample: "
            f"give the scene's sampling.fixed_offsets an entry for {', '.join(zero)}"
        )
    poses, report = reference_poses(
        model, cycles, frames=settings.frames, tolerance_n=settings.settle_tolerance_n, progress=progress
    )
    columns = [
        poses[..., pose_index(name)] if name in POSE_NAMES else np.stack([t[name] for t in targets])
        for name in point.inputs
    ]
    motion = ReferenceMotion(point, np.stack(columns, axis=-1), poses)
    return motion, replace(report, assumed=_assumed(motion.envelopes, settings))


def _assumed(envelopes: Envelopes, settings: SamplingSettings) -> dict[str, float]:
    """The widths that envelopes assume of inputs, but for those with an offset or a range of their own."""
    own = {*settings.fixed_offsets, *settings.reach}
    return {name: width for name, width in envelopes.assumed_widths.items() if name not in own}


def reference_poses(
    model: ContactModel,
    cycles: Sequence[Cycle],
    *,
    frames: int = 101,
    start: Array | None = None,
    tolerance_n: float = 1e-3,
    every_cycle: bool = True,
    progress: Progress | None = None,
) -> tuple[Array, ReferenceReport]:
    """Pose estimation of each cycle: the pose parameters that are not measured carry the measured loads [EF15 §3.3].

    Cycles are resampled to `frames` frames on the percentage of the cycle. All frames are settled at once, starting in
    first contact from the scene's start pose (or from `start` (6,), needed for a model without gaps). Frames that fail
    start again: interpolated between converged frames; from the start pose rotated about the patches' anchors;
    interpolated again; and from the nearest converged frame with a trust region. Frames that converged to another
    equilibrium than their neighbours are followed from these (`Motion.without_leaps`).

    Locked and tied pose parameters are the scene's, whatever a cycle measures. progress(done, all): frames settled.

    Returns poses (cycles, frames, 6) and a report; frames that do not converge are interpolated. Raises ValueError for
    no or unlike cycles, as `check_contact_model` (without a start pose), and for a cycle of which no frame converges
    (every_cycle: False leaves its frames where they ended).
    """
    _check_alike(cycles)
    scene, measured = model.scene, tuple(cycles[0].measured_pose())
    free = tuple(name for name in scene.pose_space.free_names if name not in measured)
    targets = [_on_frames(cycle, frames) for cycle in cycles]
    wanted = {name: np.concatenate([t[name] for t in targets]) for name in cycles[0].targets()}
    begin = np.asarray(scene.start_pose if start is None else start)
    poses = np.tile(begin, (len(cycles) * frames, 1))
    for name in measured:
        poses[:, pose_index(name)] = np.concatenate([t[name] for t in targets])
    poses = scene.pose_space.project(poses)
    if start is None:
        poses = advance_to_contact(model, poses, wanted)
        if model.has_wrenches:
            check_contact_model(model, poses, wanted, tolerance_n)
    press = partial(settle, model, free=free, targets=wanted, tolerance=tolerance_n, progress=progress)
    poses, settled = press(poses, trust_region=False)
    shape, given = (len(cycles), frames, 6), [pose_index(name) for name in measured]
    report = _report(cycles, settled)
    if every_cycle and len(wanted) > len(free) and not report.converged.any():  # not sought for minutes in vain
        raise ValueError(
            f"cycle {cycles[0].name}: {len(wanted)} loads ({', '.join(wanted)}) are wanted of {len(free)} free pose "
            f"parameters ({', '.join(free)}), and no frame has such a pose: lock or tie less in the scene's [pose], "
            "or give cycles of fewer loads"
        )
    for anew in (_interpolate, partial(_turned, model, begin), _interpolate, _nearest):
        if report.converged.all():
            break
        starts = scene.pose_space.project(anew(poses.reshape(shape).copy(), report).reshape(-1, 6))
        starts[:, given] = poses[:, given]
        poses, settled = press(starts, trust_region=anew is _nearest)
        report = _report(cycles, settled)
    if every_cycle and len(lost := np.flatnonzero(~report.converged.any(axis=1))):
        name, reason = report.names[lost[0]], report.reason[lost[0], 0]
        raise ValueError(f"cycle {name}: no frame has a pose that carries its loads ({reason})")
    poses = _interpolate(poses.reshape(shape), report)
    for k, (cycle, converged) in enumerate(zip(targets, report.converged, strict=True)):
        loads = {name: cycle[name] for name in wanted}
        pressed = np.any([curve != 0.0 for curve in loads.values()], axis=0)  # else any pose out of contact would do
        motion = Motion(model, free, loads, np.full(frames, tolerance_n), np.asarray(pressed))
        poses[k] = motion.without_leaps(poses[k], converged & motion.usable)
    return poses, report


def found_sensitive_pose(model: ContactModel, cycles: Sequence[Cycle]) -> tuple[str, ...]:
    """The most sensitive pose parameters, one for each sensitive load of the scene, in pose order.

    The reference pose is the first cycle's most loaded one. Raises ValueError like `reference_poses`.
    """
    poses, _ = reference_poses(model, cycles[:1], frames=21)
    roots, _ = model.root_loads(poses[0])
    reference = poses[0][int(np.argmax((np.maximum(roots, 0.0) ** 2).sum(axis=1)))]
    found = sensitive_directions(model, reference, loads=driving_loads(model.scene))
    strongest = found.names[: len(model.scene.sensitive_loads)]
    return tuple(name for name in POSE_NAMES if name in strongest)


def _check_alike(cycles: Sequence[Cycle]) -> None:
    """ValueError for no cycles, and for such that measure different pose parameters or loads."""
    if not cycles:
        raise ValueError("no cycles given, expected at least one for the reference motion")
    held = [(tuple(cycle.measured_pose()), sorted(cycle.targets())) for cycle in cycles]
    for cycle, (measured, loads) in zip(cycles, held, strict=True):
        if (measured, loads) != held[0]:
            raise ValueError(
                f"cycle {cycle.name} has {', '.join((*measured, *loads))} and cycle {cycles[0].name} "
                f"{', '.join((*held[0][0], *held[0][1]))}, expected the same of all cycles"
            )


def _report(cycles: Sequence[Cycle], settled: SettleReport) -> ReferenceReport:
    converged, reason = (part.reshape(len(cycles), -1) for part in (settled.converged, settled.reason))
    return ReferenceReport(tuple(cycle.name for cycle in cycles), converged, reason)


def _on_frames(cycle: Cycle, frames: int) -> dict[str, Array]:
    """The cycle's targets and measured pose parameters, linearly interpolated on the percentage of the cycle."""
    time = np.asarray(cycle.time_s, dtype=float)
    percent = (time - time[0]) / (time[-1] - time[0])
    curves = {**cycle.measured_pose(), **cycle.targets()}
    return {name: np.interp(np.linspace(0.0, 1.0, frames), percent, curve) for name, curve in curves.items()}


def _nearest(poses: Array, report: ReferenceReport) -> Array:
    """The poses of frames that did not converge replaced by those of the nearest frame of the cycle that did."""
    for cycle, converged in zip(poses, report.converged, strict=True):
        solved, left = np.flatnonzero(converged), np.flatnonzero(~converged)
        if len(solved):
            cycle[left] = cycle[solved[np.abs(left[:, None] - solved).argmin(axis=1)]]
    return poses


def _turned(model: ContactModel, start: Array, poses: Array, report: ReferenceReport) -> Array:
    """The poses of frames that did not converge replaced by a start pose turned as they are, about the anchors."""
    poses[~report.converged] = rotate_about_anchors(model, start, poses[~report.converged])
    return poses


def _interpolate(poses: Array, report: ReferenceReport) -> Array:
    """The poses of frames that did not converge replaced by what lies between those of their cycle that did."""
    frames = np.arange(poses.shape[1])
    for cycle, converged in zip(poses, report.converged, strict=True):
        for column in range(6 if converged.any() else 0):
            cycle[~converged, column] = np.interp(frames[~converged], frames[converged], cycle[converged, column])
    return poses
