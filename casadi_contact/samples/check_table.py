"""Checks of samples from a table: unit, sign, origin, and rows that contradict each other."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.model import overlaps_without_load
from casadi_contact.core.conventions import Array, rotation
from casadi_contact.core.quantities import quantity, three_digits
from casadi_contact.samples.samples import Samples
from casadi_contact.scenes.normal_load import normal_forces


def check_table(
    samples: Samples,
    where: str,
    *,
    largest_angle_rad: float = 3.5,
    least_travel_mm: float = 0.05,
    least_force_share: float = 0.01,
    largest_lever_mm: float = 200.0,
) -> None:
    """Raise ValueError for samples in other units, with other signs, or about another origin.

    Angles are at most `largest_angle_rad`; some translation varies by `least_travel_mm` at least; the largest normal
    load is at least `least_force_share` of the scene's reference load; forces act within `largest_lever_mm` of the
    patch's anchor (median distance of the line of action, |T - p×F|/|F| with the anchor at p). Signs: `check_no_pull`,
    `check_gaps`, and for patches without a direction of pressing `_check_resistance`. where: the file's name.
    """
    scene, poses = samples.scene, samples.poses
    largest = np.abs(poses[:, 3:]).max(axis=0)
    if largest.max() > largest_angle_rad:
        name = ("rx", "ry", "rz")[int(largest.argmax())]
        raise ValueError(f"{where}: {name} reaches {largest.max():g}, expected radians: convert degrees")
    if (travel_mm := float(np.ptp(poses[:, :3], axis=0).max())) < least_travel_mm:
        raise ValueError(
            f"{where}: tx, ty and tz vary by {travel_mm:.2g} at most, expected mm and at least {least_travel_mm:g}: "
            "convert m to mm (and N·m to N·mm)"
        )
    normal = normal_forces([part.normal for part in scene.parts], samples.wrenches)
    force_n = float(np.abs(normal).max(initial=0.0))
    if 0.0 < force_n < least_force_share * scene.reference_load:
        raise ValueError(
            f"{where}: the largest normal load is {three_digits(force_n)} N, expected N and at least "
            f"{least_force_share:g} of reference_load = {scene.reference_load:g} N: convert kN to N"
        )
    check_no_pull(samples, where)
    check_gaps(samples, where)
    for p, part in enumerate(scene.parts):
        force, torque = samples.wrenches[:, p, :3], samples.wrenches[:, p, 3:]
        pressed = (force != 0.0).any(axis=1)
        if not pressed.any():
            continue
        anchor = poses[pressed, :3] + rotation(poses[pressed, 3:]) @ part.anchor_mm
        about_anchor = np.linalg.norm(torque[pressed] - np.cross(anchor, force[pressed]), axis=1)
        lever_mm = float(np.median(about_anchor / np.linalg.norm(force[pressed], axis=1)))
        if torque.any() and lever_mm > largest_lever_mm:
            raise ValueError(
                f"{where}: the force of {part.name} acts {lever_mm:.3g} mm from its anchor (median), expected torques "
                f"about the fixed body's origin, in N·mm, within {largest_lever_mm:g} mm: shift or convert them"
            )
        if part.normal.component is None:
            _check_resistance(poses[pressed, 3:], anchor, force[pressed], where, part.name)


def check_no_pull(samples: Samples, where: str, *, share: float = 0.01) -> None:
    """Raise ValueError, naming the worst row, where a part pulls by more than this share of the boundary load."""
    scene = samples.scene
    normal = normal_forces([part.normal for part in scene.parts], samples.wrenches)
    pulls = normal < -share * scene.boundary_load
    if not pulls.any():
        return
    row, p = np.unravel_index(int(np.nanargmin(normal)), normal.shape)
    part = scene.parts[int(p)]
    raise ValueError(
        f"{where}, row {row + 1}: {part.name} pulls with {three_digits(-normal[row, p])} N, expected "
        f"{part.normal.component} {'>' if part.normal.sign > 0.0 else '<'}= 0 ({int(pulls.any(axis=1).sum())} such "
        "rows): give the loads on the fixed body (turn all signs), and 0 out of contact"
    )


def check_gaps(samples: Samples, where: str, *, rounding_mm: float = 1e-6) -> None:
    """Raise ValueError, naming the first row, where a part without load has a negative gap.

    Load and gap may change sign at slightly different poses: as far as `overlaps_without_load` allows, in half of the
    rows without load at most.
    """
    free = (samples.wrenches == 0.0).all(axis=2) & ~np.isnan(samples.gaps)
    negative = free & (samples.gaps < -rounding_mm)
    wrong = overlaps_without_load(samples.wrenches, samples.gaps)
    wrong |= negative & (2 * negative.sum(axis=0) > free.sum(axis=0))
    if wrong.any():
        row, part = np.argwhere(wrong)[0]
        raise ValueError(
            f"{where}, row {row + 1}: {samples.scene.parts[part].name} carries no load and has the gap "
            f"{samples.gaps[row, part]:g} mm, expected a gap above 0 out of contact ({int(wrong.any(axis=1).sum())} "
            "such rows): turn the signs of the gaps, or leave them out"
        )


def _check_resistance(
    angles: Array, anchor: Array, force: Array, where: str, name: str, *, least_rows: int = 40, least: float = -0.2
) -> None:
    """Raise ValueError for forces on the moving body in place of the fixed one.

    Contact resists: a force F on the fixed body grows as the moving body's anchor x moves along it. With the linear
    dependence on the rotations removed from both, the correlation Σ δx·δF / √(Σ|δx|² Σ|δF|²) is positive.
    """
    terms = np.column_stack([np.ones(len(angles)), angles])
    dx, df = (values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0] for values in (anchor, force))
    size = float(np.linalg.norm(dx) * np.linalg.norm(df))
    if len(angles) >= least_rows and size > 0.0 and (correlation := float(np.sum(dx * df)) / size) < least:
        raise ValueError(
            f"{where}: the force of {name} falls as the moving body moves along it (correlation {correlation:.2f}), "
            "expected the loads on the fixed body: turn the signs of all loads"
        )


def conflicting_rows(samples: Samples) -> str:
    """One line that counts the poses whose rows differ by more than a load's tolerance; "" without any."""
    scene, loads = samples.scene, samples.loads()
    distinct, pose_of_row = np.unique(samples.poses, axis=0, return_inverse=True)
    pose_of_row = pose_of_row.ravel()
    lowest, highest = (np.full((len(distinct), loads.shape[1]), bound) for bound in (np.inf, -np.inf))
    np.minimum.at(lowest, pose_of_row, loads)
    np.maximum.at(highest, pose_of_row, loads)
    excess = (highest - lowest) / [scene.tolerances[name] for name in scene.load_names]
    count = int((excess > 1.0).any(axis=1).sum())
    if not count:
        return ""
    pose, load = np.unravel_index(int(excess.argmax()), excess.shape)
    name, row = scene.load_names[load], int(np.flatnonzero(pose_of_row == pose)[0])
    spread = f"{three_digits(lowest[pose, load])} to {three_digits(highest[pose, load])} {quantity(name).unit}"
    return f"{count} poses have rows that differ by more than a tolerance (row {row + 1}: {name} {spread}): keep one"
