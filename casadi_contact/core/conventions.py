"""Names, units, frames and rotations shared by the whole library.

[EF15] everywhere is the paper whose method this is: I. Eskinazi and B. J. Fregly, "Surrogate modeling of deformable
joint contact using artificial neural networks", Medical Engineering & Physics 37 (2015) 885-891.

Inside the library: mm, N, N·mm, MPa, rad, s. A *pose* (tx, ty, tz, rx, ry, rz) places the moving body
in the fixed body's frame, with R = Rx(rx)·Ry(ry)·Rz(rz) (x-y-z body-fixed). *Loads* act on the fixed body,
in its frame, about its origin. For the knee: x posterior, y superior, z medial (right knee), the femoral
component moves, flexion is rz < 0 and compression is Fy < 0.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import wraps
from numbers import Integral
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from casadi_contact.core.quantities import quantity

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]  # called as (done, all)
Update = Callable[[str, float, float, str], None]  # called as (what is worked on, done, all there is to do, remark)
_Method = TypeVar("_Method", bound=Callable[..., Any])

POSE_NAMES = ("tx", "ty", "tz", "rx", "ry", "rz")
POSE_UNITS = tuple(quantity(name).unit for name in POSE_NAMES)
WRENCH_NAMES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
# Where each axis of a joint's frame grows towards, and where it comes from.
ANATOMY = {"x": ("posterior", "anterior"), "y": ("superior", "inferior"), "z": ("medial", "lateral")}
POSE_DESCRIPTION = "(n, 6): tx ty tz [mm] rx ry rz [rad]"
LEVER_MM = 25.0  # about what a knee's condyles lie off its middle: turns N·mm into comparable N, rad into comparable mm
REFLECTION = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])  # of a pose, and of a wrench, in the plane z = 0
POSE_IN_MM = np.array([1.0, 1.0, 1.0, LEVER_MM, LEVER_MM, LEVER_MM])  # pose parameters in comparable mm


def stage_progress(update: Update | None, stage: str) -> Progress | None:
    """A `Progress` that reports to an `Update` how far a stage is; None without one."""
    return None if update is None else lambda done, total: update(stage, done, total, "")


def pose_index(name: str) -> int:
    """Column of a pose parameter in a pose array; raises ValueError for an unknown name."""
    if name not in POSE_NAMES:
        raise ValueError(f"unknown pose parameter {name!r}, expected one of {', '.join(POSE_NAMES)}")
    return POSE_NAMES.index(name)


def as_poses(poses: ArrayLike) -> Array:
    """Poses as a contiguous float64 array (n, 6); ValueError for another shape and what is not finite and real."""
    poses = named_poses(poses)
    try:
        if np.iscomplexobj(poses):  # a complex step would find every slope zero, and call its start a minimum
            raise TypeError("complex; slopes come from the model's jacobian")
        array = np.ascontiguousarray(poses, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"poses are not real numbers ({error}), expected {POSE_DESCRIPTION}") from None
    if array.ndim != 2 or array.shape[1] != 6:
        raise ValueError(f"poses has shape {array.shape}, expected {POSE_DESCRIPTION}")
    finite = np.isfinite(array)
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        raise ValueError(f"poses holds {array[row, column]} at row {row} ({POSE_NAMES[column]}), expected finite ones")
    return array


def named_poses(poses: Any) -> Any:
    """The columns of a DataFrame (or entries of a Series) with names, in the order of `POSE_NAMES`; a masked array with
    NaN for its masked numbers; anything else as it is. Raises ValueError for names that are not those of a pose."""
    if isinstance(poses, np.ma.MaskedArray):
        return np.ma.filled(poses.astype(float), np.nan)
    names = poses.index if hasattr(poses, "iloc") and np.ndim(poses) == 1 else getattr(poses, "columns", ())
    if callable(names) or not any(isinstance(name, str) for name in names):
        return poses
    for wanted in (POSE_NAMES, [f"{name}_{'mm' if name[0] == 't' else 'rad'}" for name in POSE_NAMES]):
        if set(wanted) <= set(names):
            return poses[list(wanted)]
    raise ValueError(f"poses have the columns {', '.join(map(str, names))}, expected {', '.join(POSE_NAMES)}")


def finite_numbers(value: Any) -> Array | None:
    """Real, finite numbers of any shape; None for anything else: words, complex numbers, symbols, unequal rows."""
    try:
        given = np.asarray(named_poses(value) if isinstance(value, np.ma.MaskedArray) else value)
        numbers = given.astype(float) if given.dtype.kind != "c" else None
    except (TypeError, ValueError, NotImplementedError):  # the last by CasADi's symbols
        return None
    return numbers if numbers is not None and np.isfinite(numbers).all() else None


def check_above_zero(**settings: Any) -> None:
    """Raise ValueError, naming it, for a setting that is no finite number above 0."""
    for name, value in settings.items():
        number = finite_numbers(value)
        if number is None or number.shape != () or number <= 0.0:
            raise ValueError(f"{name} is {value!r}, expected a finite number above 0")


def whole_number(name: str, value: Any, least: int) -> int:
    """A whole number, NumPy's too; ValueError, naming it, for anything else (True, False) and below the least."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} is {value!r}, expected a whole number of {least} or more")
    return int(value)


def evenly_spaced_indices(count: int, most: int) -> np.ndarray:
    """Up to `most` of the numbers 0 ... count - 1, spread evenly, both ends among them.

    >>> evenly_spaced_indices(101, 5)
    array([  0,  25,  50,  75, 100])
    """
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).astype(int))


def pose_text(pose: ArrayLike, patch_names: Sequence[str] = ()) -> str:
    """A pose (6,) as messages name it, in mm and degrees; with the flexion, -rz, between a medial and a lateral patch.

    >>> pose_text([5.0, -2.5, 0.0, 0.0, 0.0, -0.5], ("med", "lat"))
    'tx 5 mm, ty -2.5 mm, tz 0 mm, rx 0°, ry 0°, rz -28.65° (flexion 28.65°)'
    """
    values = np.asarray(pose, dtype=float)
    said = [f"{name} {value:.4g} mm" for name, value in zip(POSE_NAMES[:3], values[:3], strict=True)]
    said += [f"{name} {value:.4g}°" for name, value in zip(POSE_NAMES[3:], np.degrees(values[3:]), strict=True)]
    flexion = f" (flexion {-np.degrees(values[5]):.4g}°)" if {"med", "lat"} <= set(patch_names) else ""
    return ", ".join(said) + flexion


def batched(method: _Method) -> _Method:
    """Decorate a method of poses (n, 6) so that it takes one pose (6,) as well, whose result, an array or a tuple of
    arrays, then comes without its first axis. Poses are checked by `as_poses`."""

    @wraps(method)
    def for_one_or_many(self: Any, poses: Any, *arguments: Any, **keywords: Any) -> Any:
        single, poses = False, named_poses(poses)
        with suppress(ValueError):  # rows of unequal length: `as_poses` says so
            single = np.shape(poses) == (6,)
        result = method(self, as_poses([poses] if single else poses), *arguments, **keywords)
        if single:
            return tuple(part[0] for part in result) if isinstance(result, tuple) else result[0]
        return result

    return cast(_Method, for_one_or_many)


def rotation(angles: ArrayLike) -> Array:
    """R = Rx(rx)·Ry(ry)·Rz(rz) (..., 3, 3) for angles (..., 3) [rad]: a point q of the moving body lies at t + R·q."""
    angles = np.asarray(angles, dtype=np.float64)
    sx, sy, sz = np.moveaxis(np.sin(angles), -1, 0)
    cx, cy, cz = np.moveaxis(np.cos(angles), -1, 0)
    rows = (
        (cy * cz, -cy * sz, sy),
        (cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy),
        (sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy),
    )
    return _matrices(rows, angles.shape[:-1])


def local_poses(poses: Array, anchor_mm: Array) -> Array:
    """x = (t + R·a, rx, ry, rz) (n, 6) for poses (n, 6): where an anchor a (3,) of the moving body is [mm]."""
    local = np.array(poses)
    local[:, :3] += rotation(poses[:, 3:]) @ anchor_mm
    return local


def angular_velocity_map(angles: ArrayLike) -> Array:
    """E with ω = E·(ṙx, ṙy, ṙz), ω in the fixed frame: columns e_x, Rx·e_y, Rx·Ry·e_z; shape (..., 3, 3)."""
    angles = np.asarray(angles, dtype=np.float64)
    sx, sy = np.sin(angles[..., 0]), np.sin(angles[..., 1])
    cx, cy = np.cos(angles[..., 0]), np.cos(angles[..., 1])
    rows = ((1.0, 0.0, sy), (0.0, cx, -sx * cy), (0.0, sx, cx * cy))
    return _matrices(rows, angles.shape[:-1])


def _matrices(rows: Sequence[Sequence[ArrayLike]], shape: tuple[int, ...]) -> Array:
    """Matrices (..., 3, 3) from their entries; `np.stack` takes five times as long for a few poses."""
    matrices = np.empty((*shape, 3, 3))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            matrices[..., i, j] = entry
    return matrices


def wrench_names(patch_names: Sequence[str]) -> tuple[str, ...]:
    """Fx_med, ..., Tz_lat: six of each patch."""
    return tuple(f"{component}_{patch}" for patch in patch_names for component in WRENCH_NAMES)


def possible_loads(patch_names: Sequence[str]) -> tuple[str, ...]:
    """Names of all loads that patches give: the components of the total wrench, then those of each patch."""
    return (*WRENCH_NAMES, *wrench_names(patch_names))


def loads_of_total(component: str, load_names: Sequence[str], patch_names: Sequence[str]) -> tuple[str, ...]:
    """The named loads whose sum is a component of the total wrench: that itself, those of all patches, or none."""
    if component in load_names:
        return (component,)
    parts = tuple(f"{component}_{patch}" for patch in patch_names)
    return parts if set(parts) <= set(load_names) else ()


def check_loads(load_names: Sequence[str], loads: Iterable[str] | None) -> tuple[str, ...]:
    """The chosen loads (None: all of load_names); ValueError for one that is not among load_names."""
    names = tuple(load_names) if loads is None else tuple([loads] if isinstance(loads, str) else loads)
    if not names or any(name not in load_names for name in names):
        raise ValueError(f"loads {', '.join(names) or '(none)'}, expected some of {', '.join(load_names)}")
    return names


def load_selection(load_names: Sequence[str], patch_names: Sequence[str]) -> Array:
    """Matrix S of shape (loads, patches, 6) that picks named loads from patch wrenches: ``Fy_med`` is Fy of the patch
    ``med``, ``Fx`` the sum over patches [EF15 Eqs. 1-7]: loads = einsum("lpk,npk->nl", S, wrenches)."""
    selection = np.zeros((len(load_names), len(patch_names), 6))
    for row, name in enumerate(load_names):
        component, _, patch = name.partition("_")
        if component not in WRENCH_NAMES or (patch and patch not in patch_names):
            raise ValueError(f"unknown load {name!r}, expected one of {', '.join(possible_loads(patch_names))}")
        patches = [patch_names.index(patch)] if patch else range(len(patch_names))
        for p in patches:
            selection[row, p, WRENCH_NAMES.index(component)] = 1.0
    return selection


def load_jacobian(selection: Array, wrenches: Array, slopes: Array) -> tuple[Array, Array]:
    """Loads (n, L) and their derivatives by the pose (n, L, 6): a `load_selection` of wrenches (n, P, 6) and theirs."""
    # A product of matrices for each pose: of the parts of a patch einsum takes twenty times as long.
    rows = selection.reshape(len(selection), selection[0].size)
    columns = slopes.reshape(len(slopes), rows.shape[1], slopes.shape[-1])
    return np.einsum("lpk,npk->nl", selection, wrenches), rows @ columns


def wrench_about_origin(force: Array, arm: Array) -> Array:
    """(f, arm × f) (..., 6) of forces and arms (..., 3): its product with (v, ω) is the force's power."""
    return np.concatenate([force, np.cross(arm, force)], -1)


def twist_to_pose_gradient(by_twist: Array, poses: Array) -> Array:
    """Derivatives (n, ..., 6) by twist become derivatives by pose (n, 6), since ω = E·(ṙx, ṙy, ṙz)."""
    slopes = by_twist.copy()
    slopes[..., 3:] = np.einsum("n...w,nwj->n...j", by_twist[..., 3:], angular_velocity_map(poses[:, 3:]))
    return slopes
