"""The contact model without training for a scene: the cheapest that meets its tolerances."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.choice import cell_foundation, cell_sizes_mm, square_cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cells.patches import CELL_SHAPES
from casadi_contact.contact.compiled import CompiledFoundation
from casadi_contact.contact.cup.choice import CANDIDATES as CUP_POINTS
from casadi_contact.contact.cup.choice import cup_foundation
from casadi_contact.contact.cup.cup import CUP_SHAPE
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.kept import keep_record, kept_record
from casadi_contact.contact.kernel_source import C_LAWS
from casadi_contact.contact.polar.choice import LADDER as POLAR_RAYS
from casadi_contact.contact.polar.choice import polar_foundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.patches import POLAR_SHAPES
from casadi_contact.contact.polar.rays import Rays
from casadi_contact.scenes import Scene, load_scene

# Later entries are cheaper where a shape has several.
_CHOICES = {
    **dict.fromkeys(CELL_SHAPES, cell_foundation),
    **dict.fromkeys(POLAR_SHAPES, polar_foundation),
    CUP_SHAPE: cup_foundation,
}
FOUNDATION_SHAPES = tuple(_CHOICES)


def foundation(scene: Scene | str | Path, *, compiled: bool = True) -> CompiledFoundation:
    """The cheapest elastic foundation of a scene (or its name, or file) that meets the scene's tolerances.

    Polar quadrature for smooth shapes with one spot a patch, closed form for a ball in a cup, cubic cells for meshes
    and the rest. Its errors, against a much finer model of the same kind (cells: an element grid), have an RMS within
    the tolerance of every load and are nowhere more than `convergence.WORST` times it (cells: half of that, in
    proportion to the force above the reference load), over poses that press each patch within its rim from the scene's
    boundary load to `convergence.LARGEST_LOAD` reference loads. ``record`` of the model holds the choice and its
    errors; it is kept in the cache folder (`contact.kept`), for laws of the library. Raises ValueError for a shape that
    has no such model (`FOUNDATION_SHAPES`), or where none is good enough.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    if scene.shape not in _CHOICES:
        raise ValueError(
            f"scene {scene.name} has the shape {scene.shape}, which has no foundation of its own: expected one of "
            f"{', '.join(FOUNDATION_SHAPES)}; others take cc.ElasticFoundation"
        )
    kept = scene.material.law in C_LAWS  # of any other law the scene holds but a name
    record = kept_record(scene) if kept else None
    if record is not None:
        with suppress(KeyError, TypeError, ValueError):  # not as such a record is written: as good as absent
            return _as_recorded(scene, record, compiled=compiled)
    model = _CHOICES[scene.shape](scene, compiled=compiled)
    if kept:
        keep_record(scene, model.record)
    return model


def foundation_ladder(scene: Scene) -> Iterator[CompiledFoundation]:
    """Foundations of a scene from coarse to fine, and the one that `foundation` takes if it is none of them; raises
    ValueError as that does, after the others."""
    ladder: Iterable[CompiledFoundation] = ()
    if scene.shape == CUP_SHAPE:
        ladder = (CupFoundation(scene, points) for points in CUP_POINTS[::2])
    elif scene.shape in POLAR_SHAPES:
        ladder = (PolarFoundation(scene, rays) for rays in POLAR_RAYS)
    elif scene.shape in CELL_SHAPES:
        ladder = (CellFoundation(scene, square_cells(size_mm)) for size_mm in cell_sizes_mm(scene)[::2])
    shown = set()
    for model in ladder:
        shown.add(model.resolution)
        yield model
    chosen = foundation(scene)
    if chosen.resolution not in shown:
        yield chosen


def _as_recorded(scene: Scene, record: Mapping[str, Any], *, compiled: bool) -> CompiledFoundation:
    model: CompiledFoundation
    if scene.shape == CUP_SHAPE:
        model = CupFoundation(scene, record["points"], compiled=compiled)
    elif scene.shape in POLAR_SHAPES:
        model = PolarFoundation(scene, Rays(record["rays"], record["points"]), compiled=compiled)
    else:
        model = CellFoundation(scene, Cells(*record["cells_mm"], *record["sub_points"]), compiled=compiled)
    model.record = dict(record)
    return model
