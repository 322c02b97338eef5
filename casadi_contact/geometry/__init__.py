"""Geometry: the moving body's surface as a smooth signed distance, the fixed body's surface as elements."""

from casadi_contact.geometry.distance_field import DistanceField, build_field
from casadi_contact.geometry.elements import ElementGrid, build_elements, build_part_elements
from casadi_contact.geometry.mesh import TriangleMesh, load_mesh
from casadi_contact.geometry.mesh_bodies import body_field, body_mesh
from casadi_contact.geometry.surfaces import MovingSurface, build_surfaces

__all__ = [
    "DistanceField",
    "ElementGrid",
    "MovingSurface",
    "TriangleMesh",
    "body_field",
    "body_mesh",
    "build_elements",
    "build_field",
    "build_part_elements",
    "build_surfaces",
    "load_mesh",
]
