"""Where a mesh lies in its body's frame: mirrored, turned, moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array, rotation

MIRRORS = ("x", "y", "z")


@dataclass(frozen=True)
class Placement:
    """p' = R·M·p + offset for points p [mm] of a mesh in the library's axes.

    offset_mm: along x, y, z. rotation_deg: about x, y, z as of a pose, R = Rx·Ry·Rz. mirror: the axis whose sign M
    turns ("z" makes a left joint a right one), none if empty.
    """

    offset_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotation_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    mirror: str = ""

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Placement:
        """From a scene's checked [geometry.placement] of one body; where the file puts it for an empty one."""
        offset, turned = (tuple(table.get(key, (0.0, 0.0, 0.0))) for key in ("offset", "rotation_deg"))
        return cls(offset, turned, table.get("mirror", ""))

    def points(self, points_mm: Array) -> Array:
        """Points (n, 3) [mm] where they lie in the body's frame."""
        if self == Placement():
            return points_mm
        signs = [-1.0 if axis == self.mirror else 1.0 for axis in MIRRORS]
        return (points_mm * signs) @ rotation(np.radians(self.rotation_deg)).T + self.offset_mm

    def faces(self, faces: np.ndarray) -> np.ndarray:
        """Triangles (f, 3) whose outside is still outside: turned where the mesh is mirrored."""
        return faces[:, ::-1] if self.mirror else faces
