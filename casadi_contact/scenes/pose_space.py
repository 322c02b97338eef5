"""The poses a joint can take: pose parameters that are locked, or tied to a free one.

    [pose]
    locked = { tz = 0.0, rx = 0.0 }                          # [mm, rad], never changes
    tied = { ry = { to = "rz", slope = -0.1, at_zero = 0.0 } }   # ry = at_zero + slope·rz, in mm and rad

With the free parameters as they are, a pose q lies in the space where q = M·q + c. Everything that looks for poses
(`settle`, optimisation, samples) moves within it. A contact model is asked for a whole pose (6) all the same, and may
be asked off the space:

- an elastic foundation, or a model of the user's own, is two bodies in contact and knows of no joint: its loads are
  those of the pose as given, so that what it takes to hold a lock can be asked for;
- a surrogate has learned the space alone: its loads are those of M·q + c, its derivatives those of this composition, so
  zero along what is locked, and its validity falls to zero from `OFF_SPACE` on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, REFLECTION, Array, pose_index
from casadi_contact.scenes.shapes.checks import fail, number, table_of

OFF_SPACE = 1e-3  # [mm, rad] off its locked or tied value: so far a pose parameter counts as there


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

    def along(self, slopes: Array) -> Array:
        """Derivatives (..., 6) by the free parameters, tied ones following: J·M of derivatives J by the whole pose."""
        return slopes if self.whole else slopes @ self.matrix

    def bound(self, name: str) -> str:
        """How a pose parameter is held: "locked at 0.4", "tied to rz"; "" where it is free. ValueError if unknown."""
        k = pose_index(name)
        if k in self.free:
            return ""
        to = np.flatnonzero(self.matrix[k])
        return f"tied to {POSE_NAMES[to[0]]}" if len(to) else f"locked at {self.offset[k]:g}"

    def check_whole(self, what: str) -> None:
        """Raises ValueError for locked or tied pose parameters, by name; what: says what needs all six free."""
        held = [name for name in POSE_NAMES if self.bound(name)]
        if held:
            said = ", ".join(f"{name} is {self.bound(name)}" for name in held)
            raise ValueError(
                f"{what} moves all six pose parameters, but {said} by the scene: take "
                f"{'it' if len(held) == 1 else 'them'} out of the scene's [pose]"
            )

    def check_free(self, names: Iterable[str], what: str = "free") -> None:
        """Raises ValueError for pose parameters that are locked or tied, by name; what: what they were given as."""
        held = {name: how for name in names if (how := self.bound(name))}
        if held:
            said = ", ".join(f"{name} is {how}" for name, how in held.items())
            raise ValueError(
                f"{what}: {said} by the scene, expected some of {', '.join(self.free_names)}: leave out "
                f"{', '.join(held)}, or take {'it' if len(held) == 1 else 'them'} out of the scene's [pose]"
            )

    def free_curves(self, curves: Mapping[str, Array], what: str) -> dict[str, Array]:
        """Those of given pose parameters, by name, that are free; what: says what gives them.

        Raises ValueError for a locked one that is off its value by more than `OFF_SPACE`, and for a tied one likewise,
        or where what it is tied to is not given.
        """
        for name, curve in curves.items():
            k = pose_index(name)
            tied = [(self.matrix[k, j], curves.get(POSE_NAMES[j])) for j in np.flatnonzero(self.matrix[k])]
            known = not self.bound(name) or all(of is not None for _, of in tied)
            held = self.offset[k] + sum(slope * np.asarray(of) for slope, of in tied if of is not None)
            off = np.abs(np.asarray(curve) - held).max(initial=0.0) if known and self.bound(name) else 0.0
            if not known or off > OFF_SPACE:
                said = f"given up to {off:.3g} off that" if known else "which is not given"
                raise ValueError(
                    f"{what}: {name} is {self.bound(name)} by the scene, {said}, expected {name} within {OFF_SPACE:g} "
                    f"of it: leave {name} out there, or out of the scene's [pose]"
                )
        return {name: curve for name, curve in curves.items() if not self.bound(name)}

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
