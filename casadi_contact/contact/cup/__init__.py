"""A ball in a spherical cup: quadrature over one angle, the rest in closed form."""

from casadi_contact.contact.cup.foundation import CupFoundation

__all__ = ["CupFoundation"]
