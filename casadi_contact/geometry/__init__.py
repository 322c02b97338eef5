"""Geometry: the moving body's surface as a smooth signed distance, the fixed body's surface as elements; meshes."""

from casadi_contact.geometry.elements import ElementGrid
from casadi_contact.geometry.mesh import load_mesh
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.geometry.triangle_mesh import TriangleMesh

__all__ = ["ElementGrid", "MovingSurface", "TriangleMesh", "load_mesh"]
