"""Polar quadrature: smooth surfaces with one spot of contact a patch, and another on its rim, integrated on rays."""

from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.rays import Rays

__all__ = ["PolarFoundation", "Rays"]
