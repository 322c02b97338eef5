"""Shapes: one record for each, from the checks of its [geometry] to its surfaces and elements."""

from casadi_contact.shapes.registry import SHAPES, register, shape_named
from casadi_contact.shapes.shape import Parameter, Shape

__all__ = ["SHAPES", "Parameter", "Shape", "register", "shape_named"]
