"""Joints and test bodies of spheres, arcs and planes: a ball in a cup, a button in a groove, and bodies of closed-form
contact on an elastic plane y = 0 or in a dish, to verify contact models."""

import math
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import CellGrid, cell_middles, dish, plane, tangents
from casadi_contact.geometry.moving_surface import MovingSurface, cylinder, half_space, sphere, swept_arcs
from casadi_contact.scenes.shapes.checks import fail
from casadi_contact.scenes.shapes.shape import Geometry, Parameter, Shape

MOST_DEGREES = 89.0


class BallInCup(Shape):
    """A hip or a shoulder: a ball about the moving origin in an elastic cup, whose deepest point lies from
    ``cup_centre`` along ``cup_pole``; it reaches ``cup_half_angle_deg`` to every side of it."""

    name = "ball_in_cup"
    parameters = (
        Parameter("ball_radius", "mm"),
        Parameter("cup_radius", "mm"),
        Parameter("cup_half_angle_deg", "deg", high=MOST_DEGREES),
        Parameter("cup_pole", "mm", low=-np.inf, count=3),
        Parameter("cup_centre", "mm", low=-np.inf, count=3),
    )

    def check(self, table: object) -> dict[str, Any]:
        """The numbers of a ball that fits into its cup, whose pole is a direction."""
        values = super().check(table)
        if values["cup_radius"] <= values["ball_radius"]:
            expected = f"more than ball_radius ({values['ball_radius']:g})"
            raise fail("geometry.cup_radius", values["cup_radius"], expected)
        if not np.linalg.norm(values["cup_pole"]) > 0.0:
            raise fail("geometry.cup_pole", values["cup_pole"], "a direction, not zero")
        return values

    def start_pose(self, geometry: Geometry) -> Array:
        return np.array([*geometry["cup_centre"], 0.0, 0.0, 0.0])

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [sphere(geometry["ball_radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        """A spherical cap in cells of equal area, whose outermost rows and columns are its rim. The square's cells go
        to a disc (Shirley and Chiu 1997: concentric squares become circles) and from there to the sphere (Lambert:
        sin(θ/2) grows with the disc's radius); both keep areas."""
        g, (nx, nz) = geometry, grid
        u, v = np.meshgrid(cell_middles(nx), cell_middles(nz), indexing="ij")
        along_u = np.abs(u) > np.abs(v)
        r = np.where(along_u, u, v)
        safe = np.where(r == 0.0, 1.0, r)
        phi = np.where(along_u, 0.25 * np.pi * v / safe, 0.5 * np.pi - 0.25 * np.pi * u / safe)
        half = np.deg2rad(g["cup_half_angle_deg"])
        theta = 2.0 * np.arcsin(r * np.sin(0.5 * half))
        pole = np.array(g["cup_pole"]) / np.linalg.norm(g["cup_pole"])
        first, second = tangents(pole)
        ring = np.cos(phi)[..., None] * first + np.sin(phi)[..., None] * second
        outward = np.cos(theta)[..., None] * pole + np.sin(theta)[..., None] * ring
        area = 2.0 * np.pi * g["cup_radius"] ** 2 * (1.0 - np.cos(half)) / (nx * nz)
        return [(np.asarray(g["cup_centre"]) + g["cup_radius"] * outward, -outward, np.full((nx, nz), area))]


class ButtonInGroove(Shape):
    """A patellofemoral joint: a button in an elastic groove, revolved about z, open to -x, facets med (z > 0), lat.

    Each facet is an arc of ``facet_radius`` in the plane through the z axis; ``facet_offset`` to the side of the
    middle it lies ``groove_radius`` from the axis and slopes by ``facet_angle_deg``. Its elements reach
    ``facet_half_width_deg`` along the arc and ``groove_half_angle_deg`` about the axis, to both sides. The button has
    its dome about its own z axis, of ``dome_sagittal_radius`` (about that axis) and ``dome_radius`` (in the planes
    through it).
    """

    name = "button_in_groove"
    parameters = (
        Parameter("groove_radius", "mm"),
        Parameter("groove_half_angle_deg", "deg", high=MOST_DEGREES),
        Parameter("facet_radius", "mm"),
        Parameter("facet_angle_deg", "deg", high=MOST_DEGREES),
        Parameter("facet_offset", "mm"),
        Parameter("facet_half_width_deg", "deg", high=MOST_DEGREES),
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
        if values["facet_angle_deg"] + values["facet_half_width_deg"] >= MOST_DEGREES:
            raise fail("geometry.facet_half_width_deg", values["facet_half_width_deg"], "facets that do not turn back")
        return values

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        return ("med", "lat")

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        radii = [geometry["dome_sagittal_radius"]]
        return [swept_arcs(radii, [], geometry["dome_radius"], 0.0)] * 2

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        return [_facet(geometry, side, *grid) for side in (1.0, -1.0)]


def _facet(g: Geometry, side: float, nx: int, nz: int) -> CellGrid:
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


class SphereOnPlane(Shape):
    """A sphere about the moving origin on a square of elements."""

    name = "sphere_on_plane"
    anatomical = False
    parameters = (Parameter("radius", "mm"), Parameter("patch_side", "mm"))

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [sphere(geometry["radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        return [plane(grid, (geometry["patch_side"], geometry["patch_side"]))]


class CylinderOnPlane(Shape):
    """A cylinder about the moving z axis on a strip, patch_side along x and length along z."""

    name = "cylinder_on_plane"
    anatomical = False
    parameters = (Parameter("radius", "mm"), Parameter("length", "mm"), Parameter("patch_side", "mm"))

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [cylinder(geometry["radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        return [plane(grid, (geometry["patch_side"], geometry["length"]))]


class PunchOnPlane(Shape):
    """A flat punch, the moving half-space y >= 0, on a square of the given area."""

    name = "punch_on_plane"
    anatomical = False
    parameters = (Parameter("area", "mm²"),)

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [half_space()]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        side = geometry["area"] ** 0.5
        return [plane(grid, (side, side))]


class SphereInDish(Shape):
    """A sphere about the moving origin in a dish, lowest at the fixed origin, over a square of elements."""

    name = "sphere_in_dish"
    anatomical = False
    parameters = (Parameter("radius", "mm"), Parameter("dish_radius", "mm"), Parameter("patch_side", "mm"))

    def check(self, table: object) -> dict[str, Any]:
        """The numbers of a sphere and a patch that lie inside the dish."""
        values = super().check(table)
        limit = max(values["radius"], values["patch_side"] / math.sqrt(2.0))
        if values["dish_radius"] <= limit:
            raise fail("geometry.dish_radius", values["dish_radius"], f"more than {limit:g} (sphere, half patch)")
        return values

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [sphere(geometry["radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        radius, side = geometry["dish_radius"], geometry["patch_side"]
        return [dish(grid, (side, side), radius, radius)]
