"""The direction that a scene is looked at: as its moving body presses, onto the fixed surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import ANATOMY, Array
from casadi_contact.scenes.shapes.shape import shape_named

_LEAST_MEAN_NORMAL = 0.05  # below, the elements face all ways
_LETTERS = ("x", "y", "z")
_LEAST_SHARE = 0.3  # of a unit vector, to be named among its anatomical directions


@dataclass(frozen=True, eq=False)
class PictureAxis:
    """A coordinate c = direction·p of points p, rightwards or upwards in a picture; reversed: leftwards or downwards.
    direction (3,) is a unit vector whose largest component is positive, so that an axis of the frame stays one.
    anatomical: the frame is a joint's, whose directions have names."""

    direction: Array
    reversed: bool = False
    anatomical: bool = True

    @classmethod
    def along(cls, vector: Array, *, anatomical: bool = True) -> PictureAxis:
        """The axis whose coordinate grows, or falls, rightwards or upwards, for that to be the direction `vector`."""
        unit = vector / np.linalg.norm(vector)
        backwards = bool(unit[np.abs(unit).argmax()] < 0.0)
        return cls(np.where(backwards, -unit, unit) + 0.0, backwards, anatomical)

    @property
    def formula(self) -> str:
        """x, y or z, or the sum of these that an oblique coordinate is: 0.98 x - 0.18 y."""
        return direction_formula(self.direction)

    @property
    def name(self) -> str:
        """The formula, or, of an oblique axis of a joint, where it grows towards: medial-inferior."""
        return self.formula if self.formula in _LETTERS or not self.anatomical else anatomical_name(self.direction)

    @property
    def label(self) -> str:
        """The coordinate and where it grows towards: "z, medial [mm]", or below each other for an oblique one."""
        if not self.anatomical:
            return f"{self.formula} [mm]"
        towards = anatomical_name(self.direction)
        return f"{self.name}, {towards} [mm]" if self.name in _LETTERS else f"{towards} [mm]\n{self.formula}"

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
    def along(cls, direction: Array, *, anatomical: bool = True) -> View:
        """Seen along a direction (3,); upwards is y, or x where that direction is nearer to y than to the x-z plane."""
        toward = -direction / np.linalg.norm(direction)
        rough = np.eye(3)[0 if abs(toward[1]) > np.sqrt(0.5) else 1]
        up = rough - (rough @ toward) * toward
        right, upwards, towards = (
            PictureAxis.along(vector, anatomical=anatomical) for vector in (np.cross(up, toward), up, toward)
        )
        return cls(right, upwards, towards)

    @property
    def behind(self) -> View:
        """Seen the other way, as the fixed surface sees the moving body."""
        return View.along(self.toward.pointing, anatomical=self.toward.anatomical)

    @property
    def name(self) -> str:
        """The direction that is looked along: inferior (−y) for a knee, posterior (+x) for a patella."""
        along = -self.toward.pointing
        formula = direction_formula(along)
        signed = f"+{formula}" if formula in _LETTERS else formula
        return f"{anatomical_name(along)} ({signed})" if self.toward.anatomical else signed


def view_of(model: ElasticFoundation) -> View:
    """The view along the direction of pressing: of the first patch, or, where its normal load has none, against the
    mean normal of all elements (into a hip's cup; along -y if they face all ways)."""
    direction = model.scene.normal_loads[0].direction
    if direction is None:
        grids = model.scene.elements(model.grid)
        areas = np.concatenate([grid.areas_mm2 for grid in grids])
        mean = areas @ np.concatenate([grid.normals for grid in grids]) / areas.sum()
        direction = -mean if np.linalg.norm(mean) > _LEAST_MEAN_NORMAL else np.array([0.0, -1.0, 0.0])
    return View.along(direction, anatomical=shape_named(model.scene.shape).anatomical)


def direction_formula(direction: Array) -> str:
    """A unit vector in letters: -y, or 0.98 x - 0.18 y; components below 0.005 are left out."""
    parts = ""
    for letter, value in zip(_LETTERS, direction, strict=True):
        if abs(value) < 0.005:
            continue
        sign = "−" if value < 0.0 else "+" if parts else ""
        size = "" if abs(value) > 0.9999 else f"{abs(value):.2f} "
        parts += f" {sign} {size}{letter}" if parts else f"{sign}{size}{letter}"
    return parts


def anatomical_name(direction: Array) -> str:
    """A unit vector in a joint's frame in words, its largest component first: medial-inferior."""
    order = [k for k in np.argsort(-np.abs(direction), kind="stable") if abs(direction[k]) > _LEAST_SHARE]
    return "-".join(ANATOMY[_LETTERS[k]][0 if direction[k] > 0.0 else 1] for k in order)
