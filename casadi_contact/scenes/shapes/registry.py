"""The shapes there are, by name: a new shape is its own file and a line here."""

from __future__ import annotations

from casadi_contact.scenes.shapes.ball_in_cup import BallInCup
from casadi_contact.scenes.shapes.bodies_on_plane import CylinderOnPlane, PunchOnPlane, SphereOnPlane
from casadi_contact.scenes.shapes.button_in_groove import ButtonInGroove
from casadi_contact.scenes.shapes.knee import Knee
from casadi_contact.scenes.shapes.mesh import Mesh
from casadi_contact.scenes.shapes.own_model import OwnModel
from casadi_contact.scenes.shapes.shape import Shape
from casadi_contact.scenes.shapes.sphere_in_dish import SphereInDish

SHAPES: dict[str, Shape] = {}


def register(shape: Shape) -> None:
    """Make a shape known to scenes by its name; raises ValueError for a name that is taken."""
    if shape.name in SHAPES:
        raise ValueError(f"the shape {shape.name} is registered already, expected another name")
    SHAPES[shape.name] = shape


def shape_named(name: object) -> Shape:
    """The shape of this name; raises ValueError, naming the known ones."""
    if not isinstance(name, str) or name not in SHAPES:
        raise ValueError(f"scene: shape = {name!r}, expected one of {', '.join(SHAPES)}")
    return SHAPES[name]


for _shape in (
    Knee(),
    BallInCup(),
    ButtonInGroove(),
    SphereOnPlane(),
    SphereInDish(),
    CylinderOnPlane(),
    PunchOnPlane(),
    OwnModel(),
    Mesh(),
):
    register(_shape)
