"""Geometry: the moving body's surface as a smooth signed distance, the fixed body's surface as elements."""

from casadi_contact.geometry.elements import ElementGrid, build_elements
from casadi_contact.geometry.surfaces import MovingSurface, build_surfaces

__all__ = ["ElementGrid", "MovingSurface", "build_elements", "build_surfaces"]
