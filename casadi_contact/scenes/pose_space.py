"""The poses a joint can take: pose parameters that are locked, or tied to a free one.

    [pose]
    locked = { tz = 0.0, rx = 0.0 }                          # [mm, rad], never changes
    tied = { ry = { to = "rz", slope = -0.1, at_zero = 0.0 } }   # ry = at_zero + slope·rz, in mm and rad

A pose q of the space satisfies q = M·q + c. Whatever searches for poses (`settle`, optimisation, samples) stays in the
space. Contact models take whole poses (6) all the same:

- an elastic foundation or a user's own model has the loads of the pose as given, on the space or not;
- a surrogate is defined on the space alone. Its loads are those of M·q + c, its derivatives those of this composition
  (zero along locked parameters), and its validity falls to zero beyond `OFF_SPACE`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, REFLECTION, Array, pose_index
from casadi_contact.scenes.shapes.checks import fail, number, table_of

OFF_SPACE = 1e-3  # largest deviation from a constraint [mm, rad]


@dataclass(frozen=True)
class PoseSpace:
    """matrix M (6, 6) and offset c (6,) [mm, rad] of the projection; free: columns of the parameters that are free."""

    matrix: Array = field(default_factory=lambda: np.eye(6))
    offset: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def free(self) -> tuple[int, ...]:
        """Columns of the free pose parameters, in pose order."""
        return tuple(k for k in range(6) if self.matrix[k, k] == 1.0)

    @property
    def free_names(self) -> tuple[str, ...]:
        """The free pose parameters, in pose order."""
        return tuple(POSE_NAMES[k] for k in self.free)

    @property
    def unconstrained(self) -> bool:
        """Every pose parameter is free."""
        return len(self.free) == 6

    @property
    def symmetric(self) -> bool:
        """The mirror image in the plane z = 0 of a pose of this space is one too."""
        turned = REFLECTION[:, None] * self.matrix * REFLECTION
        return bool((self.matrix == turned).all() and (self.offset == REFLECTION * self.offset).all())

    def project(self, poses: Array) -> Array:
        """Poses (..., 6) with locked and tied parameters set: M·q + c."""
        return poses if self.unconstrained else poses @ self.matrix.T + self.offset

    def pull_back(self, jacobian: Array) -> Array:
        """Derivatives (..., 6) by the whole pose as those by the free parameters, tied ones following: J·M."""
        return jacobian if self.unconstrained else jacobian @ self.matrix

    def constraint_text(self, name: str) -> str:
        """The constraint of a parameter: "locked at 0.4", "tied to rz"; "" if it is free. ValueError if unknown."""
        k = pose_index(name)
        if k in self.free:
            return ""
        to = np.flatnonzero(self.matrix[k])
        return f"tied to {POSE_NAMES[to[0]]}" if len(to) else f"locked at {self.offset[k]:g}"

    def check_unconstrained(self, what: str) -> None:
        """Raises ValueError for locked or tied pose parameters; what: needs all six free."""
        self.check_free(POSE_NAMES, f"{what} moves all six pose parameters")

    def check_free(self, names: Iterable[str], what: str = "free") -> None:
        """Raises ValueError for locked or tied pose parameters among these names; what: their use."""
        constrained = [name for name in names if self.constraint_text(name)]
        if constrained:
            texts = ", ".join(f"{name} is {self.constraint_text(name)}" for name in constrained)
            cure = f"leave out {', '.join(constrained)}, or change the scene's [pose]"
            raise ValueError(f"{what}: {texts} by the scene, expected free ones ({', '.join(self.free_names)}): {cure}")

    def free_curves(self, curves: Mapping[str, Array], what: str) -> dict[str, Array]:
        """The curves of free pose parameters, by name; what: their source, for messages. Raises ValueError for the
        curve of a locked or tied parameter that differs by more than `OFF_SPACE` from its constraint, or whose
        constraint depends on a curve that is not given."""
        for name, curve in curves.items():
            if not self.constraint_text(name):
                continue
            k = pose_index(name)
            ties = {POSE_NAMES[j]: self.matrix[k, j] for j in np.flatnonzero(self.matrix[k])}
            target = self.offset[k] + sum(slope * np.asarray(curves.get(to, np.nan)) for to, slope in ties.items())
            if not np.abs(np.asarray(curve) - target).max(initial=0.0) <= OFF_SPACE:
                locked = f"{name} is {self.constraint_text(name)} by the scene"
                raise ValueError(f"{what}: {locked}, expected it there: leave {name} out, or out of the scene's [pose]")
        return {name: curve for name, curve in curves.items() if not self.constraint_text(name)}

    @classmethod
    def from_table(cls, table: object) -> PoseSpace:
        """From the scene's [pose]; raises ValueError naming the key at fault."""
        values = table_of("pose", table, ("locked", "tied"), complete=False)
        space = cls()
        for name, value in table_of("pose.locked", values.get("locked", {}), POSE_NAMES, complete=False).items():
            k = pose_index(name)
            space.matrix[k], space.offset[k] = 0.0, number(f"pose.locked.{name}", value)
        ties = table_of("pose.tied", values.get("tied", {}), POSE_NAMES, complete=False)
        for name, tie in ties.items():
            _tie(space, name, table_of(f"pose.tied.{name}", tie, ("to", "slope"), complete=True, optional=("at_zero",)))
        for name, tie in ties.items():
            if pose_index(tie["to"]) not in space.free:
                raise fail(f"pose.tied.{name}.to", tie["to"], "a pose parameter that is neither locked nor tied")
        if not space.free:
            raise fail("pose", dict(values), "at least one pose parameter that is free")
        return space


def _tie(space: PoseSpace, name: str, tie: Mapping[str, Any]) -> None:
    k, to = pose_index(name), tie["to"]
    if to not in POSE_NAMES or to == name:
        raise fail(f"pose.tied.{name}.to", to, f"another pose parameter, one of {', '.join(POSE_NAMES)}")
    if space.matrix[k, k] == 0.0:
        raise fail(f"pose.tied.{name}", dict(tie), "a pose parameter that is not locked")
    space.matrix[k] = 0.0
    space.matrix[k, pose_index(to)] = number(f"pose.tied.{name}.slope", tie["slope"])
    space.offset[k] = number(f"pose.tied.{name}.at_zero", tie.get("at_zero", 0.0))
