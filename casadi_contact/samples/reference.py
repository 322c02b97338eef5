"""The reference motion: cycles of pose parameters and loads that the envelopes are drawn around [EF15 §3.3]."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from casadi_contact.contact.approach import advance_to_contact, rotate_about_anchors
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.model_checks import check_contact_model, sensitive_directions
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_NAMES, Array, Progress, pose_index
from casadi_contact.core.quantities import quantity
from casadi_contact.samples.domains import Envelopes
from casadi_contact.samples.settings import SamplePoint, SamplingSettings
from casadi_contact.scenes.cycle import Cycle, driving_loads


@dataclass(frozen=True)
class ReferenceReport:
    """Convergence of each frame (cycles, frames), and why each failed.

    Others are interpolated between neighbours. assumed: widths of inputs alike in all cycles (see `domains`).
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
            raise ValueError(f"curves {self.curves.shape} and poses {self.poses.shape}, expected {expected}, (..., 6)")

    @property
    def envelopes(self) -> Envelopes:
        """The reference envelopes of the inputs."""
        return Envelopes.over(self.point.inputs, self.curves)

    def starts(self, inputs: Array) -> Array:
        """Start poses (n, 6) for static analyses of inputs (n, inputs).

        The free parameters are those of the nearest reference pose, inputs in shares of their ranges.
        """
        columns = [self.point.inputs.index(name) for name in self.point.pose_inputs]
        curves = self.curves.reshape(-1, self.curves.shape[2])[:, columns]
        scale = np.ptp(curves, axis=0)
        scale[scale == 0.0] = 1.0
        _, nearest = cKDTree(curves / scale).query(inputs[:, columns] / scale)
        starts = self.poses.reshape(-1, 6)[nearest]
        starts[:, [pose_index(name) for name in self.point.pose_inputs]] = inputs[:, columns]
        return starts


def reference_motion(
    model: ContactModel, cycles: Sequence[Cycle], settings: SamplingSettings, progress: Progress | None = None
) -> tuple[ReferenceMotion, ReferenceReport]:
    """Estimate the poses of the cycles and pick the sample-point inputs: pose parameters from the estimated poses,
    loads from the measured ones. progress: as in `reference_poses`."""
    point = settings.sample_point(model.scene)
    curves = _on_frames(cycles, settings.frames)
    if not point.free:
        return _along_poses(model, point, curves)
    if missing := [name for name in point.load_inputs if name not in curves]:
        got = f"the cycles hold no load {', '.join(missing)}, only {', '.join(cycles[0].targets())}"
        raise ValueError(f"{got}: add its column to the files, or choose other sampling.inputs")
    loads = Envelopes.over(point.load_inputs, np.stack([curves[name] for name in point.load_inputs], axis=-1))
    if zero := [name for name, width in _assumed(loads, settings).items() if not width]:
        raise ValueError(f"{', '.join(zero)} without any load in all cycles: give it a sampling.fixed_offsets entry")
    poses, report = reference_poses(
        model, cycles, frames=settings.frames, tolerance_n=settings.settle_tolerance_n, progress=progress
    )
    columns = [poses[..., pose_index(name)] if name in POSE_NAMES else curves[name] for name in point.inputs]
    motion = ReferenceMotion(point, np.stack(columns, axis=-1), poses)
    return motion, replace(report, assumed=_assumed(motion.envelopes, settings))


def _along_poses(
    model: ContactModel, point: SamplePoint, curves: Mapping[str, Array]
) -> tuple[ReferenceMotion, ReferenceReport]:
    """The motion of known poses, all cycles in a row as one, with the model's normal loads there."""
    poses = model.scene.pose_space.project(np.stack([curves[name].ravel() for name in POSE_NAMES], axis=1))
    roots, _ = model.root_loads(poses)
    if not (roots > 0.0).any():
        raise ValueError(f"{model.scene.name}: the bodies touch in none of {len(poses)} poses of the cycles")
    signs = [normal.sign for normal in model.scene.normal_loads]
    loads = signs * (model.scene.reference_load * np.maximum(roots, 0.0) ** 2)
    inputs = np.column_stack([poses[:, [pose_index(name) for name in point.pose_inputs]], loads])
    settled = np.ones((1, len(poses)), dtype=bool)
    report = ReferenceReport(("known poses",), settled, np.full(settled.shape, "", dtype=object))
    return ReferenceMotion(point, inputs[None], poses[None]), report


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
    start again: interpolated between converged frames; from the start pose rotated about the patches' anchors; and
    from the nearest converged frame, with a trust region.

    Locked and tied pose parameters are the scene's, whatever a cycle measures. progress(done, all): frames settled.

    Returns poses (cycles, frames, 6) and a report; frames that do not converge are interpolated. Raises ValueError for
    no or unlike cycles, as `check_contact_model` (without a start pose), and for a cycle of which no frame converges
    (every_cycle: False leaves its frames where they ended).
    """
    curves, scene = _on_frames(cycles, frames), model.scene
    given, targets = list(cycles[0].pose), list(cycles[0].targets())
    free = tuple(name for name in scene.pose_space.free_names if name not in given)
    loads, columns = {name: curves[name].ravel() for name in targets}, [pose_index(name) for name in given]
    begin = np.asarray(scene.start_pose if start is None else start)
    starts = np.tile(begin, (len(cycles) * frames, 1))
    starts[:, columns] = np.stack([curves[name].ravel() for name in given], axis=1)
    if start is None:
        starts = advance_to_contact(model, starts, loads)
        if model.has_wrenches:
            check_contact_model(model, starts, loads, tolerance_n)
    shape = (len(cycles), frames)

    def press(starts: Array, trust_region: bool) -> tuple[Array, np.ndarray, np.ndarray]:
        """Poses (cycles, frames, 6) settled, and which converged, and why the others did not (cycles, frames)."""
        options: dict[str, Any] = {"tolerance": tolerance_n, "trust_region": trust_region, "progress": progress}
        poses, report = settle(model, starts.reshape(-1, 6), free, loads, **options)
        return poses.reshape(*shape, 6), report.converged.reshape(shape), report.reason.reshape(shape)

    def turned(poses: Array, converged: np.ndarray) -> Array:
        lost = ~converged
        poses[lost] = rotate_about_anchors(model, begin, poses[lost])
        return poses

    poses, converged, reason = press(starts, trust_region=False)
    for anew, trust_region in ((_between, False), (turned, False), (_nearest, True)):
        if converged.all() or (len(loads) > len(free) and not converged.any()):
            break
        starts = anew(poses.copy(), converged)
        starts[..., columns] = poses[..., columns]
        poses, converged, reason = press(starts, trust_region)
    if every_cycle and len(lost := np.flatnonzero(~converged.any(axis=1))):
        raise ValueError(
            f"cycle {cycles[lost[0]].name}: in no frame do {len(free)} free pose parameters ({', '.join(free)}) carry "
            f"{len(loads)} loads ({', '.join(loads)}): {reason[lost[0], 0]}. Mend the loads, or free more in [pose]"
        )
    poses = _between(poses, converged)
    return poses, ReferenceReport(tuple(cycle.name for cycle in cycles), converged, reason)


def found_sensitive_pose(model: ContactModel, cycles: Sequence[Cycle]) -> tuple[str, ...]:
    """The most sensitive pose parameters, one for each sensitive load, at the first cycle's most loaded pose."""
    poses, _ = reference_poses(model, cycles[:1], frames=21)
    roots, _ = model.root_loads(poses[0])
    reference = poses[0][int(np.argmax((np.maximum(roots, 0.0) ** 2).sum(axis=1)))]
    found = sensitive_directions(model, reference, loads=driving_loads(model.scene))
    strongest = found.names[: len(model.scene.sensitive_loads)]
    return tuple(name for name in POSE_NAMES if name in strongest)


def _on_frames(cycles: Sequence[Cycle], frames: int) -> dict[str, Array]:
    """Targets and measured pose parameters (cycles, frames) by name; ValueError for no cycles, or unlike ones."""
    if not cycles:
        raise ValueError("no cycles given, expected at least one for the reference motion")
    curves: dict[str, list[Array]] = {name: [] for name in {**cycles[0].pose, **cycles[0].targets()}}
    for cycle in cycles:
        known = {**cycle.pose, **cycle.targets()}
        if set(known) != set(curves):
            raise ValueError(f"cycle {cycle.name} has {', '.join(known)}, expected {', '.join(curves)} as the first")
        time_s = np.asarray(cycle.time_s, dtype=float)
        at = np.linspace(time_s[0], time_s[-1], frames)
        for name, curve in known.items():
            curves[name].append(np.interp(at, time_s, curve))
    return {name: np.array(of_cycles) for name, of_cycles in curves.items()}


def _between(poses: Array, converged: np.ndarray) -> Array:
    """Poses (cycles, frames, 6) that did not converge replaced by what lies between those of their cycle that did."""
    frames = np.arange(poses.shape[1])
    for cycle, known in zip(poses, converged, strict=True):
        for column in range(6 if known.any() else 0):
            cycle[~known, column] = np.interp(frames[~known], frames[known], cycle[known, column])
    return poses


def _nearest(poses: Array, converged: np.ndarray) -> Array:
    """Poses (cycles, frames, 6) that did not converge replaced by the nearest of their cycle that did."""
    for cycle, known in zip(poses, converged, strict=True):
        solved, lost = np.flatnonzero(known), np.flatnonzero(~known)
        if len(solved):
            cycle[lost] = cycle[solved[np.abs(lost[:, None] - solved).argmin(axis=1)]]
    return poses
