"""How many points a cup needs: the fewest whose errors, against many more, stay within the scene's tolerances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from casadi_contact.contact.approach import press_until
from casadi_contact.contact.convergence import cheapest, forces_tried
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.cup.quadrature import any_across
from casadi_contact.core.conventions import Array
from casadi_contact.scenes.scene import Scene

CANDIDATES = (12, 16, 24, 32, 48)  # with fewer, slopes differ from differences of loads where the rim cuts
CONVERGED = 96
_POSES = 256


def cup_foundation(scene: Scene, *, compiled: bool = True) -> CupFoundation:
    """The fewest points that agree with `CONVERGED` within the scene's tolerances (`convergence.cheapest`), over poses
    that press the cup from its deepest point to its rim, which cuts contact then."""
    converged = CupFoundation(scene, CONVERGED, compiled=False)
    poses = _pressed_poses(converged, forces_tried(scene))
    truth = converged(poses)
    models = (CupFoundation(scene, points, compiled=compiled) for points in CANDIDATES)

    def errors(model: CupFoundation) -> Array:
        plain = CupFoundation(scene, model.points, compiled=False)
        return np.asarray(plain(poses) - truth)

    model = cheapest(scene, models, errors, model="quadrature of a cup", against=f"{CONVERGED} points")
    model.record["points"] = model.points
    return model


def recorded_cup(scene: Scene, record: Mapping[str, Any], *, compiled: bool = True) -> CupFoundation:
    """The foundation that a record of `cup_foundation` tells of."""
    return CupFoundation(scene, record["points"], compiled=compiled)


def cup_ladder(scene: Scene) -> Iterator[CupFoundation]:
    """Foundations from few points to many, shown beside one another."""
    return (CupFoundation(scene, points) for points in CANDIDATES[::2])


def _pressed_poses(model: CupFoundation, range_n: tuple[float, float]) -> Array:
    """Poses (m, 6) at all angles of the cup, whose forces spread evenly on a logarithmic scale [N]."""
    cup, random = model.cup, np.random.default_rng(0)
    tilt, around = cup.half_angle * random.random(_POSES), random.uniform(0.0, 2.0 * np.pi, _POSES)
    first = any_across(cup)
    beside = np.cos(around)[:, None] * first + np.sin(around)[:, None] * np.cross(cup.pole, first)
    along = np.cos(tilt)[:, None] * cup.pole + np.sin(tilt)[:, None] * beside

    def at(depth_mm: Array) -> Array:
        centres = cup.centre + (cup.radius - cup.ball_radius + depth_mm)[:, None] * along
        return np.column_stack([centres, np.zeros((_POSES, 3))])

    def force_at(depth_mm: Array) -> Array:
        return np.linalg.norm(model.wrenches(at(depth_mm))[:, 0, :3], axis=1)

    return at(press_until(force_at, np.geomspace(*range_n, _POSES), 0.01, most_change=30.0)[0])
