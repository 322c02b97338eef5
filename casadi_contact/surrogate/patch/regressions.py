"""Training targets of the patch surrogate (docs/method.md).

Which samples take part: training and validation rows (the test rows are held back [EF15 §3.3]); all of them for a root
load, those in contact (N > 0) for a ratio, which has no meaning where there is no load.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, Array, local_poses
from casadi_contact.core.quantities import FORCE, of_kind
from casadi_contact.networks.network import Regression
from casadi_contact.samples.samples import Samples, finite, fitted_rows, nonempty
from casadi_contact.samples.table import check_no_pull
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.patch.networks import patch_components, ratios_name, root_name

_GAP_WEIGHT = 0.02  # of residuals far out of contact (`root_weight`)
_ON_SPACE = 1e-9  # [mm, rad]: rounding


def root_target(normal: Array, gap_mm: Array, scene: Scene) -> Array:
    """√(N/N0) in contact, -gap_slope·gap outside; zero where the surfaces touch too lightly to give a load."""
    outside = -scene.gap_slope * np.maximum(np.nan_to_num(gap_mm), 0.0)
    return np.where(normal > 0.0, np.sqrt(np.maximum(normal, 0.0) / scene.reference_load), outside)


def root_weight(target: Array, scene: Scene) -> Array:
    """Residual weight in newtons per unit of s.

    In contact dN/ds = 2·N0·max(s, s_b), with s_b the root of the boundary load, so that a light touch still counts.
    Outside 2·N0·s_b·max(_GAP_WEIGHT, min(1, s_b/|s|)): continuous at liftoff, where an error would be a false
    contact, and small (2 %) where only the direction back into contact matters: there a load that is predicted counts
    by itself (`Regression.false_load`).
    """
    floor = np.sqrt(scene.boundary_load / scene.reference_load)
    fade = floor / np.maximum(np.abs(target), floor)
    relative = np.where(target > 0.0, np.maximum(target, floor) / floor, np.maximum(_GAP_WEIGHT, fade))
    return 2.0 * scene.reference_load * floor * relative


def patch_regressions(samples: Samples, *, deeper: bool = True) -> list[Regression]:
    """Regressions for the root load of every patch, which validity goes by, and for the ratios that the
    scene's loads need. deeper: with rows that go on beyond the largest load.

    Root: target `root_target`, weight `root_weight`, out of contact N0 as its false load. Ratios: target W_k/N, weight
    N/(τ_k·√m) for the m outputs of a network, so that the root mean square of its residuals is 1 where the error of
    every component is its tolerance τ_k (`_tolerances`). Raises ValueError for NaN, for a patch that pulls, for an
    unknown gap out of contact, or without samples.
    """
    scene = samples.scene
    check_no_pull(samples, "samples")
    rows, validation = fitted_rows(samples)
    poses = finite("poses", samples.poses)[rows]
    _check_space(poses, scene)
    all_wrenches = finite("wrenches", samples.wrenches)[rows]
    gaps_mm, domain = samples.gaps[rows], samples.domain[rows]
    components, tolerances = patch_components(scene), _tolerances(scene, all_wrenches)
    regressions = []
    for p, patch in enumerate(scene.patches):
        wrench, gap_mm = all_wrenches[:, p], gaps_mm[:, p]
        normal = patch.normal.of(wrench)
        contact = normal > 0.0
        lost = ~contact & ~np.isfinite(gap_mm)
        if lost.any():
            where = f"of patch {patch.name!r} is unknown at row {np.flatnonzero(rows)[np.argmax(lost)]}, out of contact"
            raise ValueError(f"samples: gap {where}; expected a contact model with gaps, or the two_stage structure")
        root_tolerance, ratio_tolerances = tolerances[p]
        inputs = local_poses(poses, patch.anchor_mm)[:, list(scene.pose_space.free)]
        target = root_target(normal, gap_mm, scene)
        false_load = np.where(contact, 0.0, scene.reference_load)
        columns = (inputs, target, root_weight(target, scene), validation)
        root = Regression(root_name(patch.name), *columns, root_tolerance, false_load, domain)
        regressions.append(_with_deeper(root, patch.normal.direction, scene) if deeper else root)
        if not components[patch.name]:
            continue
        used = [WRENCH_NAMES.index(name) for name in components[patch.name]]
        targets = wrench[contact][:, used] / normal[contact, None]
        per_newton = 1.0 / (np.array([ratio_tolerances[k] for k in used]) * np.sqrt(len(used)))
        weights = normal[contact, None] * per_newton
        if len(used) == 1:
            targets, weights = targets[:, 0], weights[:, 0]
        regressions.append(
            Regression(
                ratios_name(patch.name),
                inputs[contact],
                targets,
                weights,
                validation[contact],
                tolerance=1.0,
                domain=domain[contact],
            )
        )
    return regressions


def _with_deeper(root: Regression, direction: Array | None, scene: Scene) -> Regression:
    """The regression of a root load, and every fourth of its training rows in contact pressed on, by gap_slope per mm.

    The added root loads lie above 1.2 of the largest sampled one, as far as others lie below zero. Samples end at the
    largest load of the plan; a network that turned down beyond would have two poses for each load, and validity, which
    sees the depth in the root loads alone, could not tell them apart. These rows weigh as little as those far out of
    contact. None are added where N has no direction, or the pose is locked along it.
    """
    free = list(scene.pose_space.free)
    pressed = np.flatnonzero((root.targets > 0.0) & ~root.validation)[::4]
    if direction is None or not np.isin(np.flatnonzero(direction), free).all() or not len(pressed):
        return root
    largest = root.targets.max()
    target = 1.2 * largest + max(largest, -root.targets.min()) * np.random.default_rng(0).random(len(pressed))
    added = root.of_rows(pressed)
    deeper_mm = (target - added.targets) / scene.gap_slope
    inputs = added.inputs + deeper_mm[:, None] * np.eye(6)[:3][:, free].T.dot(direction)
    weights = np.full(len(pressed), _GAP_WEIGHT * root_weight(np.zeros(1), scene))
    added = replace(added, inputs=inputs, targets=target, weights=weights)
    names = ("inputs", "targets", "weights", "validation", "false_load", "domain")
    joined: dict[str, Any] = {name: np.concatenate([getattr(root, name), getattr(added, name)]) for name in names}
    return replace(root, **joined)


def _check_space(poses: Array, scene: Scene) -> None:
    """Raises ValueError for samples off the locked and tied pose parameters, which no network would see."""
    off = np.abs(poses - scene.pose_space.project(poses)).max(axis=0)
    if off.max() > _ON_SPACE:
        worst = int(np.argmax(off))
        wrong = f"{POSE_NAMES[worst]} is off its locked or tied value by up to {off[worst]:.3g}"
        raise ValueError(f"samples: {wrong}, expected poses that keep to the scene's [pose]")


def _tolerances(scene: Scene, wrenches: Array) -> list[tuple[float, dict[int, float]]]:
    """Of every patch, the tolerances of its root [N] and of each ratio [N or N·mm] by index; wrenches (n, patches, 6)
    tell levers. Sides of a symmetric joint share networks, and so the closer tolerances. ValueError: no contact."""
    selection = scene.selection(scene.load_names)
    found = [_patch_tolerances(scene, selection, p, _levers(scene, wrenches, p)) for p in range(len(scene.patches))]
    if not scene.symmetric:
        return found
    root = min(root for root, _ in found)
    return [(root, {k: min(other[k] for _, other in found if k in other) for k in ratios}) for _, ratios in found]


def _levers(scene: Scene, wrenches: Array, p: int) -> dict[int, float]:
    """ρ (root mean square, weighted by N) of each component that a load needs of patch p, by its index."""
    patch, wrench = scene.patches[p], wrenches[:, p]
    normal = patch.normal.of(wrench)
    contact = normal > 0.0
    nonempty(f"patch {patch.name!r} in contact", contact)
    used = (WRENCH_NAMES.index(name) for name in patch_components(scene)[patch.name])
    size = np.mean(normal[contact] ** 2)
    return {k: float(np.sqrt(np.mean(wrench[contact, k] ** 2) / size)) for k in used}


def _patch_tolerances(
    scene: Scene, selection: Array, p: int, lever: Mapping[int, float]
) -> tuple[float, dict[int, float]]:
    """Tolerance of the root [N] and of each ratio [N or N·mm] of patch p.

    A load summed over m patches has 2m errors that add in quadrature, one of N·δρ and one of ρ·δN each, so that each
    may be τ/√(2m). Through the lever ρ that also limits δN; a load that is N itself limits it directly; a root that no
    load needs, the least tolerance of a force or the boundary load.
    """
    root = float(np.inf)
    ratios: dict[int, float] = {}
    for row, name in enumerate(scene.load_names):
        share = scene.tolerances[name] / np.sqrt(2.0 * selection[row].any(axis=1).sum())
        for k in map(int, np.flatnonzero(selection[row, p])):
            if k in lever:
                ratios[k] = min(share, ratios.get(k, np.inf))
                if lever[k] > 0.0:
                    root = min(root, share / lever[k])
            else:
                root = min(root, scene.tolerances[name] / np.sqrt(selection[row].any(axis=1).sum()))
    if not np.isfinite(root):  # its mirror image may be the side that is asked for
        root = min([scene.boundary_load, *(scene.tolerances[name] for name in of_kind(scene.load_names, FORCE))])
    return float(root), {k: float(value) for k, value in ratios.items()}
