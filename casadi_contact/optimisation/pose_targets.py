"""What a cycle measures of the contact in every frame, and how far a pose is from it.

Targets go by name: loads of the scene (Fy_med [N], Tx [N·mm]) and centres of pressure (cop_ap, cop_ml, cop_x ... [mm]).
They come from ``cycle.estimation_targets()`` (`casadi_contact.scenes.cycle`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import LEVER_MM, Array, loads_of_total
from casadi_contact.core.quantities import FORCE, LENGTH, TORQUE, quantity
from casadi_contact.scenes.normal_load import CentreOfPressure, centre_of_pressure
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class PoseTargets:
    """Targets of n frames and the loads that they are made of.

    values: targets (n,) by name; load_names: loads needed to evaluate them, in the scene's order; centres: those of the
    targets that are centres of pressure; force_n, cop_mm: how close a solved frame is to each, torques as forces at
    25 mm. Build with `PoseTargets.of`.
    """

    scene: Scene
    values: Mapping[str, Array]
    load_names: tuple[str, ...]
    centres: Mapping[str, CentreOfPressure]
    force_n: float = 1.0
    cop_mm: float = 0.1

    @classmethod
    def of(cls, scene: Scene, values: Mapping[str, Array]) -> PoseTargets:
        """Raises ValueError for a name that is neither a load of the scene nor a centre of pressure that it has, and
        for two names of one coordinate of the centre."""
        values = {name: np.atleast_1d(np.asarray(curve, dtype=float)) for name, curve in values.items()}
        centres: dict[str, CentreOfPressure] = {}
        needed: set[str] = set()
        for name in values:
            centre = centre_of_pressure(name, scene.normal_loads)
            if centre is None:
                needed.add(name)
                continue
            if same := [other for other, known in centres.items() if known.axis == centre.axis]:
                raise ValueError(f"got {same[0]} and {name}, expected one of them: they are the same coordinate")
            centres[name] = centre
            parts = [_summands(component, scene, values) for component in centre.made_of]
            if not all(parts):
                raise ValueError(
                    f"got {name} for scene {scene.name} with the loads {', '.join(scene.load_names)}, expected "
                    f"{' and '.join(centre.made_of)} among them: add them to its loads.names and tolerances"
                )
            needed |= {*parts[0], *parts[1]}
        if unknown := needed - set(scene.load_names):
            raise ValueError(f"unknown load {', '.join(sorted(unknown))}, expected {', '.join(scene.load_names)}")
        return cls(scene, values, tuple(name for name in scene.load_names if name in needed), centres)

    @property
    def tolerances(self) -> Array:
        """Largest error (targets,) of a solved frame [N, N·mm, mm]."""
        by_kind = {FORCE: self.force_n, TORQUE: self.force_n * LEVER_MM, LENGTH: self.cop_mm}
        return np.array([by_kind[quantity(name).kind] for name in self.values])

    @property
    def loaded(self) -> np.ndarray:
        """True (n,) where something presses: without load there is neither a centre of pressure nor a pose to find.

        Forces below a millionth of the scene's boundary load count as none. Where a normal load is not among the
        targets it may press in any frame: then torques tell too, and a centre of pressure may belong to it.
        """
        all_known = all(set(normal.loads) <= set(self.values) for normal in self.scene.normal_loads)
        lever = {FORCE: 1.0} if all_known else {FORCE: 1.0, TORQUE: LEVER_MM}
        kinds = {name: quantity(name).kind for name in self.values}
        sizes = [np.abs(self.values[name]) / lever[kind] for name, kind in kinds.items() if kind in lever]
        if not sizes or (self.centres and not all_known):
            return np.ones(len(next(iter(self.values.values()))), dtype=bool)
        return np.any(np.array(sizes) > 1e-6 * self.scene.boundary_load, axis=0)

    @property
    def pressing(self) -> dict[str, Array]:
        """Targets that normal loads are made of, of those that are targets with all their parts."""
        normals = [n for n in self.scene.controllable_normal_loads if set(n.loads) <= set(self.values)]
        return {name: self.values[name] for normal in normals for name in normal.loads}

    def evaluate(self, loads: Array) -> Array:
        """The targets' quantities (n, targets) at loads (n, L) of load_names; NaN for a centre without load."""
        return np.column_stack([self._quantity(name, loads) for name in self.values])

    def errors(self, loads: Array) -> Array:
        """What the loads give minus the targets (n, targets)."""
        return self.evaluate(loads) - np.column_stack(list(self.values.values()))

    def met(self, errors: Array) -> np.ndarray:
        """True (n,) where every error (n, targets) is within its tolerance; False without load."""
        return np.asarray((np.abs(errors) <= self.tolerances).all(axis=1) & self.loaded)

    def as_loads(self) -> dict[str, Array] | None:
        """The same as named loads alone, as `settle` takes them: T = ±c·F for each centre c; None where a centre's
        force is not a target itself."""
        loads = {name: curve for name, curve in self.values.items() if name not in self.centres}
        for name, centre in self.centres.items():
            if centre.torque not in self.scene.load_names or not set(self._summands(centre.force)) <= set(loads):
                return None
            loads[centre.torque] = centre.sign * self.values[name] * self._force(centre)
        return loads

    @property
    def settle_tolerance_n(self) -> Array:
        """Tolerance (n,) [N] to settle `as_loads` with, in decades, at most 0.01 N: so that centres of pressure end
        well within theirs under light loads too."""
        forces = [np.abs(self._force(centre)) for centre in self.centres.values()]
        least = np.min(forces, axis=0) if forces else np.full(len(self.loaded), np.inf)
        least = np.maximum(least, 1e-6 * self.scene.boundary_load)
        return np.asarray(10.0 ** np.floor(np.log10(np.minimum(least * self.cop_mm / LEVER_MM, 0.01))))

    def _force(self, centre: CentreOfPressure) -> Array:
        """Target force (n,) of a centre of pressure."""
        parts = self._summands(centre.force)
        return np.sum([self.values[part] for part in parts if part in self.values] or [np.zeros(len(self))], axis=0)

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def _quantity(self, name: str, loads: Array) -> Array:
        if name not in self.centres:
            return loads[:, self.load_names.index(name)]
        centre = self.centres[name]
        force, torque = (
            loads[:, [self.load_names.index(part) for part in self._summands(component)]].sum(axis=1)
            for component in centre.made_of
        )
        pressed = centre.pressing * force > 0.0
        return centre.sign * np.where(pressed, torque, np.nan) / np.where(pressed, force, np.nan)

    def _summands(self, component: str) -> tuple[str, ...]:
        return _summands(component, self.scene, self.values)


def _summands(component: str, scene: Scene, values: Mapping[str, Array]) -> tuple[str, ...]:
    """Loads of the scene that a component of the total wrench is the sum of, of the targets alone if they suffice."""
    targets = [name for name in scene.load_names if name in values]
    return loads_of_total(component, targets, scene.patch_names) or loads_of_total(
        component, scene.load_names, scene.patch_names
    )
