"""A hip or a shoulder: a ball, moving, in an elastic spherical cup, fixed."""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import Cells, cell_middles
from casadi_contact.geometry.moving_surface import MovingSurface, sphere
from casadi_contact.scenes.shapes.checks import fail
from casadi_contact.scenes.shapes.shape import Geometry, Parameter, Shape

MOST_DEGREES = 89.0


class BallInCup(Shape):
    """A ball about the moving origin; the cup's deepest point lies from ``cup_centre`` along ``cup_pole``, and it
    reaches ``cup_half_angle_deg`` to every side of it."""

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

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
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
        pole, first, second = _frame(np.asarray(g["cup_pole"]))
        outward = (
            np.cos(theta)[..., None] * pole
            + (np.sin(theta) * np.cos(phi))[..., None] * first
            + (np.sin(theta) * np.sin(phi))[..., None] * second
        )
        area = 2.0 * np.pi * g["cup_radius"] ** 2 * (1.0 - np.cos(half)) / (nx * nz)
        return [(np.asarray(g["cup_centre"]) + g["cup_radius"] * outward, -outward, np.full((nx, nz), area))]


def _frame(pole: Array) -> tuple[Array, Array, Array]:
    """A right-handed orthonormal frame whose first vector points along pole."""
    pole = pole / np.linalg.norm(pole)
    least = np.eye(3)[np.abs(pole).argmin()]
    first = np.cross(least, pole)
    first /= np.linalg.norm(first)
    return pole, first, np.cross(pole, first)
