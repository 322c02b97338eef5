"""How many rays a scene needs: the fewest whose errors, against many more rays, stay within its tolerances; elements
tell whether rays are right at all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from casadi_contact.contact.convergence import cheapest, forces_tried
from casadi_contact.contact.elements.foundation import grid_text
from casadi_contact.contact.polar.against_elements import ELEMENTS, share_apart
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.middle import middle
from casadi_contact.contact.polar.nearest import nearest
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.pressed_poses import pressed_poses
from casadi_contact.contact.polar.quadrature import patch_loads
from casadi_contact.contact.polar.rays import Rays
from casadi_contact.contact.polar.second import FACING
from casadi_contact.core.conventions import Array, evenly, load_selection
from casadi_contact.scenes.scene import Scene

CANDIDATES = (Rays(8, 3), Rays(12, 3), Rays(16, 3), Rays(24, 3), Rays(32, 4), Rays(48, 5))
LADDER = (Rays(8, 2), Rays(8, 3), Rays(16, 4))
CONVERGED = Rays(96, 6)
_POSES = 256
_ASKED = 128  # of the poses of each patch: elements take their time


def polar_foundation(scene: Scene, *, compiled: bool = True) -> PolarFoundation:
    """The fewest rays that agree with `CONVERGED` within the scene's tolerances (`convergence.cheapest`), over poses
    that press each patch anywhere within its rim; in some of them `CONVERGED` has to agree with elements
    (`against_elements.share_apart`, "elements_apart" in the record)."""
    converged = PolarFoundation(scene, CONVERGED, compiled=False)
    truth = _truth(converged, forces_tried(scene))
    models = (PolarFoundation(scene, rays, compiled=compiled) for rays in CANDIDATES)
    against = f"{CONVERGED}, EF {grid_text(ELEMENTS)}"
    model = cheapest(scene, models, lambda model: _errors(model, truth), model="polar quadrature", against=against)
    apart = share_apart(scene, [_asked(patch, *found) for patch, found in zip(converged.patches, truth, strict=True)])
    model.record |= {"rays": model.rays.count, "points": model.rays.points, "elements_apart": apart}
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


def _asked(patch: SmoothPatch, R: Array, t: Array, wrench: Array) -> tuple[Array, Array, Array]:
    """Rotations, translations and wrenches of the poses that elements are asked in: a few of those in which the patch
    is not met by the body's back, of which polar quadrature knows nothing."""
    few = evenly(len(t), _ASKED)
    R, t, wrench = R[few], t[few], wrench[few]
    turned, place = patch.turn @ R, t @ patch.turn.T
    spot = middle(patch, turned, place).spot
    near = nearest(patch, turned, place, spot.u, spot.v)
    front = (near.depth > 0.0) & (near.ends.slope < FACING)
    return R[front], t[front], wrench[front]


def _errors(model: PolarFoundation, truth: Truth) -> Array:
    """Errors of the named loads (poses, loads), each pose with one patch pressed."""
    selection = load_selection(model.load_names, model.patch_names)
    errors = []
    for p, (patch, (R, t, wrench)) in enumerate(zip(model.patches, truth, strict=True)):
        missed = patch_loads(patch, model.law, model.rays, R, t).wrench - wrench
        errors.append(missed @ selection[:, p].T)
    return np.concatenate(errors)
