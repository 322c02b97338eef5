"""Pressure over the fixed surface: of elements, and as outputs of a contact model."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from casadi_contact.contact.pressure_law import law_of, pressure_derivatives
from casadi_contact.contact.symbolic import contact_callback
from casadi_contact.core.conventions import Array, as_poses, batched
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class PressureMap:
    """One patch: centres_mm (m, 3), areas_mm2 (m,) and pressures_mpa (m,) of its elements, fixed frame."""

    patch: str
    centres_mm: Array
    areas_mm2: Array
    pressures_mpa: Array

    @property
    def forces_n(self) -> Array:
        """p·A (m,) of each element [N]."""
        return self.pressures_mpa * self.areas_mm2

    @property
    def centre_mm(self) -> Array | None:
        """Centre of pressure Σ p·A·c / Σ p·A (3,), None out of contact."""
        force = self.forces_n
        return np.asarray(force @ self.centres_mm / force.sum()) if force.any() else None


MEASURES = ("contact_area", "mean_pressure", "peak_pressure", "cop_x", "cop_y", "cop_z", "penetration")


Pressed = tuple[int, int, Array, Array, Array, Array]
"""Pose, patch, and of its elements centres (m, 3) [mm], areas (m,) [mm²], depths (m,) [mm] and pressures (m,) [MPa]."""


@dataclass(frozen=True)
class PressureSummary:
    """Contact of each patch in each pose, all (n, patches, ...), zero where there is none (centre: NaN).

    area_mm2 in contact; mean_mpa over this area; largest_mpa; penetration_mm: the largest depth along a normal of the
    fixed surface; centre_mm (..., 3): ∫p·c dA / ∫p dA in the fixed frame.
    """

    area_mm2: Array
    mean_mpa: Array
    largest_mpa: Array
    penetration_mm: Array
    centre_mm: Array

    @classmethod
    def of_elements(
        cls, shape: tuple[int, int], pressed: Iterable[Pressed], *, counted_alike: bool = False
    ) -> PressureSummary:
        """Of elements' loads in poses × patches; counted_alike: the mean counts each element in contact once."""
        area, mean, largest, deepest = (np.zeros(shape) for _ in range(4))
        centre = np.full((*shape, 3), np.nan)
        for pose, patch, centres_mm, areas_mm2, depths_mm, pressures_mpa in pressed:
            loaded = pressures_mpa > 0.0
            if not loaded.any():
                continue
            here, force = (pose, patch), pressures_mpa * areas_mm2
            area[here] = areas_mm2[loaded].sum()
            mean[here] = pressures_mpa[loaded].mean() if counted_alike else force.sum() / area[here]
            largest[here], deepest[here] = pressures_mpa.max(), depths_mm[loaded].max()
            centre[here] = force @ centres_mm / force.sum()
        return cls(area, mean, largest, deepest, centre)


MOMENTS = 6


class PressureOutputs(ABC):
    """What a contact model with pressure moments gives besides its loads."""

    scene: Scene
    patch_names: tuple[str, ...]

    @abstractmethod
    def pressure_moments(self, poses: Array) -> tuple[Array, Array]:
        """Moments (n, P, 6) [mm², N, N·mm (3), mm] and their derivatives by the pose (n, P, 6, 6), at poses (n, 6)."""

    @property
    def pressure_names(self) -> tuple[str, ...]:
        """contact_area_med, mean_pressure_med, ... patch by patch (one: without it); none where thickness varies."""
        if self.scene.varies:
            return ()
        single = len(self.patch_names) == 1
        return tuple(m if single else f"{m}_{p}" for p in self.patch_names for m in MEASURES)

    @batched
    def pressures(self, poses: Array, names: Iterable[str] | None = None) -> tuple[Array, Array]:
        """Outputs (n, m) by name (all of `pressure_names` if left out) [mm², MPa, mm] and d/dpose (n, m, 6).

        Without contact all are zero, but a centre of pressure is NaN. Raises ValueError for an unknown name.
        """
        values, jacobian = self._outputs(poses)
        columns = [self.pressure_names.index(name) for name in self._checked(names)]
        return values[:, columns], jacobian[:, columns]

    def summary(self, poses: Array) -> PressureSummary:
        """Areas, pressures, centres of pressure and penetrations of each patch at poses (n, 6)."""
        poses = as_poses(poses)
        values = self._outputs(poses)[0].reshape(len(poses), len(self.patch_names), len(MEASURES))
        area, mean, largest, deepest = (values[..., k] for k in (0, 1, 2, 6))
        return PressureSummary(area, mean, largest, deepest, values[..., 3:6])

    def pressure_function(self, names: Iterable[str] | None = None, name: str = "contact_pressures") -> ca.Function:
        """casadi.Function pose (6) -> the named outputs (m), with its Jacobian; Hessians are differences of it.

        Without parameters: a centre out of contact is NaN, which a product with a placement would spread to outputs in
        contact. Material is a factor K(E, ν)/h of mean and peak alone; a placed fixed body is met at the relative pose.
        """
        chosen = self._checked(names)
        return contact_callback(name, [("pressures", len(chosen), partial(self.pressures, names=chosen))])

    def _checked(self, names: Iterable[str] | None) -> tuple[str, ...]:
        known = self.pressure_names
        chosen = known if names is None else tuple([names] if isinstance(names, str) else names)
        if not chosen or any(name not in known for name in chosen):
            raise ValueError(f"pressures {', '.join(chosen) or '(none)'}, expected some of {', '.join(known)}")
        return chosen

    def _outputs(self, poses: Array) -> tuple[Array, Array]:
        """All outputs (n, P·7) and their derivatives by the pose (n, P·7, 6)."""
        m, dm = self.pressure_moments(poses)
        peak, rise = pressure_derivatives(*law_of(self.scene.material), m[..., 5])
        loaded = m[..., 1] > 0.0
        area, force = np.where(loaded, m[..., 0], 1.0), np.where(loaded, m[..., 1], np.nan)
        mean, centre = np.where(loaded, m[..., 1] / area, 0.0), m[..., 2:5] / force[..., None]
        values = np.concatenate([np.stack([m[..., 0], mean, peak], -1), centre, m[..., 5:]], -1)
        of_mean = (dm[..., 1, :] - mean[..., None] * dm[..., 0, :]) / area[..., None]
        of_centre = (dm[..., 2:5, :] - centre[..., None] * dm[..., 1:2, :]) / force[..., None, None]
        of_peak = rise[..., None] * dm[..., 5, :]
        jacobian = np.concatenate([np.stack([dm[..., 0, :], of_mean, of_peak], -2), of_centre, dm[..., 5:, :]], -2)
        shape = (len(poses), len(self.pressure_names))  # no -1: there may be no poses
        return values.reshape(shape), jacobian.reshape(*shape, 6)
