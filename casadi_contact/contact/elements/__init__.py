"""The elastic foundation as a sum over flat elements: numba's loops, and C for the parametric shapes."""

from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text

__all__ = ["ElasticFoundation", "grid_text"]
