"""A patellofemoral joint: a button, moving, that rides in an elastic groove, fixed."""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.geometry.elements import Cells, cell_middles
from casadi_contact.geometry.moving_surface import MovingSurface, swept_arcs
from casadi_contact.scenes.shapes.checks import fail
from casadi_contact.scenes.shapes.shape import Geometry, Parameter, Shape

_MOST_DEGREES = 89.0


class ButtonInGroove(Shape):
    """The groove is revolved about the fixed z axis and open towards -x, with the facets med (z > 0) and lat.

    Each facet is an arc of ``facet_radius`` in the plane through the z axis; ``facet_offset`` to the side of the
    middle it lies ``groove_radius`` from the axis and slopes by ``facet_angle_deg``. Its elements reach
    ``facet_half_width_deg`` along the arc and ``groove_half_angle_deg`` about the axis, to both sides. The button has
    its dome about its own z axis, of ``dome_sagittal_radius`` (about that axis) and ``dome_radius`` (in the planes
    through it).
    """

    name = "button_in_groove"
    parameters = (
        Parameter("groove_radius", "mm"),
        Parameter("groove_half_angle_deg", "deg", high=_MOST_DEGREES),
        Parameter("facet_radius", "mm"),
        Parameter("facet_angle_deg", "deg", high=_MOST_DEGREES),
        Parameter("facet_offset", "mm"),
        Parameter("facet_half_width_deg", "deg", high=_MOST_DEGREES),
        Parameter("dome_radius", "mm"),
        Parameter("dome_sagittal_radius", "mm"),
    )

    def check(self, table: object) -> dict[str, Any]:
        """The numbers of a dome more curved than the facets, which do not turn back."""
        values = super().check(table)
        if values["facet_radius"] <= values["dome_radius"]:
            expected = f"more than dome_radius ({values['dome_radius']:g})"
            raise fail("geometry.facet_radius", values["facet_radius"], expected)
        if values["dome_sagittal_radius"] < values["dome_radius"]:
            raise fail("geometry.dome_sagittal_radius", values["dome_sagittal_radius"], "at least dome_radius")
        if values["facet_angle_deg"] + values["facet_half_width_deg"] >= _MOST_DEGREES:
            raise fail("geometry.facet_half_width_deg", values["facet_half_width_deg"], "facets that do not turn back")
        return values

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        return ("med", "lat")

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        radii = [geometry["dome_sagittal_radius"]]
        return [swept_arcs(radii, [], geometry["dome_radius"], 0.0)] * 2

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
        return [_facet(geometry, side, *grid) for side in (1.0, -1.0)]


def _facet(g: Geometry, side: float, nx: int, nz: int) -> Cells:
    """One facet of the groove, on the side z > 0 (1) or z < 0 (-1): cells equal in both angles, by the midpoint rule.
    The facet's arc about (ρ_c, z_c) in the plane of ρ (distance from the z axis) and z: ρ = ρ_c - R·cos α, z =
    side·(z_c + R·sin α), with α the facet's slope; the normal points to the arc's centre."""
    slope, radius = np.deg2rad(g["facet_angle_deg"]), g["facet_radius"]
    rho_centre = g["groove_radius"] + radius * np.cos(slope)
    z_centre = g["facet_offset"] - radius * np.sin(slope)
    spread, reach = np.deg2rad(g["facet_half_width_deg"]), np.deg2rad(g["groove_half_angle_deg"])
    about, alpha = np.meshgrid(reach * cell_middles(nx), slope + spread * cell_middles(nz), indexing="ij")
    rho = rho_centre - radius * np.cos(alpha)
    centres = np.stack([-rho * np.cos(about), rho * np.sin(about), side * (z_centre + radius * np.sin(alpha))], axis=-1)
    normals = np.stack([-np.cos(alpha) * np.cos(about), np.cos(alpha) * np.sin(about), -side * np.sin(alpha)], axis=-1)
    return centres, normals, rho * radius * (2.0 * reach / nx) * (2.0 * spread / nz)
