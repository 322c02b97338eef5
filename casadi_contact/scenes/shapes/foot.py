"""A foot on the ground: a parametric sole, smooth to the second order, pressed by a half-space."""

from collections.abc import Callable
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import CellGrid, cell_middles
from casadi_contact.geometry.moving_surface import MovingSurface, half_space
from casadi_contact.scenes.shapes.checks import fail
from casadi_contact.scenes.shapes.shape import Geometry, Parameter, Shape

ROUNDED_MM = 10.0  # over which the flat part of a sole passes into its heel and toe
WIDEST = 0.7  # of the length: the ball of the foot


class FootOnGround(Shape):
    """A foot's sole (fixed) on the ground (moving), which fills y <= 0 of its own frame. x points forward, y up.

    The sole is flat at y = -depth between ``heel_start`` and ``toe_start`` and rises beyond as circles of
    ``heel_radius`` and ``toe_radius`` about do, and to its edges by ``edge_rise`` along a parabola. It reaches from
    ``heel_x`` to ``toe_x``, is ``heel_width`` wide behind and ``ball_width`` at the ball, and its middle line runs from
    the first to the second z of ``middle_z``.
    """

    name = "foot_on_ground"
    anatomical = False
    parameters = (
        Parameter("heel_x", "mm", low=-np.inf),
        Parameter("toe_x", "mm", low=-np.inf),
        Parameter("depth", "mm", low=-np.inf),
        Parameter("heel_width", "mm"),
        Parameter("ball_width", "mm"),
        Parameter("middle_z", "mm", low=-np.inf, count=2),
        Parameter("heel_start", "mm", low=-np.inf),
        Parameter("heel_radius", "mm"),
        Parameter("toe_start", "mm", low=-np.inf),
        Parameter("toe_radius", "mm"),
        Parameter("edge_rise", "mm", low=-1e-9),
    )

    def check(self, table: object) -> dict[str, Any]:
        """The numbers of a sole whose heel lies behind its toes."""
        values = super().check(table)
        along = [values[key] for key in ("heel_x", "heel_start", "toe_start", "toe_x")]
        if along != sorted(along) or along[0] == along[-1]:
            raise fail("geometry.heel_x, heel_start, toe_start, toe_x", along, "rising numbers [mm]")
        return values

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [half_space(-1.0)]

    def start_pose(self, geometry: Geometry) -> Array:
        return np.array([0.0, -geometry["depth"], 0.0, 0.0, 0.0, 0.0])

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        (nx, nz), low, length = grid, geometry["heel_x"], geometry["toe_x"] - geometry["heel_x"]
        x = low + length * 0.5 * (1.0 + cell_middles(nx))
        u, v = np.meshgrid(x, cell_middles(nz), indexing="ij")
        c, tangents, _ = sole_surface(geometry)(u.ravel(), v.ravel())
        N = np.cross(tangents[:, 0], tangents[:, 1])  # x forward, z right: down
        size = np.linalg.norm(N, axis=1)
        areas = (size * length / nx * 2.0 / nz).reshape(nx, nz)
        return [(c.reshape(nx, nz, 3), (N / size[:, None]).reshape(nx, nz, 3), areas)]


def sole_surface(g: Geometry) -> Callable[[Array, Array], tuple[Array, Array, Array]]:
    """(x (m,), v (m,) from -1 at the left edge to 1) -> points c = (x, y(x, v), z(x, v)) (m, 3) of a sole and their
    derivatives by x and v (m, 2, 3), (m, 2, 2, 3):

        y = -depth + s(heel_start - x)²/2R_heel + s(x - toe_start)²/2R_toe + edge_rise·v²,   s(t) = (t + √(t² + ε²))/2
        z = m(x) + v·w(x)
    """
    length = g["toe_x"] - g["heel_x"]
    toe_in = (g["middle_z"][1] - g["middle_z"][0]) / length

    def surface(x: Array, v: Array) -> tuple[Array, Array, Array]:
        y, y_x, y_xx = np.full(len(x), -g["depth"]), np.zeros(len(x)), np.zeros(len(x))
        for sign, part in ((-1.0, "heel"), (1.0, "toe")):
            t, R = sign * (x - g[f"{part}_start"]), g[f"{part}_radius"]
            root = np.sqrt(t * t + ROUNDED_MM**2)
            s, s_t, s_tt = 0.5 * (t + root), 0.5 * (1.0 + t / root), 0.5 * ROUNDED_MM**2 / root**3
            y, y_x, y_xx = y + 0.5 * s * s / R, y_x + sign * s * s_t / R, y_xx + (s_t**2 + s * s_tt) / R
        w, w_x, w_xx = _half_width(g, (x - g["heel_x"]) / length)
        w_x, w_xx = w_x / length, w_xx / length**2
        one, zero, edge = np.ones(len(x)), np.zeros(len(x)), g["edge_rise"]
        c = np.stack([x, y + edge * v**2, g["middle_z"][0] + toe_in * (x - g["heel_x"]) + v * w], 1)
        first = [[one, y_x, toe_in + v * w_x], [zero, 2.0 * edge * v, w]]
        second = [[[zero, y_xx, v * w_xx], [zero, zero, w_x]], [[zero, zero, w_x], [zero, 2.0 * edge * one, zero]]]
        return c, np.moveaxis(np.array(first), -1, 0), np.moveaxis(np.array(second), -1, 0)

    return surface


def _half_width(g: Geometry, share: Array) -> tuple[Array, Array, Array]:
    """Half of the width at shares (m,) of the length, two derivatives: a smooth step, 0.6 of it at both ends."""
    x = np.clip(share / WIDEST, 0.0, 1.0)
    step, slope = x**3 * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * (x - x * x) ** 2
    bend = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
    more = 0.5 * (g["ball_width"] - g["heel_width"])
    w, w_1, w_2 = 0.5 * g["heel_width"] + more * step, more * slope / WIDEST, more * bend / WIDEST**2
    e = 2.0 * share - 1.0
    end, end_1, end_2 = 1.0 - 0.4 * e**8, -6.4 * e**7, -89.6 * e**6
    return w * end, w_1 * end + w * end_1, w_2 * end + 2.0 * w_1 * end_1 + w * end_2
