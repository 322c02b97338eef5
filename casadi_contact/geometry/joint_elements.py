"""Element centres, normals and areas of the parametric joints' fixed surfaces (see `scenes.joint_shapes`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from casadi_contact.conventions import Array

Patch = tuple[Array, Array, Array]


def joint_elements(shape: str, geometry: Mapping[str, Any], grid: tuple[int, int]) -> list[Patch]:
    """Centres (nx, nz, 3), unit normals (nx, nz, 3) and areas (nx, nz) of each patch, in patch order."""
    if shape == "ball_in_cup":
        return [_cup(geometry, *grid)]
    return [_facet(geometry, side, *grid) for side in (1.0, -1.0)]


def _middles(count: int) -> Array:
    """Middles of `count` equal cells of [-1, 1]."""
    return (2.0 * np.arange(count) + 1.0) / count - 1.0


def _cup(g: Mapping[str, Any], nx: int, nz: int) -> Patch:
    """A spherical cap in cells of equal area, whose outermost rows and columns are its rim.

    The square's cells go to a disc (Shirley and Chiu 1997: concentric squares become circles) and from there to the
    sphere (Lambert: sin(θ/2) grows with the disc's radius); both keep areas.
    """
    u, v = np.meshgrid(_middles(nx), _middles(nz), indexing="ij")
    along_u = np.abs(u) > np.abs(v)
    r = np.where(along_u, u, v)
    safe = np.where(r == 0.0, 1.0, r)
    phi = np.where(along_u, 0.25 * np.pi * v / safe, 0.5 * np.pi - 0.25 * np.pi * u / safe)
    half = np.deg2rad(g["cup_half_angle_deg"])
    theta = 2.0 * np.arcsin(r * np.sin(0.5 * half))
    pole, first, second = _frame(np.asarray(g["cup_pole"]))
    outward = (
        np.cos(theta)[..., None] * pole
        + (np.sin(theta) * np.cos(phi))[..., None] * first
        + (np.sin(theta) * np.sin(phi))[..., None] * second
    )
    area = 2.0 * np.pi * g["cup_radius"] ** 2 * (1.0 - np.cos(half)) / (nx * nz)
    return np.asarray(g["cup_centre"]) + g["cup_radius"] * outward, -outward, np.full((nx, nz), area)


def _frame(pole: Array) -> tuple[Array, Array, Array]:
    """A right-handed orthonormal frame whose first vector points along pole."""
    pole = pole / np.linalg.norm(pole)
    helper = np.eye(3)[np.abs(pole).argmin()]
    first = np.cross(helper, pole)
    first /= np.linalg.norm(first)
    return pole, first, np.cross(pole, first)


def _facet(g: Mapping[str, Any], side: float, nx: int, nz: int) -> Patch:
    """One facet of the groove, on the side z > 0 (1) or z < 0 (-1): cells equal in both angles, by the midpoint rule.

    The facet's arc about (ρ_c, z_c) in the plane of ρ (distance from the z axis) and z: ρ = ρ_c - R·cos α,
    z = side·(z_c + R·sin α), with α the facet's slope; the normal points to the arc's centre.
    """
    slope, radius = np.deg2rad(g["facet_angle_deg"]), g["facet_radius"]
    rho_centre = g["groove_radius"] + radius * np.cos(slope)
    z_centre = g["facet_offset"] - radius * np.sin(slope)
    spread, reach = np.deg2rad(g["facet_half_width_deg"]), np.deg2rad(g["groove_half_angle_deg"])
    about, alpha = np.meshgrid(reach * _middles(nx), slope + spread * _middles(nz), indexing="ij")
    rho = rho_centre - radius * np.cos(alpha)
    centres = np.stack([-rho * np.cos(about), rho * np.sin(about), side * (z_centre + radius * np.sin(alpha))], axis=-1)
    normals = np.stack([-np.cos(alpha) * np.cos(about), np.cos(alpha) * np.sin(about), -side * np.sin(alpha)], axis=-1)
    return centres, normals, rho * radius * (2.0 * reach / nx) * (2.0 * spread / nz)
