"""Surfaces of the moving body as smooth signed distances, in the moving frame: negative inside the body.

Three analytic families cover the parametric scenes, each the exact distance from a convex body and so a convex
function, which the elastic foundation's culling relies on:

* swept arcs: a circle of radius r_f swept along tangent-continuous sagittal arcs of radii R_i about axes parallel
  to z: g = √((ρ_i - (R_i - r_f))² + (z - z_0)²) - r_f, with ρ_i the distance to axis i. Each arc is a torus piece;
  one arc with R = r_f is a sphere. Arcs follow one another from anterior (-x) to posterior (+x); polar angle φ is
  measured from -y towards +x, so that φ is the flexion at which that point of the condyle faces the insert.
* cylinder of radius R about the z axis: g = √(x² + y²) - R.
* half-space y >= 0 (flat punch): g = -y.

The fourth is the distance field of a mesh (`geometry.distance_field`), not convex: culling there relies on its slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import field_distance, field_value
from casadi_contact.geometry.mesh_bodies import body_field
from casadi_contact.scenes import Scene

SWEPT_ARCS, CYLINDER, HALF_SPACE, MESH_FIELD = 0, 1, 2, 3
_ARC = 5  # numbers per arc in the parameters of swept arcs: axis x, y; tube offset R - r_f; end tangent x, y


@dataclass(frozen=True)
class MovingSurface:
    """One smooth surface of the moving body: its family and the family's parameters, as the kernels read them."""

    family: int
    parameters: Array


def swept_arcs(sagittal_radii: Array, junctions_rad: Array, frontal_radius: float, centre_z: float) -> MovingSurface:
    """Condyle of tangent-continuous arcs; the second arc (or the only one) has its axis at the moving origin."""
    radii = np.asarray(sagittal_radii, dtype=float)
    junctions = np.asarray(junctions_rad, dtype=float)
    normals = np.stack([np.sin(junctions), -np.cos(junctions)], axis=-1)
    tangents = np.stack([np.cos(junctions), np.sin(junctions)], axis=-1)
    # Neighbouring arcs share the normal at their junction: c_{i+1} = c_i + (R_i - R_{i+1})·e(φ_i).
    axes = np.zeros((len(radii), 2))
    for i, normal in enumerate(normals):
        axes[i + 1] = axes[i] + (radii[i] - radii[i + 1]) * normal
    axes -= axes[min(1, len(radii) - 1)]
    ends = np.vstack([tangents, np.zeros((1, 2))])
    arcs = np.column_stack([axes, radii - frontal_radius, ends])
    return MovingSurface(SWEPT_ARCS, np.concatenate([[len(radii), frontal_radius, centre_z], arcs.ravel()]))


def build_surfaces(scene: Scene) -> list[MovingSurface]:
    """The moving surface that faces each patch of the scene, in patch order."""
    if scene.shape == "mesh":
        field = body_field(scene, "moving")
        return [MovingSurface(MESH_FIELD, field.parameters)] * len(scene.patch_names)
    if scene.shape == "knee":
        surfaces = []
        for side, anchor in zip(scene.patch_names, scene.anchors_mm, strict=True):
            g = scene.geometry_of(side)
            junctions = np.deg2rad(g["sagittal_junctions_deg"])
            surfaces.append(swept_arcs(g["sagittal_radii"], junctions, g["frontal_radius"], anchor[2]))
        return surfaces
    if scene.shape == "cylinder_on_plane":
        return [MovingSurface(CYLINDER, np.array([scene.geometry["radius"]]))]
    if scene.shape == "punch_on_plane":
        return [MovingSurface(HALF_SPACE, np.zeros(1))]
    if scene.shape == "button_in_groove":
        dome = swept_arcs(
            np.array([scene.geometry["dome_sagittal_radius"]]), np.zeros(0), scene.geometry["dome_radius"], 0.0
        )
        return [dome for _ in scene.patch_names]
    radius = scene.geometry["ball_radius" if scene.shape == "ball_in_cup" else "radius"]
    return [swept_arcs(np.array([radius]), np.zeros(0), radius, 0.0)]


@numba.njit(cache=True, inline="always")
def signed_distance(family, parameters, x, y, z):
    """g(q) and its gradient (g, gx, gy, gz) at the point q = (x, y, z) of the moving frame."""
    if family == SWEPT_ARCS:
        last = int(parameters[0]) - 1
        radius = parameters[1]
        arc = 0
        base = 3
        dx = x - parameters[base]
        dy = y - parameters[base + 1]
        while arc < last and dx * parameters[base + 3] + dy * parameters[base + 4] > 0.0:
            arc += 1
            base += _ARC
            dx = x - parameters[base]
            dy = y - parameters[base + 1]
        dz = z - parameters[2]
        rho = max(np.sqrt(dx * dx + dy * dy), 1e-12)
        out = rho - parameters[base + 2]
        distance = max(np.sqrt(out * out + dz * dz), 1e-12)
        scale = out / (distance * rho)
        return distance - radius, scale * dx, scale * dy, dz / distance
    if family == CYLINDER:
        rho = max(np.sqrt(x * x + y * y), 1e-12)
        return rho - parameters[0], x / rho, y / rho, 0.0
    if family == MESH_FIELD:
        return field_distance(parameters, x, y, z)
    return -y, 0.0, -1.0, 0.0


@numba.njit(cache=True, inline="always")
def signed_distance_value(family, parameters, x, y, z):
    """g(q) alone."""
    if family == MESH_FIELD:
        return field_value(parameters, x, y, z)
    return signed_distance(family, parameters, x, y, z)[0]
