"""How many rays a scene needs: the fewest whose errors, against many more rays, stay within its tolerances."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.quadrature import patch_loads
from casadi_contact.contact.polar.rays import Rays
from casadi_contact.contact.polar.reach import pressed_poses
from casadi_contact.conventions import Array, load_selection
from casadi_contact.scenes import Scene

CANDIDATES = (Rays(8, 3), Rays(12, 3), Rays(16, 3), Rays(24, 3), Rays(32, 4), Rays(48, 5))
CONVERGED = Rays(96, 6)
LARGEST_LOAD = 2.5  # of the scene's reference load, per patch
WORST = 3.0  # times the tolerance that a single pose may be wrong by
_POSES = 256


def chosen_rays(scene: Scene, *, compiled: bool = True) -> PolarFoundation:
    """The foundation on the fewest rays that meet the scene's tolerances.

    Their error in every load, against `CONVERGED`, has an RMS within the tolerance and is nowhere
    more than `WORST` times it, over poses that press each patch anywhere within its rim from the scene's boundary load
    to `LARGEST_LOAD` reference loads. ``record`` of the model holds the choice and its errors. Raises ValueError for a
    shape that is not smooth with one spot a patch, or where no candidate is good enough.
    """
    range_n = (scene.boundary_load, LARGEST_LOAD * scene.reference_load)
    tolerances = np.array([scene.tolerances[name] for name in scene.load_names])
    converged = PolarFoundation(scene, CONVERGED, compiled=False)
    truth = _truth(converged, range_n)
    for rays in CANDIDATES:
        model = PolarFoundation(scene, rays, compiled=compiled)
        errors = _errors(model, truth)
        rms, largest = np.sqrt(np.mean(errors**2, axis=0)), errors.max(axis=0)
        if (rms <= tolerances).all() and (largest <= WORST * tolerances).all():
            model.record = {
                "model": "polar quadrature",
                "rays": rays.count,
                "points": rays.points,
                "against": str(CONVERGED),
                "poses": len(errors),
                "forces_n": list(range_n),
                "rms": dict(zip(scene.load_names, rms.tolist(), strict=True)),
                "largest": dict(zip(scene.load_names, largest.tolist(), strict=True)),
            }
            return model
    worst = int(np.argmax(largest / tolerances))
    raise ValueError(
        f"scene {scene.name}: {CANDIDATES[-1]} are wrong by up to {largest[worst]:.3g} in {scene.load_names[worst]}, "
        "expected less: relax the scene's tolerances, or take cc.ElasticFoundation"
    )


Truth = list[tuple[Array, Array, Array]]


def _truth(model: PolarFoundation, range_n: tuple[float, float]) -> Truth:
    """Rotations, translations and converged wrenches (m, 6) of poses that press each patch."""
    found = []
    for patch in model.patches:
        R, t = pressed_poses(patch, model.law, range_n, _POSES)
        found.append((R, t, patch_loads(patch, model.law, model.rays, R, t).wrench))
    return found


def _errors(model: PolarFoundation, truth: Truth) -> Array:
    """Absolute errors of the named loads (poses, loads), each pose with one patch pressed."""
    selection = load_selection(model.load_names, model.patch_names)
    errors = []
    for p, (patch, (R, t, wrench)) in enumerate(zip(model.patches, truth, strict=True)):
        missed = patch_loads(patch, model.law, model.rays, R, t).wrench - wrench
        errors.append(np.abs(missed @ selection[:, p].T))
    return np.concatenate(errors)
