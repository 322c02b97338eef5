"""Design of a knee insert: the dish radii with the lowest peak pressure over walking at bounded laxity.

    unknowns    dish radii (sagittal, frontal) [mm], P, and tx, ty, tz, rx in every pose
    minimise    P
    subject to  frames of walking: Fy_med, Fy_lat as measured, Fx = Fz = 0 at the cycle's rz and ry;
                pressure K/h·(largest penetration) <= P on both sides
                laxity: 350 N on each side at 20° of flexion and ±100 N along x, or ±50 N along z;
                the travel between + and - within bounds

All poses are in balance at every solution of the constraints, so the gradient by the radii includes how the femur
moves. IPOPT builds up the Hessian (limited memory). The check: both dishes are
settled once more on the scene's finest elements.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.pressure_law import law_of
from casadi_contact.contact.settle import settle
from casadi_contact.contact.symbolic import contact_callback
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import numbers, run_program
from casadi_contact.optimisation.ipopt import ipopt_options
from casadi_contact.optimisation.knee import SIDES, check_knee
from casadi_contact.optimisation.starts import KNEE_STEPS, settle_in_range
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import reference_cycle

FREE, COLUMNS = ("tx", "ty", "tz", "rx"), [0, 1, 2, 3]
BALANCED = (*SIDES, "Fx", "Fz")
LAXITY = (("tx", "Fx", 100.0), ("tz", "Fz", 50.0))  # travel along, push [N] and its opposite
RAYS = Rays(24, 3)

RADII = ("dish_sagittal_radius", "dish_frontal_radius")
STEP_MM = 1e-4  # of differences by radii


class DishContact:
    """Loads and largest penetrations of a knee's sides as functions of poses and of the radii of both dishes."""

    def __init__(self, scene: Scene) -> None:
        own = any(name in scene.geometry.get(patch, {}) for patch in scene.patch_names for name in RADII)
        if scene.shape != "knee" or own or scene.material.law != "linear":
            raise ValueError(f"scene {scene.name}: expected the shape knee, one dish for both sides and the linear law")
        check_knee("the design of a dish", scene, scene.load_names, BALANCED)
        self.scene = scene

    def with_radii(self, radii_mm: Array) -> Scene:
        """The scene with other dishes."""
        return self.scene.with_overrides(**dict(zip(RADII, map(float, radii_mm), strict=True)))

    def foundation(self, radii_mm: Array) -> PolarFoundation:
        """With other dishes, in NumPy: each dish would need a C kernel of its own."""
        return PolarFoundation(self.with_radii(radii_mm), RAYS, compiled=False)

    def evaluate(self, poses: Array, radii_mm: Array) -> tuple[Array, Array]:
        """Loads, then penetrations (n, L + P) [N, N·mm, mm], and their derivatives by pose and radii (n, L + P, 8);
        those by radii are differences of smooth integrals."""
        values, by_pose = self._by_pose(poses, radii_mm)
        by_radii = [(self._by_pose(poses, radii_mm + step)[0] - values) / STEP_MM for step in STEP_MM * np.eye(2)]
        return values, np.concatenate([by_pose, np.stack(by_radii, axis=-1)], axis=2)

    def _by_pose(self, poses: Array, radii_mm: Array) -> tuple[Array, Array]:
        """Loads, then penetrations (n, L + P), and their derivatives by the pose (n, L + P, 6)."""
        model = self.foundation(radii_mm)
        loads, slopes = model.jacobian(poses)
        gaps, gap_slopes = model.gap_jacobian(poses)
        penetration_slopes = np.where((gaps < 0.0)[..., None], -gap_slopes, 0.0)
        return np.hstack([loads, np.maximum(-gaps, 0.0)]), np.concatenate([slopes, penetration_slopes], axis=1)

    def function(self, poses: int) -> ca.Function:
        """casadi.Function (poses, pose after pose, then radii) (6n + 2) -> loads and penetrations, with Jacobian."""
        rows = poses * (len(self.scene.load_names) + len(self.scene.patch_names))

        @lru_cache(maxsize=1)  # values and derivatives at one point, in turn
        def at(point: bytes) -> tuple[Array, Array]:
            x = np.frombuffer(point)
            values, slopes = self.evaluate(x[:-2].reshape(poses, 6), x[-2:])
            whole = np.zeros((poses, values.shape[1], len(x)))
            for k in range(poses):
                whole[k, :, 6 * k : 6 * k + 6] = slopes[k, :, :6]
            whole[:, :, -2:] = slopes[:, :, 6:]
            return values.reshape(1, -1), whole.reshape(1, rows, -1)

        return contact_callback("dish", [("values", rows, lambda points: at(points.tobytes()))], 6 * poses + 2)


def wanted_loads(frames: int) -> tuple[Array, Array]:
    """Loads (n, 4) of `BALANCED` and poses (n, 6) that hold rz and ry: frames of walking, then the laxity tests."""
    cycle = reference_cycle(frames)
    loads, locked = np.zeros((frames + 4, 4)), np.zeros((frames + 4, 6))
    loads[:frames, :2] = np.column_stack(list(cycle.loads.values()))
    loads[frames:, :2] = -350.0
    for row, (load, push) in enumerate((load, s * push) for _, load, push in LAXITY for s in (1.0, -1.0)):
        loads[frames + row, BALANCED.index(load)] = push
    locked[:frames, 4], locked[:frames, 5], locked[frames:, 5] = cycle.pose["ry"], cycle.pose["rz"], -np.radians(20.0)
    return loads, locked


@dataclass(frozen=True)
class Dish:
    """A dish in balance: radii (2,) [mm], poses (n, 6), peak pressures of both sides in walking (frames, 2) [MPa], and
    travel (2,) [mm] of the laxity tests along x and z."""

    radii_mm: Array
    poses: Array
    peaks_mpa: Array
    travel_mm: Array


def balanced(model: PolarFoundation | ElasticFoundation, radii_mm: Array, loads: Array, start: Array) -> Dish:
    """A dish's poses settled from a start (n, 6); ValueError where one has no equilibrium."""
    targets = dict(zip(BALANCED, loads.T, strict=True))
    poses, report = settle(model, start, FREE, targets, tolerance=0.01)
    if not report.converged.all():
        frame = int(np.argmin(report.converged))
        raise ValueError(f"radii {radii_mm}: pose {frame} has no equilibrium: {report.reason[frame]}")
    walking, tests = poses[:-4], poses[-4:]
    travel = np.array([tests[0, 0] - tests[1, 0], tests[2, 2] - tests[3, 2]])
    return Dish(radii_mm, poses, model.summary(walking).largest_mpa, travel)


def design(contact: DishContact, bounds: Array, frames: int) -> tuple[Dish, Dish, int]:
    """The scene's own dish, the best one and IPOPT's iterations. bounds (2, 2): least and largest travel [mm] along x
    and z. Raises RuntimeError where IPOPT finds none."""
    scene, (loads, locked) = contact.scene, wanted_loads(frames)
    own, n, L = np.array([scene.geometry[name] for name in RADII]), len(loads), len(scene.load_names)
    model, rest = PolarFoundation(scene, RAYS), locked + np.array([0.0, scene.start_pose[1], 0.0, 0.0, 0.0, 0.0])
    pressed = settle_in_range(model, rest, rest, ("ty", "rx"), dict(zip(SIDES, loads[:, :2].T, strict=True)))
    first = balanced(contact.foundation(own), own, loads, pressed)

    opti, steps = ca.Opti(), KNEE_STEPS[COLUMNS]
    radii, peak, q = 5.0 * opti.variable(2), 5.0 * opti.variable(), opti.variable(4, n)  # mm, MPa
    poses = ca.vertcat(ca.diag(ca.DM(steps)) @ q, ca.DM(locked[:, 4:].T))
    values = ca.reshape(contact.function(n)(ca.vertcat(ca.vec(poses), radii)), -1, n)
    _, modulus, thickness = law_of(scene.material)
    pressure = modulus / thickness * values[L:, :frames]
    got = values[[scene.load_names.index(name) for name in BALANCED], :]
    opti.minimize(peak / 5.0)
    opti.subject_to((got - ca.DM(loads.T)) / 30.0 == 0.0)
    opti.subject_to(ca.vec(peak - pressure) / 5.0 >= 0.0)
    for k, axis in enumerate((0, 2)):
        travel = poses[axis, frames + 2 * k] - poses[axis, frames + 2 * k + 1]
        opti.subject_to(opti.bounded(bounds[k, 0], travel, bounds[k, 1]))
    opti.subject_to(opti.bounded(narrowest(scene) / 5.0, radii / 5.0, 200.0 / 5.0))
    opti.set_initial(radii, own)
    opti.set_initial(peak, first.peaks_mpa.max())
    opti.set_initial(q, (first.poses[:, COLUMNS] / steps).T)
    options = ipopt_options(
        hessian_approximation="limited-memory", limited_memory_max_history=30, mu_strategy="adaptive"
    )
    opti.solver("ipopt", options | {"detect_simple_bounds": True})
    found = opti.solve()
    best, at = np.asarray(found.value(radii)), np.asarray(found.value(poses)).T
    return first, balanced(contact.foundation(best), best, loads, at), found.stats()["iter_count"]


def narrowest(scene: Scene) -> Array:
    """Least radii (2,) [mm]: wider by 0.5 mm than condyle and half plateau of every side."""
    sides = [scene.patch_geometry(patch) for patch in scene.patch_names]
    condyles = [(max(side["sagittal_radii"]), side["frontal_radius"]) for side in sides]
    plateaus = [(0.5 * side["plateau_length"], 0.5 * side["plateau_width"]) for side in sides]
    return np.max([*condyles, *plateaus], axis=0) + 0.5


def main(
    scene: str = "knee", ap: str = "5,8", ml: str = "0.5,2", frames: int = 12, out: Path = Path("results/design")
) -> None:
    """Find the dish radii with the lowest peak pressure over walking; ap, ml: least and largest travel [mm]."""
    contact = DishContact(load_scene(scene))
    bounds = np.array([numbers(ap, "ap"), numbers(ml, "ml")])
    first, best, iterations = design(contact, bounds, frames)
    loads, _ = wanted_loads(frames)
    print("dish   radii [mm]     peak [MPa], on elements  travel along x, z [mm], on elements")
    for name, dish in {"first": first, "best": best}.items():
        changed = contact.with_radii(dish.radii_mm)
        ef = balanced(ElasticFoundation(changed, changed.grids["teacher"]), dish.radii_mm, loads, dish.poses)
        radii, travel, on_ef = (" ".join(f"{x:.3f}" for x in v) for v in (dish.radii_mm, dish.travel_mm, ef.travel_mm))
        print(f"{name:5s} {radii}  {dish.peaks_mpa.max():.3f} {ef.peaks_mpa.max():.3f}  {travel}, {on_ef}")
    print(f"{iterations} iterations")

    out.mkdir(parents=True, exist_ok=True)
    page, share = new_page(8.0, 4.5), 100.0 * np.arange(frames) / frames
    axis, table = page.subplots(), {"cycle_percent": share}
    for name, dish in {"first": first, "best": best}.items():
        for patch, peaks in zip(contact.scene.patch_names, dish.peaks_mpa.T, strict=True):
            axis.plot(share, peaks, "-" if name == "best" else "--", label=f"{name} dish, {patch}")
            table[f"{name}_{patch}_MPa"] = peaks
    axis.set(xlabel="cycle [%]", ylabel="peak pressure [MPa]")
    axis.legend()
    save_page(page, out / "design.png")
    write_columns(out / "design.csv", table, digits=9)


if __name__ == "__main__":
    run_program(main)
