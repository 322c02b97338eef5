"""The shapes there are, by name: a new shape is its own file and a line here.

A shape's module is imported when a scene first names it, so that a scene of one shape loads no other.
"""

from __future__ import annotations

from importlib import import_module

from casadi_contact.scenes.shapes.shape import Shape

_MODULES = {
    "knee": "knee.Knee",
    "ball_in_cup": "ball_in_cup.BallInCup",
    "button_in_groove": "button_in_groove.ButtonInGroove",
    "sphere_on_plane": "bodies_on_plane.SphereOnPlane",
    "sphere_in_dish": "sphere_in_dish.SphereInDish",
    "cylinder_on_plane": "bodies_on_plane.CylinderOnPlane",
    "punch_on_plane": "bodies_on_plane.PunchOnPlane",
    "own_model": "own_model.OwnModel",
    "mesh": "mesh.Mesh",
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
