"""Contact models: pose of the moving body in, loads on the fixed body out."""

from casadi_contact.contact.callable_model import CallableModel
from casadi_contact.contact.cells import CellFoundation, Cells
from casadi_contact.contact.choice import foundation, foundation_ladder
from casadi_contact.contact.convergence import NotGoodEnoughError
from casadi_contact.contact.cup import CupFoundation
from casadi_contact.contact.elements import ElasticFoundation, grid_text
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.polar import PolarFoundation, Rays
from casadi_contact.contact.pressure.summary import PressureSummary
from casadi_contact.contact.ray_cast import RayCastFoundation
from casadi_contact.contact.symbolic import SymbolicContact, symbolic

__all__ = [
    "CallableModel",
    "CellFoundation",
    "Cells",
    "ContactModel",
    "CupFoundation",
    "ElasticFoundation",
    "NotGoodEnoughError",
    "PolarFoundation",
    "PressureSummary",
    "RayCastFoundation",
    "Rays",
    "SymbolicContact",
    "foundation",
    "foundation_ladder",
    "grid_text",
    "symbolic",
]
