"""The fixed surface of each patch as the page draws it: triangles, and where its C finds the pressure at each point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from casadi_contact.contact import CellFoundation, CupFoundation, PolarFoundation
from casadi_contact.contact.cells.patches import CellPatch
from casadi_contact.contact.compiled import CompiledFoundation
from casadi_contact.contact.cup.cup import Cup
from casadi_contact.contact.polar.ends import fixed_point
from casadi_contact.contact.polar.middle import u_range
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.conventions import Array
from casadi_contact.live.triangles import Triangles

_SIDE_MM = 0.7  # about, between points of a smooth surface
_MOST_ALONG = 91  # of these, each way


@dataclass(frozen=True, eq=False)
class FixedSurface:
    """One patch: triangles; places (m, q), which its model's ``foundation_pressures`` reads (``contact/c/*_depths.h``);
    areas_mm2 (m,) that points stand for."""

    triangles: Triangles
    places: Array
    areas_mm2: Array


@singledispatch
def fixed_surfaces(model: CompiledFoundation) -> list[FixedSurface]:
    """The fixed surface of each patch of a contact model; raises TypeError for a model without."""
    raise TypeError(f"{model!r} has no surface to draw, expected a model made by cc.foundation")


@fixed_surfaces.register
def _(model: PolarFoundation) -> list[FixedSurface]:
    return [_chart_surface(patch) for patch in model.patches]


@fixed_surfaces.register
def _(model: CupFoundation) -> list[FixedSurface]:
    return [_cup_surface(model.cup)]


@fixed_surfaces.register
def _(model: CellFoundation) -> list[FixedSurface]:
    return [_cell_surface(quadrature.patch) for quadrature in model.patches]


def _chart_surface(patch: SmoothPatch) -> FixedSurface:
    """Over the chart; places are (u, v)."""
    low, high = (bound.max() if k else bound.min() for k, bound in enumerate(u_range(patch, np.array(patch.rim.v))))
    v = np.linspace(*patch.rim.v, _count(patch.rim.v[1] - patch.rim.v[0]))
    share = np.linspace(0.0, 1.0, _count(float(high - low)))
    start, end = u_range(patch, v)
    u = start + share[:, None] * (end - start)
    c, N, _ = fixed_point(patch, u, np.broadcast_to(v, u.shape))
    areas = np.linalg.norm(N, axis=-1) * (end - start) * _weights(share)[:, None] * _weights(v)
    normals = N / np.linalg.norm(N, axis=-1, keepdims=True)
    places = np.stack([u, np.broadcast_to(v, u.shape)], -1)
    return FixedSurface(Triangles.of_grid(c @ patch.turn, normals @ patch.turn), places.reshape(-1, 2), areas.ravel())


def _cup_surface(cup: Cup) -> FixedSurface:
    """Circles about the pole; places are directions from the cup's centre."""
    count = min(_count(cup.radius * cup.half_angle), _MOST_ALONG)
    angle = np.linspace(0.0, cup.half_angle, count)
    turn = np.linspace(0.0, 2.0 * np.pi, 4 * (count // 2) + 1)
    first = np.cross(np.eye(3)[np.abs(cup.pole).argmin()], cup.pole)
    first /= np.linalg.norm(first)
    second = np.cross(cup.pole, first)
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    e = np.cos(angle)[:, None, None] * cup.pole + np.sin(angle)[:, None, None] * around
    areas = cup.radius**2 * (np.sin(angle) * _weights(angle))[:, None] * _weights(turn)
    return FixedSurface(Triangles.of_grid(cup.centre + cup.radius * e, -e), e.reshape(-1, 3), areas.ravel())


def _cell_surface(patch: CellPatch) -> FixedSurface:
    """The cells that are whole at least by half; places are the numbers of nodes."""
    share = patch.present.mean(axis=1)
    areas = np.zeros(len(patch.c))
    np.add.at(areas, patch.corners.ravel(), np.repeat(0.25 * share, 4))
    quads = patch.corners[share > 0.5][:, [0, 1, 3, 2]]
    places = np.arange(len(patch.c), dtype=float)[:, None]
    return FixedSurface(Triangles.of_quads(patch.c, patch.n, quads), places, areas * patch.loads[:, 6])


def _count(length_mm: float) -> int:
    return int(np.clip(round(length_mm / _SIDE_MM), 8, _MOST_ALONG - 1)) + 1


def _weights(x: Array) -> Array:
    """Of the trapezoidal rule over x (n,)."""
    step = np.diff(x)
    return 0.5 * (np.append(step, 0.0) + np.append(0.0, step))
