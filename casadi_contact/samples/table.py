"""A user's own table of samples, from any contact model or measurement, in CSV, and checks of it.

Columns by name, one row per pose:

    tx ty tz rx ry rz     pose [mm, rad]
    Fx ... Tz             wrench on the fixed body [N, N·mm]; Fx_med ... for scenes of several patches. Needed are
                          those that the scene's loads and normal loads are made of.
    gap, gap_med ...      distance of each patch [mm], above 0 in rows out of contact; may be left out
    domain, role          numbers of domain (1 for D1) and role (0 train, 1 validation, 2 test, some rows of each);
                          may be left out
"""

from pathlib import Path

import numpy as np

from casadi_contact.contact.model import overlaps_without_load
from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, Array, load_selection, rotation
from casadi_contact.core.files.reading import sha256_of
from casadi_contact.core.quantities import three_digits
from casadi_contact.samples.domains import roles_of
from casadi_contact.samples.samples import ROLES, Samples
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.columns import check_size, read_columns
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene

_LEAST_ROWS = 10
_MOST_ANGLE_RAD, _LEAST_TRAVEL_MM, _LEAST_FORCE_SHARE, _MOST_LEVER_MM = 3.5, 0.05, 0.01, 200.0


def read_sample_table(path: str | Path, scene: Scene) -> Samples:
    """Samples from a table; of rows without a role a tenth each, at random, is for validation and for the test.

    Raises FileNotFoundError, and ValueError for a missing column, values that are not finite numbers or beyond 1e15,
    columns of different length, too few rows, a role without rows, and wrong units, signs or origins.
    """
    path, several = Path(path), len(scene.patch_names) > 1
    ends = [f"_{patch}" if several else "" for patch in scene.patch_names]
    columns = [[f"{name}{end}" for name in (*WRENCH_NAMES, "gap")] for end in ends]
    needed: np.ndarray = np.any(load_selection(scene.load_names, scene.patch_names) != 0.0, axis=0)
    for p, normal in enumerate(scene.normal_loads):
        needed[p, range(3) if normal.index is None else [normal.index]] = True
    required = [*POSE_NAMES, *(columns[p][k] for p, k in np.argwhere(needed))]
    optional = [*(name for of_patch in columns for name in of_patch if name not in required), "domain", "role"]
    table = read_columns(path, required=required, optional=optional)
    count = len(table[POSE_NAMES[0]])
    if count < _LEAST_ROWS:
        raise ValueError(f"{path} has {count} rows, expected at least {_LEAST_ROWS}")
    for name, column in table.items():
        check_size(str(path), name, column)
    poses = np.stack([table[name] for name in POSE_NAMES], axis=1)
    distinct, pose_of_row = np.unique(poses, axis=0, return_inverse=True)  # repeated poses have the same role
    drawn = roles_of(len(distinct), 1, SamplingSettings())[pose_of_row.ravel()]
    zero, unknown = np.zeros(count), np.full(count, np.nan)
    samples = Samples(
        scene,
        poses=poses,
        wrenches=np.stack([np.stack([table.get(name, zero) for name in of[:6]], axis=1) for of in columns], axis=1),
        gaps=np.stack([table.get(of[6], unknown) for of in columns], axis=1),
        domain=table.get("domain", np.ones(count)),
        role=table.get("role", drawn),
        provenance={"table": str(path), "table_digest": sha256_of(path)},
    )
    missing = [f"{number} ({name})" for number, name in enumerate(ROLES) if not (samples.role == number).any()]
    if missing:
        got = f"{len(distinct)} poses, none of them with role {', '.join(missing)}"
        raise ValueError(f"{path} has {got}, expected hundreds, some of each role (or no column role)")
    _check_units(samples, str(path))
    check_no_pull(samples, str(path))
    check_gaps(samples, str(path))
    return samples


def _check_units(samples: Samples, where: str) -> None:
    """Raise ValueError for samples in other units, with other signs, or about another origin.

    Angles are at most 3.5 rad; some translation varies by 0.05 mm at least; the largest normal load is at least 1 % of
    the scene's reference load; forces act within 200 mm of the anchor p (median of |T - p×F|/|F|). where: the file.
    """
    scene, poses = samples.scene, samples.poses
    largest = np.abs(poses[:, 3:]).max(axis=0)
    if largest.max() > _MOST_ANGLE_RAD:
        name = POSE_NAMES[3 + int(largest.argmax())]
        raise ValueError(f"{where}: {name} reaches {largest.max():g}, expected radians: convert degrees")
    if (travel_mm := float(np.ptp(poses[:, :3], axis=0).max())) < _LEAST_TRAVEL_MM:
        got = f"tx, ty and tz vary by {travel_mm:.2g} at most, expected mm and at least {_LEAST_TRAVEL_MM:g}"
        raise ValueError(f"{where}: {got}: convert m to mm (and N·m to N·mm)")
    normal = normal_forces(scene.normal_loads, samples.wrenches)
    force_n = float(np.abs(normal).max(initial=0.0))
    if 0.0 < force_n < _LEAST_FORCE_SHARE * scene.reference_load:
        expected = f"{_LEAST_FORCE_SHARE:g} of reference_load = {scene.reference_load:g} N at least: convert kN to N"
        raise ValueError(f"{where}: the largest normal load is {three_digits(force_n)} N, expected {expected}")
    for p, patch in enumerate(scene.patches):
        force, torque = samples.wrenches[:, p, :3], samples.wrenches[:, p, 3:]
        pressed = (force != 0.0).any(axis=1)
        if not pressed.any():
            continue
        anchor = poses[pressed, :3] + rotation(poses[pressed, 3:]) @ patch.anchor_mm
        about_anchor = np.linalg.norm(torque[pressed] - np.cross(anchor, force[pressed]), axis=1)
        lever_mm = float(np.median(about_anchor / np.linalg.norm(force[pressed], axis=1)))
        if torque.any() and lever_mm > _MOST_LEVER_MM:
            got = f"the force of {patch.name} acts {lever_mm:.3g} mm from its anchor (median)"
            expected = f"{_MOST_LEVER_MM:g} mm at most: give torques about the fixed body's origin, in N·mm"
            raise ValueError(f"{where}: {got}, expected {expected}")
        if patch.normal.component is None:
            _check_resistance(poses[pressed, 3:], anchor, force[pressed], where, patch.name)


def check_no_pull(samples: Samples, where: str, *, share: float = 0.01) -> None:
    """Raise ValueError, naming the worst row, where a patch pulls by more than this share of the boundary load."""
    patches = samples.scene.patches
    normal = normal_forces(samples.scene.normal_loads, samples.wrenches)
    pulls = normal < -share * samples.scene.boundary_load
    if pulls.any():
        row, p = np.unravel_index(int(np.nanargmin(normal)), normal.shape)
        name, of, rows = patches[p].name, patches[p].normal, int(pulls.any(axis=1).sum())
        got = f"{name} pulls with {three_digits(-normal[row, p])} N ({rows} such rows)"
        expected = f"{of.component} {'>' if of.sign > 0.0 else '<'}= 0, and 0 out of contact"
        raise ValueError(f"{where}, row {row + 1}: {got}, expected {expected}: give loads on the fixed body (turn all)")


def check_gaps(samples: Samples, where: str, *, rounding_mm: float = 1e-6) -> None:
    """Raise ValueError, naming the first row, where a patch without load has a negative gap.

    Load and gap may change sign at other poses: as `overlaps_without_load` allows, in half of the rows at most.
    """
    free = (samples.wrenches == 0.0).all(axis=2) & ~np.isnan(samples.gaps)
    negative = free & (samples.gaps < -rounding_mm)
    wrong = overlaps_without_load(samples.wrenches, samples.gaps)
    wrong |= negative & (2 * negative.sum(axis=0) > free.sum(axis=0))
    if wrong.any():
        row, patch = np.argwhere(wrong)[0]
        name, rows = samples.scene.patches[patch].name, int(wrong.any(axis=1).sum())
        got = f"{name} carries no load and has the gap {samples.gaps[row, patch]:g} mm ({rows} such rows)"
        raise ValueError(f"{where}, row {row + 1}: {got}, expected a gap above 0: turn the signs, or leave gaps out")


def _check_resistance(angles: Array, anchor: Array, force: Array, where: str, name: str) -> None:
    """Raise ValueError for forces on the moving body in place of the fixed one.

    Contact resists: a force F on the fixed body grows as the moving body's anchor x moves along it. With the linear
    dependence on the rotations removed from both, the correlation Σ δx·δF / √(Σ|δx|² Σ|δF|²) is positive.
    """
    terms = np.column_stack([np.ones(len(angles)), angles])
    dx, df = (values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0] for values in (anchor, force))
    size = float(np.linalg.norm(dx) * np.linalg.norm(df))
    if len(angles) >= 40 and size > 0.0 and (correlation := float(np.sum(dx * df)) / size) < -0.2:
        got = f"the force of {name} falls as the moving body moves along it (correlation {correlation:.2f})"
        raise ValueError(f"{where}: {got}, expected the loads on the fixed body: turn the signs of all loads")
