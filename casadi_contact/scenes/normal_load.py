"""The normal load N of a patch: how hard it is pressed, as a scene's ``loads.sensitive`` names it for each patch.

    "Fy_med", "-Fy_med"   N = -Fy of the patch med: pressed along -y (a knee's plateau, from above)
    "+Fx_med"             N = +Fx of the patch med: pressed along +x
    "F", "F_med"          N = |F|, the magnitude of the patch's force: no single direction (a hip)

A scene of one patch may leave the patch's name out; in one of several, a single name without patch holds for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from casadi_contact.core.conventions import WRENCH_NAMES, Array, load_selection, pose_index
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.shapes.checks import distinct_names, fail, identifier, number, table_of

FORCE_NAMES = WRENCH_NAMES[:3]


@dataclass(frozen=True)
class NormalLoad:
    """N = sign·component of a patch's wrench, or its force's magnitude (None); loads: those that N is made of."""

    patch: str
    component: str | None
    sign: float
    loads: tuple[str, ...]

    @property
    def index(self) -> int | None:
        """Column of the component in a wrench; None for a magnitude."""
        return None if self.component is None else WRENCH_NAMES.index(self.component)

    @property
    def direction(self) -> Array | None:
        """Unit vector (3,) along which the moving body presses the patch; None for a magnitude."""
        return None if self.index is None else self.sign * np.eye(3)[self.index]

    @property
    def as_number(self) -> NormalLoad:
        """Itself, or of a magnitude N as one load, F_patch."""
        return self if self.component else NormalLoad(self.patch, "F", 1.0, (f"F_{self.patch}",))

    def of(self, wrenches: Array) -> Array:
        """N (...) [N] of the patch's wrenches (..., 6)."""
        if self.index is None:
            return np.linalg.norm(wrenches[..., :3], axis=-1)
        return self.sign * wrenches[..., self.index]

    def gradient(self, wrenches: Array, jacobian: Array) -> Array:
        """dN (..., k) for d wrench (..., 6, k); F·dF/|F| for a magnitude, zero without force."""
        if self.index is None:
            size = self.of(wrenches)[..., None]
            unit = wrenches[..., :3] / np.where(size > 0.0, size, 1.0)
            return np.einsum("...i,...ij->...j", unit, jacobian[..., :3, :])
        return self.sign * jacobian[..., self.index, :]

    def with_size(self, forces: Array, size: Array | float) -> Array:
        """Values (n, len(loads)) of the named loads with N = size, (n,) or one number; a force keeps its direction."""
        size = np.broadcast_to(size, len(forces))[:, None]
        if self.component is not None:
            return self.sign * size
        return forces * (size / np.maximum(np.linalg.norm(forces, axis=1, keepdims=True), 1e-300))

    def at_least(self, forces: Array, least: float) -> Array:
        """Values (n, len(loads)) of the named loads with N brought up to `least` where it is smaller, or pulls."""
        size = self.sign * forces[:, 0] if self.index is not None else np.linalg.norm(forces, axis=1)
        return self.with_size(forces, np.maximum(size, least))


def normal_loads(names: Sequence[str], patch_names: Sequence[str]) -> tuple[NormalLoad, ...]:
    """The normal load of each patch, in patch order. ValueError for text that is none, and unless each has one."""
    if len(names) == 1 and len(patch_names) > 1 and names[0].lstrip("+-") in (*FORCE_NAMES, "F"):
        names = [f"{names[0]}_{patch}" for patch in patch_names]
    by_patch = {load.patch: load for load in (_normal_load(name, patch_names) for name in names)}
    missing = [patch for patch in patch_names if patch not in by_patch]
    if missing or len(names) != len(patch_names):
        raise fail("loads.sensitive", list(names), f"one load for each of the patches {', '.join(patch_names)}")
    return tuple(by_patch[patch] for patch in patch_names)


def _normal_load(text: str, patch_names: Sequence[str]) -> NormalLoad:
    name = text.lstrip("+-")
    component, _, patch = name.partition("_")
    if not patch and len(patch_names) == 1:
        patch = patch_names[0]
    signed = text != name
    if component not in (*FORCE_NAMES, "F") or patch not in patch_names or (component == "F" and signed):
        possible = [f"{sign}{force}_{p}" for p in patch_names for sign in "-+" for force in FORCE_NAMES]
        possible += [f"F_{p}" for p in patch_names]
        raise ValueError(f"scene: unknown load {text!r} in loads.sensitive, expected one of {', '.join(possible)}")
    if component == "F":
        suffix = name[1:]
        return NormalLoad(patch, None, 1.0, tuple(f"{force}{suffix}" for force in FORCE_NAMES))
    return NormalLoad(patch, component, 1.0 if text.startswith("+") else -1.0, (name,))


def in_sum(normals: tuple[NormalLoad, ...]) -> tuple[NormalLoad, ...]:
    """The sum of normal loads along one direction, which one pose parameter can set (a knee whose r_x is locked sinks
    by t_y alone); themselves where there is one, or several directions."""
    directions = {(normal.component, normal.sign) for normal in normals}
    component, sign = next(iter(directions))
    if len(normals) == 1 or len(directions) > 1 or component is None:
        return normals
    return (NormalLoad("", component, sign, (component,)),)


def normal_forces(loads: Sequence[NormalLoad], wrenches: Array) -> Array:
    """N of every patch (n, patches) for wrenches (n, patches, 6)."""
    return np.stack([load.of(wrenches[:, p]) for p, load in enumerate(loads)], axis=1)


def normal_gradients(loads: Sequence[NormalLoad], wrenches: Array, jacobian: Array) -> Array:
    """dN (n, patches, k) for d wrench (n, patches, 6, k)."""
    return np.stack([load.gradient(wrenches[:, p], jacobian[:, p]) for p, load in enumerate(loads)], axis=1)


class Patch(NamedTuple):
    """A patch: its name, its anchor (3,) on the moving body [mm], and its normal load."""

    name: str
    anchor_mm: Array
    normal: NormalLoad


@dataclass(frozen=True)
class LoadsTable:
    """A scene's [loads]: names, the normal load of each patch, the pose parameters to which these are sensitive, N0 [N]
    of a root load, its slope out of contact [1/mm], and the load [N] that counts as the boundary of contact."""

    load_names: tuple[str, ...]
    normal_loads: tuple[NormalLoad, ...]
    sensitive_pose: tuple[str, ...]
    reference_load: float
    gap_slope: float
    boundary_load: float

    @classmethod
    def from_table(cls, table: object, patch_names: Sequence[str], space: PoseSpace) -> LoadsTable:
        """Of a scene with these patches and this pose space; raises ValueError naming the key at fault."""
        numbers = ("reference_load", "gap_slope", "boundary_load")
        loads = table_of("loads", table, ("names", "sensitive", *numbers), complete=True, optional=("sensitive_pose",))
        names = tuple(identifier("loads.names", load) for load in distinct_names("loads.names", loads["names"]))
        pressed = normal_loads(distinct_names("loads.sensitive", loads["sensitive"]), patch_names)
        load_selection(names, patch_names)  # refuses a name that is none of a patch's loads
        pose = distinct_names("loads.sensitive_pose", loads["sensitive_pose"]) if "sensitive_pose" in loads else ()
        if any(pose_index(parameter) not in space.free for parameter in pose):
            raise fail("loads.sensitive_pose", list(pose), "pose parameters that are free (see [pose])")
        return cls(names, pressed, pose, *(number(f"loads.{key}", loads[key], low=0.0) for key in numbers))


_AXES = "xyz"
_ANATOMICAL = {"cop_ap": "cop_x", "cop_ml": "cop_z"}  # of a joint that is pressed along y


@dataclass(frozen=True)
class CentreOfPressure:
    """The coordinate along axis 0 (x), 1 or 2: sign·T/F [mm], of the components F (force) and T (torque) of the total
    wrench, by name; pressing: the sign of F in contact."""

    axis: int
    force: str
    torque: str
    sign: float
    pressing: float


def centre_of_pressure(name: str, normals: Sequence[NormalLoad]) -> CentreOfPressure | None:
    """The centre of pressure of this name ("cop_x", "cop_ap"; "_mm" may follow), None where the name is another's.
    Raises ValueError for a coordinate that the scene's normal loads leave without meaning."""
    name = name.removesuffix("_mm")
    if not name.startswith("cop_"):
        return None
    pressed = {(normal.component, normal.sign) for normal in normals if normal.component is not None}
    axis, pressing = next(iter(pressed)) if len(pressed) == 1 else (None, 0.0)
    if axis is None:
        raise ValueError(f"{name}: the scene's patches are not pressed in one direction, expected forces and torques")
    a = _AXES.index(axis[-1])
    known = {f"cop_{_AXES[b]}": b for b in range(3) if b != a}
    known |= {alias: known[of] for alias, of in _ANATOMICAL.items() if a == 1}
    if name not in known:
        raise ValueError(f"unknown centre of pressure {name!r} of pressing along {axis}, expected {', '.join(known)}")
    b = known[name]
    k = 3 - a - b
    return CentreOfPressure(b, axis, f"T{_AXES[k]}", 1.0 if (b - k) % 3 == 1 else -1.0, pressing)
