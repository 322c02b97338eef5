"""The rays of polar quadrature, from the middle of a spot to its edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.polar.lines import Lines
from casadi_contact.contact.polar.middle import Middle, edge_distance
from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class Rays:
    """Number of rays from the middle, and Gauss points on each of them."""

    count: int
    points: int

    @property
    def in_caps(self) -> int:
        """Number of lines in the fan over each cap (`caps`): about as many as rays, a multiple of 8."""
        return min(max(self.count // 8 * 8, 8), 24)

    @property
    def at_rim(self) -> int:
        """Number of rays of a spot that the rim may cut: their sum converges more slowly there."""
        return max(self.count, 32)

    def __str__(self) -> str:
        return f"{self.count} rays × {self.points} points"


def rays_from(middle: Middle, rays: Rays) -> list[Lines]:
    """Rays from the middle through the torus of its arc, which goes on beyond the arc's ends; where the rim may cut the
    spot through each ray's own. A set of rays has no area in the poses that it is not for."""
    return [_fan_out(middle, rays.count, middle.whole[:, None]), *rays_at_rim(middle, rays, ~middle.whole)]


def rays_at_rim(middle: Middle, rays: Rays, used: np.ndarray) -> list[Lines]:
    """Rays from the middle where used (n,) through each ray's own torus; none if that is nowhere."""
    return [_fan_out(middle, rays.at_rim, used[:, None])] if used.any() else []


def _fan_out(middle: Middle, count: int, used: np.ndarray) -> Lines:
    m = middle.spot
    cosine, sine = ray_angles(count)
    directions = np.einsum("nab,jb->nja", middle.form, np.stack([cosine, sine], -1))
    one = np.ones(directions.shape[:2])
    slope = np.einsum("nr,njr->nj", m.slope, directions)
    k = np.einsum("njr,nrs,njs->nj", directions, m.curvature, directions)
    edge = edge_distance(np.maximum(m.depth, 0.0)[:, None], slope, k)
    u, v, arc = (np.broadcast_to(x[:, None], one.shape) for x in (m.u, m.v, np.where(middle.whole, m.ends.arc, -1)))
    spread = np.where(used, 2.0 * np.pi / count, 0.0) * one
    return Lines(u, v, directions, np.where(used, edge, 0.0), arc, 0.0 * one, spread)


def ray_angles(count: int) -> tuple[Array, Array]:
    """Cosines and sines of equally spaced angles."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return np.cos(angle), np.sin(angle)
