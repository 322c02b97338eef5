"""Signed distances of the moving surfaces, and pressures, for tensors of points: `geometry.surfaces` and
`pressure_laws` once more, in torch."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch

from casadi_contact.geometry import MovingSurface
from casadi_contact.geometry.moving_surface import CYLINDER, HALF_SPACE, NUMBERS_PER_ARC, SWEPT_ARCS
from casadi_contact.pressure_laws import TANGENT_STRAIN

FAMILIES = (SWEPT_ARCS, CYLINDER, HALF_SPACE)
_TINY_MM = 1e-12

Vector = Sequence[torch.Tensor]  # x, y and z, each a tensor of one shape


def signed_distance(surface: MovingSurface, q: Vector) -> tuple[torch.Tensor, Vector]:
    """g(q) [mm] and its gradient at points of the moving frame."""
    x, y, z = q
    if surface.family == SWEPT_ARCS:
        return _swept_arcs(surface.parameters.tolist(), x, y, z)
    if surface.family == CYLINDER:
        rho = torch.sqrt(x * x + y * y).clamp(min=_TINY_MM)
        return rho - float(surface.parameters[0]), (x / rho, y / rho, torch.zeros_like(z))
    return -y, (torch.zeros_like(x), torch.full_like(y, -1.0), torch.zeros_like(z))


def _swept_arcs(
    parameters: list[float], x: torch.Tensor, y: torch.Tensor, z: torch.Tensor
) -> tuple[torch.Tensor, Vector]:
    count, radius, centre_z = int(parameters[0]), parameters[1], parameters[2]
    arcs = [parameters[3 + NUMBERS_PER_ARC * k :][:NUMBERS_PER_ARC] for k in range(count)]
    dx, dy, tube = x - arcs[0][0], y - arcs[0][1], torch.full_like(x, arcs[0][2])
    beyond = torch.ones_like(x, dtype=torch.bool)
    for (_, _, _, end_x, end_y), (axis_x, axis_y, offset, _, _) in pairwise(arcs):
        beyond = beyond & (dx * end_x + dy * end_y > 0.0)
        dx, dy = torch.where(beyond, x - axis_x, dx), torch.where(beyond, y - axis_y, dy)
        tube = torch.where(beyond, offset, tube)
    dz = z - centre_z
    rho = torch.sqrt(dx * dx + dy * dy).clamp(min=_TINY_MM)
    out = rho - tube
    distance = torch.sqrt(out * out + dz * dz).clamp(min=_TINY_MM)
    scale = out / (distance * rho)
    return distance - radius, (scale * dx, scale * dy, dz / distance)


def linear(modulus: float, thickness: float, depth: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """p = K·d/h [MPa] and dp/dd [MPa/mm] at depths d > 0 [mm]."""
    slope = modulus / thickness
    return slope * depth, torch.full_like(depth, slope)


def logarithmic(modulus: float, thickness: float, depth: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """p = -K·ln(1 - d/h) [MPa] and dp/dd [MPa/mm], along the tangent from `TANGENT_STRAIN` on."""
    strain = (depth / thickness).clamp(max=TANGENT_STRAIN)
    slope = modulus / (thickness * (1.0 - strain))
    return slope * (depth - strain * thickness) - modulus * torch.log1p(-strain), slope


LAWS = {"linear": linear, "log": logarithmic}
