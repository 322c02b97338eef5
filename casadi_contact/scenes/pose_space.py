"""The poses a joint can take: pose parameters that are locked, or tied to a free one.

    [pose]
    locked = { tz = 0.0, rx = 0.0 }                          # [mm, rad], never changes
    tied = { ry = { to = "rz", slope = -0.1, at_zero = 0.0 } }   # ry = at_zero + slope·rz, in mm and rad

With the free parameters as they are, a pose q lies in the space where q = M·q + c. Surrogates of such a scene take a
whole pose (6) like any other, but do not look at its locked and tied entries: their loads are those of M·q + c, their
derivatives those of this composition, so zero along what is locked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casadi_contact.conventions import POSE_NAMES, REFLECTION, Array, pose_index
from casadi_contact.shapes.checks import fail, number, table_of


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
    def whole(self) -> bool:
        """True where every pose parameter is free."""
        return len(self.free) == 6

    @property
    def symmetric(self) -> bool:
        """True where the mirror image in the plane z = 0 of a pose of this space is one too."""
        return bool((self.matrix == REFLECTION[:, None] * self.matrix * REFLECTION).all()) and bool(
            (self.offset == REFLECTION * self.offset).all()
        )

    def onto(self, poses: Array) -> Array:
        """Poses (..., 6) with locked and tied parameters put in place."""
        return poses if self.whole else poses @ self.matrix.T + self.offset

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
