"""Cubic cells: any two surfaces with several spots of contact, the gap interpolated between nodes."""

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation

__all__ = ["CellFoundation", "Cells"]
