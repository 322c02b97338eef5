"""The cheapest contact model that meets a scene's tolerances."""

from __future__ import annotations

from pathlib import Path

from casadi_contact.contact.cells.choice import chosen_cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.polar.choice import chosen_rays
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.patches import POLAR_SHAPES
from casadi_contact.scenes import Scene, load_scene


def foundation(scene: Scene | str | Path, *, compiled: bool = True) -> PolarFoundation | CellFoundation:
    """The cheapest elastic foundation of a scene (or its name, or file) that meets the scene's tolerances.

    Polar quadrature with the fewest rays for smooth shapes with one spot a patch, else the largest cubic cells. The
    model's ``record`` holds the choice and its errors, found by convergence tests over poses that press each patch.
    Raises ValueError for a shape without geometry and where no candidate is good enough.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    chosen = chosen_rays if scene.shape in POLAR_SHAPES else chosen_cells
    return chosen(scene, compiled=compiled)
