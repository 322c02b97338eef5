"""Pressure outputs with derivatives, from integrals over the contact region.

Of each patch a model gives the *moments* m = (∫dA, ∫p dA, ∫p·c dA (3), d_max) over its region of contact, with their
derivatives by the pose; area, mean, centre of pressure and the peak p(d_max) are functions of these. The largest depth
of one smooth spot is itself a smooth function of the pose (its derivative is that of the depth at the deepest point,
which may slide): no maximum has to be rounded off.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable

import casadi as ca
import numpy as np

from casadi_contact.contact.callback import contact_callback
from casadi_contact.contact.pressure.law import law_of, pressure_slopes
from casadi_contact.contact.pressure.summary import MEASURES, PressureSummary, pressure_name
from casadi_contact.core.conventions import Array, as_poses, pose_or_poses
from casadi_contact.scenes.scene import Scene

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
        """contact_area_med, mean_pressure_med, ... patch by patch; without the patch where there is but one."""
        return tuple(pressure_name(m, p, self.patch_names) for p in self.patch_names for m in MEASURES)

    @pose_or_poses
    def pressures(self, poses: Array, names: Iterable[str] | None = None) -> tuple[Array, Array]:
        """Outputs (n, m) by name (all of `pressure_names` if left out) [mm², MPa, mm] and d/dpose (n, m, 6).

        Without contact all are zero, but a centre of pressure is NaN. Raises ValueError for an unknown name.
        """
        values, slopes = self._outputs(poses)
        columns = [self.pressure_names.index(name) for name in self._checked(names)]
        return values[:, columns], slopes[:, columns]

    def summary(self, poses: Array) -> PressureSummary:
        """Areas, pressures, centres of pressure and penetrations of each patch at poses (n, 6)."""
        poses = as_poses(poses)
        values = self._outputs(poses)[0].reshape(len(poses), len(self.patch_names), len(MEASURES))
        area, mean, largest, deepest = (values[..., k] for k in (0, 1, 2, 6))
        return PressureSummary(area, mean, largest, deepest, values[..., 3:6])

    def pressure_function(self, names: Iterable[str] | None = None, name: str = "contact_pressures") -> ca.Function:
        """casadi.Function pose (6) -> the named outputs (m), with its Jacobian; Hessians are differences of it.

        Raises ValueError for an unknown name.
        """
        wanted = self._checked(names)
        return contact_callback(name, [("pressures", len(wanted), lambda poses: self.pressures(poses, wanted))])

    def _checked(self, names: Iterable[str] | None) -> tuple[str, ...]:
        known = self.pressure_names
        wanted = known if names is None else tuple([names] if isinstance(names, str) else names)
        if not wanted or any(name not in known for name in wanted):
            raise ValueError(f"pressures {', '.join(wanted) or '(none)'}, expected some of {', '.join(known)}")
        return wanted

    def _outputs(self, poses: Array) -> tuple[Array, Array]:
        """All outputs (n, P·7) and their derivatives by the pose (n, P·7, 6)."""
        m, dm = self.pressure_moments(poses)
        peak, rise = pressure_slopes(*law_of(self.scene.material), m[..., 5])
        loaded = m[..., 1] > 0.0
        area, force = np.where(loaded, m[..., 0], 1.0), np.where(loaded, m[..., 1], np.nan)
        mean, centre = np.where(loaded, m[..., 1] / area, 0.0), m[..., 2:5] / force[..., None]
        values = np.concatenate([np.stack([m[..., 0], mean, peak], -1), centre, m[..., 5:]], -1)
        of_mean = (dm[..., 1, :] - mean[..., None] * dm[..., 0, :]) / area[..., None]
        of_centre = (dm[..., 2:5, :] - centre[..., None] * dm[..., 1:2, :]) / force[..., None, None]
        of_peak = rise[..., None] * dm[..., 5, :]
        slopes = np.concatenate([np.stack([dm[..., 0, :], of_mean, of_peak], -2), of_centre, dm[..., 5:, :]], -2)
        shape = (len(poses), len(self.pressure_names))  # no -1: there may be no poses
        return values.reshape(shape), slopes.reshape(*shape, 6)
