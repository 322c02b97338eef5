"""How fine a contact model a scene needs: the cheapest whose errors, against a converged one, meet its tolerances."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from casadi_contact.contact.compiled import CompiledFoundation
from casadi_contact.conventions import Array
from casadi_contact.scenes import Scene

LARGEST_LOAD = 2.5  # of the scene's reference load, per patch
WORST = 3.0  # times the tolerance that a single pose may be wrong by

Model = TypeVar("Model", bound=CompiledFoundation)


def forces_tried(scene: Scene) -> tuple[float, float]:
    """Least and largest force [N] on a patch that a choice is made for."""
    return scene.boundary_load, LARGEST_LOAD * scene.reference_load


def cheapest(
    scene: Scene,
    candidates: Iterable[Model],
    errors_of: Callable[[Model], Array],
    force_n: Array | None = None,
    **said: Any,
) -> Model:
    """The first candidate whose errors (poses, loads) meet the scene's tolerances, its record telling so.

    Every load's RMS has to lie within its tolerance, and no error may exceed `WORST` times it; given the force_n
    (poses,) on the patch, more in proportion where that exceeds the scene's reference load. said: what the record holds
    besides. Raises ValueError where no candidate is good enough.
    """
    tolerances = np.array([scene.tolerances[name] for name in scene.load_names])
    allowed = 1.0 if force_n is None else np.maximum(force_n / scene.reference_load, 1.0)[:, None]
    for model in candidates:
        errors = np.abs(errors_of(model))
        rms, largest = np.sqrt(np.mean(errors**2, axis=0)), errors.max(axis=0)
        if (rms <= tolerances).all() and (errors <= WORST * tolerances * allowed).all():
            found = {"rms": rms, "largest": largest}
            by_name = {key: dict(zip(scene.load_names, sizes.tolist(), strict=True)) for key, sizes in found.items()}
            model.record = {**said, "poses": len(errors), "forces_n": list(forces_tried(scene)), **by_name}
            return model
    worst = int(np.argmax(largest / tolerances))
    raise ValueError(
        f"scene {scene.name}: {model} is wrong by up to {largest[worst]:.3g} in {scene.load_names[worst]}, "
        "expected less: relax the scene's tolerances, or take cc.ElasticFoundation"
    )
