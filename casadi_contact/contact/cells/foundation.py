"""The elastic foundation of meshes, and of shapes with a known distance, in cubic cells, as a contact model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import cached_property

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.charts import Chart
from casadi_contact.contact.cells.patches import lay_cells, patch_charts
from casadi_contact.contact.cells.quadrature import Quadrature, cell_moments
from casadi_contact.contact.cells.source import cell_source
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.friction import PressedPoints
from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.pressure_law import law_of
from casadi_contact.core.conventions import Array, rotation
from casadi_contact.geometry.distance_field import in_single_precision
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface
from casadi_contact.scenes.scene import Scene


class CellFoundation(CompiledFoundation):
    """Elastic foundation whose depth is interpolated by cubics over cells of the fixed surface.

    Several spots of contact, of any form, in each patch. Raises ValueError for a scene of no shape of `CELL_SHAPES`.
    """

    lanes, varies, moments_header = 8, True, "cells_pressures.h"

    def __init__(self, scene: Scene, cells: Cells = Cells(1.2, 0.75), *, compiled: bool = True) -> None:  # noqa: B008
        super().__init__(scene, compiled=compiled)
        if min(cells.u_mm, cells.v_mm) <= 0.0 or min(cells.along_u, cells.along_v) < 1:
            raise ValueError(f"{cells}, expected sizes above 0 mm and at least 1 sub-point along each")
        self.cells, self.resolution = cells, str(cells)
        self.patches = cell_patches(scene, cells)

    def edge_share(self, poses: Array) -> Array:
        """`ElasticFoundation.edge_share`: cells at the rim are several times as wide as elements."""
        return self._elements.edge_share(poses)

    def edge_wrenches(self, poses: Array) -> Array:
        """`ElasticFoundation.edge_wrenches` of the scene's teacher grid."""
        return self._elements.edge_wrenches(poses)

    @cached_property
    def _elements(self) -> ElasticFoundation:
        return ElasticFoundation(self.scene, self.scene.grids["teacher"])

    def pressed_points(self, poses: Array) -> Iterator[list[PressedPoints]]:
        """Of each pose (n, 6), of each patch, the nodes that bear load."""
        for R, t in zip(rotation(poses[:, 3:]), poses[:, :3], strict=True):
            yield [patch.pressed_points(R, t) for patch in self.patches]

    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        found = [[cell_moments(patch, *pose) for patch in self.patches] for pose in zip(R, t, strict=True)]
        values, slopes = (np.array([[moments[k] for moments in each] for each in found]) for k in (0, 1))
        return values, slopes

    @cached_property
    def _code(self) -> tuple[str, bytes]:
        return cell_source(self.patches)

    def _patch_loads(self, R: Array, t: Array) -> list[PatchLoads]:
        loads = ([patch.loads(*pose) for pose in zip(R, t, strict=True)] for patch in self.patches)
        names = [field.name for field in fields(PatchLoads)]
        return [PatchLoads(*(np.array([getattr(one, name) for one in each]) for name in names)) for each in loads]


def cell_patches(
    scene: Scene, cells: Cells, charts: Sequence[Chart] = (), *, fade_share: float = 0.2
) -> list[Quadrature]:
    """The scene's patches in cells; charts: its `patch_charts`; fade_share: of the boundary load, where loads fade out.

    Where the thickness h varies, p = K·d/h is K·d/h0 times h0/h, which the nodes' areas take on (linear law alone).
    """
    law = law_of(scene.material)
    if scene.varies and scene.material.law != "linear":
        cure = "expected the law linear, or cc.ElasticFoundation"
        raise ValueError(f"scene {scene.name}: cells take no thickness that varies under another law, {cure}")
    body = scene.surfaces()[0]  # one body faces every patch
    if body.family == MESH_FIELD:  # as its kernel stores it
        body = MovingSurface(body.family, in_single_precision(body.parameters))
    fade_n = fade_share * scene.boundary_load
    patches = [lay_cells(chart, cells) for chart in charts or patch_charts(scene)]
    if scene.varies:
        shares = (law[2] / scene.thickness_at(patch.c, patch.n) for patch in patches)
        patches = [replace(p, loads=p.loads * share[:, None]) for p, share in zip(patches, shares, strict=True)]
    return [Quadrature(patch, cells, body, law, fade_n) for patch in patches]
