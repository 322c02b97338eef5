"""The contact model without training for a scene: the cheapest that meets its tolerances."""

from __future__ import annotations

from pathlib import Path

from casadi_contact.contact.cells.charts import CELL_SHAPES
from casadi_contact.contact.cells.choice import cell_foundation
from casadi_contact.contact.compiled import CompiledFoundation
from casadi_contact.contact.cup.choice import cup_foundation
from casadi_contact.contact.cup.cup import CUP_SHAPE
from casadi_contact.contact.polar.choice import polar_foundation
from casadi_contact.contact.polar.patches import POLAR_SHAPES
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
    and the rest. Its errors, against a much finer model of the same kind, have an RMS within the tolerance of every
    load and are nowhere more than `convergence.WORST` times it (cells: in proportion to the force above the reference
    load), over poses that press each patch from the scene's boundary load to `convergence.LARGEST_LOAD` reference
    loads. ``record`` of the model holds the choice and its errors. Raises ValueError for a shape that has no such
    model (`FOUNDATION_SHAPES`), or where none is good enough.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    if scene.shape not in _CHOICES:
        raise ValueError(
            f"scene {scene.name} has the shape {scene.shape}, which has no foundation of its own: expected one of "
            f"{', '.join(FOUNDATION_SHAPES)}; others take cc.ElasticFoundation"
        )
    return _CHOICES[scene.shape](scene, compiled=compiled)
