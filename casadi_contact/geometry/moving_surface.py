"""Surfaces of the moving body as smooth signed distances, in the moving frame: negative inside the body.

Three analytic families cover the parametric shapes, each the exact distance from a convex body where it is not deeper
than its least radius, and so a convex function there, which the elastic foundation's culling relies on:

* swept arcs: a circle of radius r_f swept along tangent-continuous sagittal arcs of radii R_i about axes parallel
  to z: g = √((ρ_i - (R_i - r_f))² + (z - z_0)²) - r_f, with ρ_i the distance to axis i. Each arc is a torus piece;
  one arc with R = r_f is a sphere. Arcs follow one another from anterior (-x) to posterior (+x); polar angle φ is
  measured from -y towards +x, so that φ is the flexion at which that point of the condyle faces the insert.
* cylinder of radius R about the z axis: g = √(x² + y²) - R.
* half-space y >= 0 (flat punch): g = -y; or y <= 0 (the ground): g = y.

The fourth is the distance field of a mesh (`geometry.distance_field`), not convex: culling there relies on its slope.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array

SWEPT_ARCS, CYLINDER, HALF_SPACE, MESH_FIELD = 0, 1, 2, 3
NUMBERS_PER_ARC = 5  # of swept arcs: axis x, y; tube offset R - r_f; end tangent x, y


@dataclass(frozen=True)
class MovingSurface:
    """One smooth surface of the moving body: its family and the family's parameters, as the kernels read them."""

    family: int
    parameters: Array


def swept_arcs(
    sagittal_radii: ArrayLike, junctions_rad: ArrayLike, frontal_radius: float, centre_z: float
) -> MovingSurface:
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


def sphere(radius: float) -> MovingSurface:
    """A sphere about the moving origin."""
    return swept_arcs([radius], [], radius, 0.0)


def cylinder(radius: float) -> MovingSurface:
    """A cylinder about the moving z axis."""
    return MovingSurface(CYLINDER, np.array([radius]))


def half_space(side: float = 1.0) -> MovingSurface:
    """All that lies at y >= 0 of the moving frame, a flat punch larger than any patch; of the side -1, at y <= 0."""
    return MovingSurface(HALF_SPACE, np.array([side]))
