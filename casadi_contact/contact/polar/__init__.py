"""Polar quadrature: smooth surfaces with one spot of contact a patch, integrated on rays from the spot's middle."""

from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.rays import Rays

__all__ = ["PolarFoundation", "Rays"]
