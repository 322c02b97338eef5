"""The record of a shape: its [geometry], its patches, its moving surface and the elements of its fixed one.

A scene names its shape. What only this shape has stands in its record, which the code for all shapes reads. A new
shape is a record and a line in `_MODULES`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import CellGrid, ElementGrid, grid_elements
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.scenes.shapes.checks import fail, identifier, number, numbers, table_of

Geometry = Mapping[str, Any]


@dataclass(frozen=True)
class Parameter:
    """A number in a shape's [geometry], low < number < high, in its unit; or a list of `count` of these (None: any)."""

    name: str
    unit: str
    low: float = 0.0
    high: float = math.inf
    count: int | None = 1

    def check(self, value: object) -> float | list[float]:
        """The value as floats; raises ValueError with the parameter's name."""
        key, bounds = f"geometry.{self.name}", {"low": self.low, "high": self.high}
        if self.count == 1:
            return number(key, value, **bounds)
        return numbers(key, value, self.count, self.unit, **bounds)


class Shape(ABC):
    """A family of joints that differ in their [geometry] only. has_layer: it is in contact through an elastic layer on
    its own elements, so that its scenes need [material] and [grids]. anatomical: its axes are those of
    `conventions.ANATOMY`. mesh_bodies: those of its two bodies, "moving" and "fixed", that are meshes."""

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    has_layer: ClassVar[bool] = True
    anatomical: ClassVar[bool] = True
    mesh_bodies: ClassVar[tuple[str, ...]] = ()

    def check(self, table: object) -> dict[str, Any]:
        """The complete [geometry] with its numbers checked; raises ValueError naming the key at fault."""
        values = table_of("geometry", table, tuple(p.name for p in self.parameters), complete=True)
        return {parameter.name: parameter.check(values[parameter.name]) for parameter in self.parameters}

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        """Names of the patches, in order."""
        return ("contact",)

    def patch_geometry(self, geometry: Geometry, patch: str) -> dict[str, Any]:
        """The numbers that hold for one patch."""
        return dict(geometry)

    def anchors(self, geometry: Geometry) -> Array:
        """Anchor of each patch on the moving body (patches, 3) [mm]: its origin unless the shape says otherwise."""
        return np.zeros((len(self.patches(geometry)), 3))

    def start_pose(self, geometry: Geometry) -> Array:
        """A pose (6,) from which the moving body can be brought into contact."""
        return np.zeros(6)

    def symmetric(self, geometry: Geometry) -> bool:
        """True where the joint has two patches that mirror each other in the plane z = 0."""
        return False

    @abstractmethod
    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        """The moving surface that faces each patch, in patch order."""

    @abstractmethod
    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        """The fixed surface of each patch in (nx, nz) cells, in patch order."""

    def elements(self, geometry: Geometry, grid: tuple[int, int]) -> list[ElementGrid]:
        """The elements of each patch, in patch order."""
        return [grid_elements(*cells) for cells in self.cells(geometry, grid)]

    def thickness_at(self, geometry: Geometry, points_mm: Array, normals: Array) -> Array | None:
        """Thickness (n,) [mm] of the fixed layer under points with normals (n, 3); None where [material] has it."""
        return None

    def locate_files(self, geometry: Geometry, folder: Path) -> Geometry:
        """The [geometry] of a scene file in `folder` with what it names there; the same where it names no files."""
        return geometry

    def identity(self, geometry: Geometry) -> Geometry:
        """The [geometry] without what may differ between copies of one scene: places of files."""
        return geometry


_MODULES = {
    "knee": "knee.Knee",
    "ball_in_cup": "closed_forms.BallInCup",
    "button_in_groove": "closed_forms.ButtonInGroove",
    "sphere_on_plane": "closed_forms.SphereOnPlane",
    "sphere_in_dish": "closed_forms.SphereInDish",
    "cylinder_on_plane": "closed_forms.CylinderOnPlane",
    "punch_on_plane": "closed_forms.PunchOnPlane",
    "foot_on_ground": "foot.FootOnGround",
    "own_model": "shape.OwnModel",
    "mesh": "mesh.Mesh",
    "mesh_on_ground": "mesh.MeshOnGround",
}
SHAPES: dict[str, Shape] = {}
"""Shapes that are loaded, by name."""


def register(shape: Shape) -> None:
    """Make a shape known to scenes by its name; raises ValueError for a name that is taken."""
    if shape.name in {*SHAPES, *_MODULES}:
        raise ValueError(f"the shape {shape.name} is registered already, expected another name")
    SHAPES[shape.name] = shape


def shape_named(name: object) -> Shape:
    """The shape of this name; raises ValueError, naming the known ones."""
    if not isinstance(name, str) or name not in {*SHAPES, *_MODULES}:
        known = ", ".join(dict.fromkeys((*_MODULES, *SHAPES)))
        raise ValueError(f"scene: shape = {name!r}, expected one of {known}")
    if name not in SHAPES:
        module, _, kind = _MODULES[name].partition(".")
        SHAPES[name] = getattr(import_module(f"casadi_contact.scenes.shapes.{module}"), kind)()
    return SHAPES[name]


class OwnModel(Shape):
    """The shape of a scene without geometry: its contact model is the user's own, or a table of samples.

        shape = "own_model"
        [geometry.patches]     each with its anchor on the moving body [mm], the body's origin if left out
        contact = { anchor = [0.0, 0.0, 0.0] }

    Such a scene needs neither [material] nor [grids].
    """

    name = "own_model"
    has_layer = False

    def check(self, table: object) -> dict[str, Any]:
        values = table_of("geometry", table, ("patches",), complete=True)
        patches = values["patches"]
        if not isinstance(patches, Mapping) or not patches:
            expected = "a table for each patch, e.g. contact = { anchor = [0.0, 0.0, 0.0] }"
            raise fail("geometry.patches", patches, expected)
        for name, patch in patches.items():
            identifier("geometry.patches (a patch's name)", name)
            if "_" in name:
                raise fail("geometry.patches (a patch's name)", name, "a name without _, which sets it off in Fy_med")
            key = f"geometry.patches.{name}"
            given = table_of(key, patch, (), complete=False, optional=("anchor",))
            numbers(f"{key}.anchor", given.get("anchor", [0.0] * 3), 3, "mm")
        return values

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        return tuple(geometry["patches"])

    def anchors(self, geometry: Geometry) -> Array:
        return patch_anchors(geometry)

    def surfaces(self, geometry: Geometry) -> NoReturn:
        raise ValueError("a scene of the shape own_model has no surfaces: give your own contact model")

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> NoReturn:
        self.surfaces(geometry)


def patch_anchors(geometry: Geometry) -> Array:
    """The anchors (patches, 3) [mm] that [geometry.patches] names, the moving body's origin if left out."""
    return np.array([patch.get("anchor", [0.0, 0.0, 0.0]) for patch in geometry["patches"].values()], dtype=float)
