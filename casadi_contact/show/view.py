"""The direction that a scene is looked at: as its moving body presses, onto the fixed surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array

_LEAST_MEAN_NORMAL = 0.05  # below, the elements face all ways
_LETTERS = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class PictureAxis:
    """A coordinate c = direction·p of points p, rightwards or upwards in a picture; reversed: leftwards or downwards.

    direction (3,) is a unit vector whose largest component is positive, so that an axis of the frame stays one.
    """

    direction: Array
    reversed: bool = False

    @classmethod
    def along(cls, vector: Array) -> PictureAxis:
        """The axis whose coordinate grows, or falls, rightwards or upwards, for that to be the direction `vector`."""
        unit = vector / np.linalg.norm(vector)
        backwards = bool(unit[np.abs(unit).argmax()] < 0.0)
        return cls(np.where(backwards, -unit, unit) + 0.0, backwards)

    @property
    def name(self) -> str:
        """x, y or z, or the sum of these that an oblique coordinate is: 0.98 x - 0.18 y."""
        return named(self.direction)

    @property
    def label(self) -> str:
        return f"{self.name} [mm]"

    @property
    def pointing(self) -> Array:
        """Unit vector (3,) of rightwards or upwards in the picture."""
        return -self.direction if self.reversed else self.direction

    def of(self, points_mm: Array) -> Array:
        """Coordinates (...) [mm] of points (..., 3)."""
        return points_mm @ self.direction


@dataclass(frozen=True, eq=False)
class View:
    """Right, up and towards the viewer: a right-handed frame, so that nothing is seen mirrored."""

    right: PictureAxis
    up: PictureAxis
    toward: PictureAxis

    @classmethod
    def along(cls, direction: Array) -> View:
        """Seen along a direction (3,); upwards is y, or x where that direction is nearer to y than to the x-z plane."""
        toward = -direction / np.linalg.norm(direction)
        rough = np.eye(3)[0 if abs(toward[1]) > np.sqrt(0.5) else 1]
        up = rough - (rough @ toward) * toward
        return cls(PictureAxis.along(np.cross(up, toward)), PictureAxis.along(up), PictureAxis.along(toward))

    @property
    def behind(self) -> View:
        """Seen the other way, as the fixed surface sees the moving body."""
        return View.along(self.toward.pointing)

    @property
    def name(self) -> str:
        """The direction that is looked along: −y for a knee, +x for a patella."""
        name = named(-self.toward.pointing)
        return f"+{name}" if name in _LETTERS else name


def view_of(model: ElasticFoundation) -> View:
    """The view along the direction of pressing: of the first patch, or, where its normal load has none, against the
    mean normal of all elements (into a hip's cup; along -y if they face all ways).
    """
    direction = model.scene.normal_loads[0].direction
    if direction is None:
        grids = model.scene.elements(model.grid)
        areas = np.concatenate([grid.areas_mm2 for grid in grids])
        mean = areas @ np.concatenate([grid.normals for grid in grids]) / areas.sum()
        direction = -mean if np.linalg.norm(mean) > _LEAST_MEAN_NORMAL else np.array([0.0, -1.0, 0.0])
    return View.along(direction)


def named(direction: Array) -> str:
    """A unit vector in letters: -y, or 0.98 x - 0.18 y; components below 0.005 are left out."""
    parts = ""
    for letter, value in zip(_LETTERS, direction, strict=True):
        if abs(value) < 0.005:
            continue
        sign = "−" if value < 0.0 else "+" if parts else ""
        size = "" if abs(value) > 0.9999 else f"{abs(value):.2f} "
        parts += f" {sign} {size}{letter}" if parts else f"{sign}{size}{letter}"
    return parts
