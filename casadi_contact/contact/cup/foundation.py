"""The elastic foundation of a ball in a spherical cup: as a contact model, as C (``c/cup.h``), and how many points it
needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.contact.approach import press_until
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.convergence import cheapest, forces_tried
from casadi_contact.contact.cup.quadrature import Cup, any_across, cup_loads, cup_moments, cup_of, nodes
from casadi_contact.contact.foundation_source import C_FOLDER, definitions
from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.pressure_law import law_of
from casadi_contact.core.conventions import Array
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.scenes.scene import Scene


def cup_source(cup: Cup, points: int) -> str:
    """Tables of the cup and `patch_loads`."""
    numbers = {
        "POINTS": points,
        "BALL_RADIUS": cup.ball_radius,
        "CUP_RADIUS": cup.radius,
        "RIM_COS": float(np.cos(cup.half_angle)),
        "RIM_SIN": float(np.sin(cup.half_angle)),
        "LEAST_MM": cup.least_mm,
        "LEAST_SINE": cup.least_sine,
    }
    n = nodes(points)
    tables = {
        "cup_pole[3]": cup.pole,
        "cup_centre[3]": cup.centre,
        "cup_beside[3]": any_across(cup),
        "whole_node[POINTS]": n.whole,
        "whole_weight[POINTS]": n.whole_weight,
        "arc_node[POINTS]": n.arc,
        "arc_weight[POINTS]": n.arc_weight,
    }
    return "\n".join([*definitions(numbers, tables), c_text("cup.h", C_FOLDER)])


class CupFoundation(CompiledFoundation):
    """Elastic foundation of a ball in a cup with its rim, integrated over one angle: nothing of it is a grid.

    points: on whole circles about the deepest point and on those that the rim cuts, a multiple of 4. Raises ValueError
    for another number, or a scene of another shape than `CUP_SHAPE`.
    """

    def __init__(self, scene: Scene, points: int = 12, *, compiled: bool = True) -> None:
        super().__init__(scene, compiled=compiled)
        if points < 4 or points % 4:
            raise ValueError(f"points = {points}, expected a multiple of 4")
        self.points = points
        self.cup = cup_of(scene)
        self.law = law_of(scene.material)

    @property
    def resolution(self) -> str:
        """Points of the quadrature."""
        return f"{self.points} points"

    def _patch_source(self) -> str:
        return cup_source(self.cup, self.points)

    def _moments_source(self) -> str:
        return c_text("cup_pressures.h", C_FOLDER)

    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        value, by_centre = cup_moments(self.cup, self.law, self.points, t)
        return value[:, None], np.concatenate([by_centre, np.zeros_like(by_centre)], -1)[:, None]

    def _patch_loads(self, R: Array, t: Array) -> list[PatchLoads]:
        return [cup_loads(self.cup, self.law, self.points, t)]


def cup_foundation(
    scene: Scene,
    *,
    compiled: bool = True,
    candidates: Sequence[int] = (12, 16, 24, 32, 48),
    converged_points: int = 96,
) -> CupFoundation:
    """The fewest points that agree with converged ones within the scene's tolerances (`convergence.cheapest`), over
    poses that press the cup from its deepest point to its rim, which cuts contact then.

    With fewer than 12 points derivatives differ from differences of loads where the rim cuts contact.
    """
    converged = CupFoundation(scene, converged_points, compiled=False)
    poses = _pressed_poses(converged, forces_tried(scene))
    truth = converged(poses)
    models = (CupFoundation(scene, points, compiled=compiled) for points in candidates)

    def errors(model: CupFoundation) -> Array:
        plain = CupFoundation(scene, model.points, compiled=False)
        return np.asarray(plain(poses) - truth)

    model = cheapest(scene, models, errors, model="quadrature of a cup", against=f"{converged_points} points")
    model.record["points"] = model.points
    return model


def _pressed_poses(model: CupFoundation, range_n: tuple[float, float], count: int = 256) -> Array:
    """Poses (m, 6) at all angles of the cup, whose forces spread evenly on a logarithmic scale [N]."""
    cup, random = model.cup, np.random.default_rng(0)
    tilt, around = cup.half_angle * random.random(count), random.uniform(0.0, 2.0 * np.pi, count)
    first = any_across(cup)
    beside = np.cos(around)[:, None] * first + np.sin(around)[:, None] * np.cross(cup.pole, first)
    along = np.cos(tilt)[:, None] * cup.pole + np.sin(tilt)[:, None] * beside

    def at(depth_mm: Array) -> Array:
        centres = cup.centre + (cup.radius - cup.ball_radius + depth_mm)[:, None] * along
        return np.column_stack([centres, np.zeros((count, 3))])

    def force_at(depth_mm: Array) -> Array:
        return np.linalg.norm(model.wrenches(at(depth_mm))[:, 0, :3], axis=1)

    return at(press_until(force_at, np.geomspace(*range_n, count), 0.01, most_change=30.0)[0])
