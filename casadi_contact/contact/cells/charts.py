"""Charts of fixed surfaces: points, normals and their derivatives over coordinates (u, v) [mm].

A surface lies at the height h(u, v) along the lines of a projection (`geometry.projection`). A mesh is seen from where
the moving body comes (`mesh_chart`), a spherical cup from its centre; a plane is its own chart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.projection import DOWN, CentralProjection, Lines, ParallelProjection, grid_frame
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class Surface:
    """Of m points: c (m, 3), unit normal n outwards (m, 3) and their derivatives by u and v (m, 2, 3); known (m,) is
    False where the surface was continued beyond its rim."""

    c: Array
    n: Array
    tangents: Array
    bends: Array
    known: np.ndarray


class Chart:
    """The fixed surface of one patch over (u, v): without walls and creases, unless a chart says otherwise."""

    low: Array
    high: Array
    densities: tuple[Array, Array] = (np.ones(2), np.ones(2))  # of lines across u and across v (`patches.lay_lines`)

    @property
    def faces(self) -> Sequence[Chart]:
        """Charts of its parts, between which there are walls and creases."""
        return [self]

    @property
    def whole(self) -> Chart:
        """That of a part together with the parts beyond its creases, over which the surface goes on."""
        return self

    def present(self, u: Array, v: Array) -> np.ndarray:
        """True (nu, nv) where the surface has a point, of a grid u (nu,), v (nv,): everywhere."""
        return np.ones((len(u), len(v)), dtype=bool)

    def surface(self, u: Array, v: Array) -> Surface:
        """The surface at points (m,), (m,)."""
        raise NotImplementedError


class PlaneChart(Chart):
    """The rectangle y = 0 about the origin."""

    def __init__(self, length: float, width: float) -> None:
        self.high = 0.5 * np.array([length, width])
        self.low = -self.high

    def surface(self, u: Array, v: Array) -> Surface:
        """Flat."""
        lines = ParallelProjection(grid_frame(DOWN)).lines(u, v)
        return surface_at(lines, np.zeros((len(u), 6)), np.ones(len(u), dtype=bool))


class CupChart(Chart):
    """The inside of a spherical cap."""

    def __init__(self, scene: Scene) -> None:
        g = scene.geometry
        radius, pole = float(g["cup_radius"]), np.asarray(g["cup_pole"], dtype=float)
        pole /= np.linalg.norm(pole)
        first = np.cross(np.eye(3)[np.abs(pole).argmin()], pole)
        first /= np.linalg.norm(first)
        frame = np.array([first, -pole, np.cross(pole, first)])
        self._projection = CentralProjection(frame, np.asarray(g["cup_centre"], dtype=float), radius)
        self.rim = 2.0 * radius * np.sin(0.5 * np.deg2rad(g["cup_half_angle_deg"]))
        self.low, self.high = np.full(2, -self.rim), np.full(2, self.rim)

    def present(self, u: Array, v: Array) -> np.ndarray:
        """Within the rim's circle."""
        return np.asarray(u[:, None] ** 2 + v[None, :] ** 2 <= self.rim**2)

    def surface(self, u: Array, v: Array) -> Surface:
        """At the radius everywhere."""
        jet = np.zeros((len(u), 6))
        jet[:, 0] = -self._projection.radius_mm
        return surface_at(self._projection.lines(u, v), jet, u**2 + v**2 <= self.rim**2)


def surface_at(lines: Lines, jet: Array, known: np.ndarray) -> Surface:
    """The surface at the height h along lines, by h and its derivatives u, v, uu, uv, vv (m, 6)."""
    h, up = jet[:, 0, None, None], lines.ups[:, None]
    h_a, h_ab = jet[:, 1:3, None], jet[:, [3, 4, 4, 5]].reshape(-1, 2, 2, 1)
    tangents = lines.start_gradients + h_a * up + h * lines.up_gradients
    turns = h_a[:, :, None] * lines.up_gradients[:, None]
    second = h_ab * up[:, None] + turns + np.swapaxes(turns, 1, 2) + h[..., None] * lines.up_hessians
    c_u, c_v = tangents[:, 0], tangents[:, 1]
    N = np.cross(c_v, c_u)
    slopes = np.cross(second[:, :, 1], c_u[:, None]) + np.cross(c_v[:, None], second[:, :, 0])
    length = np.linalg.norm(N, axis=1)[:, None] * np.sign(np.einsum("nk,nk->n", N, lines.ups))[:, None]
    n, turned = N / length, slopes / length[..., None]
    bends = turned - n[:, None] * np.einsum("nk,nak->na", n, turned)[..., None]
    return Surface(lines.starts + jet[:, :1] * lines.ups, n, tangents, bends, known)
