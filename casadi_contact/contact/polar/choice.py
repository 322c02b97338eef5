"""How many rays a scene needs: the fewest whose errors, against many more rays, stay within its tolerances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from casadi_contact.contact.convergence import cheapest, forces_tried
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.pressed_poses import pressed_poses
from casadi_contact.contact.polar.quadrature import patch_loads
from casadi_contact.contact.polar.rays import Rays
from casadi_contact.conventions import Array, load_selection
from casadi_contact.scenes import Scene

CANDIDATES = (Rays(8, 3), Rays(12, 3), Rays(16, 3), Rays(24, 3), Rays(32, 4), Rays(48, 5))
LADDER = (Rays(8, 2), Rays(8, 3), Rays(16, 4))
CONVERGED = Rays(96, 6)
_POSES = 256


def polar_foundation(scene: Scene, *, compiled: bool = True) -> PolarFoundation:
    """The fewest rays that agree with `CONVERGED` within the scene's tolerances (`convergence.cheapest`), over poses
    that press each patch anywhere within its rim."""
    converged = PolarFoundation(scene, CONVERGED, compiled=False)
    truth = _truth(converged, forces_tried(scene))
    models = (PolarFoundation(scene, rays, compiled=compiled) for rays in CANDIDATES)
    model = cheapest(
        scene, models, lambda model: _errors(model, truth), model="polar quadrature", against=str(CONVERGED)
    )
    model.record |= {"rays": model.rays.count, "points": model.rays.points}
    return model


def recorded_rays(scene: Scene, record: Mapping[str, Any], *, compiled: bool = True) -> PolarFoundation:
    """The foundation that a record of `polar_foundation` tells of."""
    return PolarFoundation(scene, Rays(record["rays"], record["points"]), compiled=compiled)


def polar_ladder(scene: Scene) -> Iterator[PolarFoundation]:
    """Foundations from few rays to many, shown beside one another."""
    return (PolarFoundation(scene, rays) for rays in LADDER)


Truth = list[tuple[Array, Array, Array]]


def _truth(model: PolarFoundation, range_n: tuple[float, float]) -> Truth:
    """Rotations, translations and converged wrenches (m, 6) of poses that press each patch; poses whose contact the rim
    cuts between the few rays that found them are left out."""
    found = []
    for patch in model.patches:
        R, t = pressed_poses(patch, model.law, range_n, _POSES)
        loads = patch_loads(patch, model.law, model.rays, R, t)
        found.append((R[~loads.cut], t[~loads.cut], loads.wrench[~loads.cut]))
    return found


def _errors(model: PolarFoundation, truth: Truth) -> Array:
    """Errors of the named loads (poses, loads), each pose with one patch pressed."""
    selection = load_selection(model.load_names, model.patch_names)
    errors = []
    for p, (patch, (R, t, wrench)) in enumerate(zip(model.patches, truth, strict=True)):
        missed = patch_loads(patch, model.law, model.rays, R, t).wrench - wrench
        errors.append(missed @ selection[:, p].T)
    return np.concatenate(errors)
