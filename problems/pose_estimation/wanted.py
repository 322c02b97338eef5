"""What is wanted of the contact in every frame, loads and centres of pressure by name, and how far a pose misses it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import LEVER_MM, Array, loads_of_total
from casadi_contact.core.quantities import FORCE, LENGTH, TORQUE, quantity
from casadi_contact.scenes.centre_of_pressure import CentreOfPressure, centre_of_pressure
from casadi_contact.scenes.scene import Scene

FORCE_TOLERANCE_N = 1.0
COP_TOLERANCE_MM = 0.1
ROUGHLY_N = 0.01  # how closely the search settles loads, torques over 25 mm; closer where they are light
_ROUNDED_ZERO = 1e-6  # of a scene's boundary load: less is zero, rounded
NO_LOAD = "no load: any pose out of contact carries it"  # why a frame is not `WantedLoads.loaded`
TOLERANCES = {FORCE: FORCE_TOLERANCE_N, TORQUE: FORCE_TOLERANCE_N * LEVER_MM, LENGTH: COP_TOLERANCE_MM}


@dataclass(frozen=True)
class WantedLoads:
    """values: wanted by name, each (n,); load_names: the named loads that they are made of, in the scene's order."""

    scene: Scene
    values: Mapping[str, Array]
    load_names: tuple[str, ...]
    centres: Mapping[str, CentreOfPressure]

    @classmethod
    def of(cls, scene: Scene, values: Mapping[str, Array]) -> WantedLoads:
        """Raises ValueError for a name that is neither a load of the scene nor a centre of pressure that it has, and
        for two names of one coordinate of it, which would count as two measurements."""
        centres: dict[str, CentreOfPressure] = {}
        needed: set[str] = set()
        for name in values:
            centre = centre_of_pressure(name, scene.normal_loads)
            if centre is None:
                needed.add(name)
                continue
            if twice := [other for other, known in centres.items() if known.axis == centre.axis]:
                raise ValueError(f"got {twice[0]} and {name}, which are the same coordinate: leave out one of them")
            centres[name] = centre
            parts = [_adding_up_to(component, scene, values) for component in centre.made_of]
            if not all(parts):
                made_of, has = " and ".join(centre.made_of), ", ".join(scene.load_names)
                raise ValueError(
                    f"{name} needs {made_of}, scene {scene.name} has {has}: add what is missing, in total or of every "
                    "patch, to its loads.names and tolerances"
                )
            needed |= {*parts[0], *parts[1]}
        unknown = needed - set(scene.load_names)
        if unknown:
            raise ValueError(
                f"scene {scene.name} has no load {', '.join(sorted(unknown))}, expected {', '.join(scene.load_names)}"
            )
        return cls(scene, dict(values), tuple(name for name in scene.load_names if name in needed), centres)

    @property
    def tolerances(self) -> Array:
        """How far off each may be in a frame that counts as solved [N, N·mm, mm]."""
        return np.array([TOLERANCES[quantity(name).kind] for name in self.values])

    @property
    def loaded(self) -> np.ndarray:
        """True (n,) where something presses: without load there is neither a centre of pressure nor a pose to find.

        A force below a millionth of the scene's boundary load is none. Where a normal load is not wanted it may press
        in any frame: then a torque tells too, and a centre of pressure may belong to it.
        """
        all_known = all(set(normal.loads) <= set(self.values) for normal in self.scene.normal_loads)
        lever = {FORCE: 1.0} if all_known else {FORCE: 1.0, TORQUE: LEVER_MM}
        kinds = {name: quantity(name).kind for name in self.values}
        sizes = [np.abs(self.values[name]) / lever[kind] for name, kind in kinds.items() if kind in lever]
        if not sizes or (self.centres and not all_known):
            return np.ones(len(next(iter(self.values.values()))), dtype=bool)
        return np.any(np.array(sizes) > _ROUNDED_ZERO * self.scene.boundary_load, axis=0)

    @property
    def pressing(self) -> dict[str, Array]:
        """The wanted loads that normal loads are made of, those that can be set one by one (`Scene.pressed`) and are
        wanted with all their parts."""
        normals = [n for n in self.scene.pressed if set(n.loads) <= set(self.values)]
        return {name: self.values[name] for normal in normals for name in normal.loads}

    def partly_pressing(self, rows: np.ndarray) -> dict[str, Array]:
        """The loads of the first patch's normal load in these rows, 0 for those that are not wanted."""
        zero = np.zeros(len(rows))
        return {
            name: self.values[name][rows] if name in self.values else zero for name in self.scene.normal_loads[0].loads
        }

    def got(self, loads: Array) -> Array:
        """The same quantities (n, wanted) of loads (n, L) as in load_names; NaN for a centre without load."""
        return np.column_stack([self._one(name, loads) for name in self.values])

    def errors(self, loads: Array) -> Array:
        """What is got minus what is wanted (n, wanted)."""
        return self.got(loads) - np.column_stack(list(self.values.values()))

    def carried(self, errors: Array) -> np.ndarray:
        """True (n,) where every error (n, wanted) is within its tolerance; False without load."""
        return np.asarray((np.abs(errors) <= self.tolerances).all(axis=1) & self.loaded)

    def targets(self) -> dict[str, Array] | None:
        """The same as named loads alone, as `settle` takes them; None where a centre's force is not wanted itself."""
        targets = {name: curve for name, curve in self.values.items() if name not in self.centres}
        for name, centre in self.centres.items():
            if centre.torque not in self.scene.load_names or not set(self._adding_up_to(centre.force)) <= set(targets):
                return None
            targets[centre.torque] = centre.sign * self.values[name] * self._force(centre)
        return targets

    @property
    def settled_n(self) -> Array:
        """How closely (n,) [N, torques over LEVER_MM] `targets` are to be settled, in decades: so that centres of
        pressure end well within their tolerance, at most `ROUGHLY_N`."""
        forces = [np.abs(self._force(centre)) for centre in self.centres.values()]
        least = np.min(forces, axis=0) if forces else np.full(len(self.loaded), np.inf)
        least = np.maximum(least, _ROUNDED_ZERO * self.scene.boundary_load)
        closely = np.minimum(least * COP_TOLERANCE_MM / LEVER_MM, ROUGHLY_N)
        return np.asarray(10.0 ** np.floor(np.log10(closely)))

    def _force(self, centre: CentreOfPressure) -> Array:
        """The wanted force (n,) of a centre of pressure."""
        zero = np.zeros(len(next(iter(self.values.values()))))
        return np.asarray(sum((self.values.get(part, zero) for part in self._adding_up_to(centre.force)), zero))

    def _one(self, name: str, loads: Array) -> Array:
        if name not in self.centres:
            return loads[:, self.load_names.index(name)]
        centre = self.centres[name]
        force, torque = (self._total(component, loads) for component in centre.made_of)
        pressed = centre.pressing * force > 0.0
        return centre.sign * np.where(pressed, torque, np.nan) / np.where(pressed, force, np.nan)

    def _total(self, component: str, loads: Array) -> Array:
        columns = [self.load_names.index(name) for name in self._adding_up_to(component)]
        return np.asarray(loads[:, columns].sum(axis=1))

    def _adding_up_to(self, component: str) -> tuple[str, ...]:
        return _adding_up_to(component, self.scene, self.values)


def _adding_up_to(component: str, scene: Scene, values: Mapping[str, Array]) -> tuple[str, ...]:
    """The loads of the scene that a component of the total wrench is the sum of (`loads_of_total`), of these values
    alone where they are enough."""
    wanted = [name for name in scene.load_names if name in values]
    return loads_of_total(component, wanted, scene.patch_names) or loads_of_total(
        component, scene.load_names, scene.patch_names
    )


def off_by(names: Mapping[str, Array], errors: Array) -> str:
    """Errors (wanted,) of one frame in words, the largest of each kind."""
    words = []
    for kind, what in ((FORCE, "forces off by"), (TORQUE, "torques by"), (LENGTH, "centre of pressure by")):
        of_kind = [abs(error) for name, error in zip(names, errors, strict=True) if quantity(name).kind == kind]
        if of_kind:
            words.append(f"{what} {max(of_kind):.3g} {kind.unit}")
    return ", ".join(words)
