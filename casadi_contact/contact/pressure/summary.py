"""Contact area, pressures, centre of pressure and penetration of each patch: what contact models say beside loads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from casadi_contact.core.conventions import Array

MEASURES = ("contact_area", "mean_pressure", "peak_pressure", "cop_x", "cop_y", "cop_z", "penetration")


class PressedElements(NamedTuple):
    """Elements (m,) of one patch in one pose: centres (m, 3) [mm], areas [mm²], depths [mm] and pressures [MPa]."""

    pose: int
    patch: int
    centres_mm: Array
    areas_mm2: Array
    depths_mm: Array
    pressures_mpa: Array


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
        cls, shape: tuple[int, int], pressed: Iterable[PressedElements], *, counted_alike: bool = False
    ) -> PressureSummary:
        """Of elements' loads in poses × patches; counted_alike: the mean counts each element in contact once."""
        area, mean, largest, deepest = (np.zeros(shape) for _ in range(4))
        centre = np.full((*shape, 3), np.nan)
        for at in pressed:
            loaded = at.pressures_mpa > 0.0
            if not loaded.any():
                continue
            here, force = (at.pose, at.patch), at.pressures_mpa * at.areas_mm2
            area[here] = at.areas_mm2[loaded].sum()
            mean[here] = at.pressures_mpa[loaded].mean() if counted_alike else force.sum() / area[here]
            largest[here], deepest[here] = at.pressures_mpa.max(), at.depths_mm[loaded].max()
            centre[here] = force @ at.centres_mm / force.sum()
        return cls(area, mean, largest, deepest, centre)

    def named(self, patch_names: Sequence[str]) -> dict[str, Array]:
        """Each quantity (n,) by its name (`quantities`): contact_area_med, ..., penetration_lat."""
        values = [self.area_mm2, self.mean_mpa, self.largest_mpa, *np.moveaxis(self.centre_mm, -1, 0)]
        values.append(self.penetration_mm)
        return {
            pressure_name(measure, patch, patch_names): value[:, p]
            for p, patch in enumerate(patch_names)
            for measure, value in zip(MEASURES, values, strict=True)
        }


def pressure_name(measure: str, patch: str, patch_names: Sequence[str]) -> str:
    """peak_pressure_med; without the patch where there is but one."""
    return measure if len(patch_names) == 1 else f"{measure}_{patch}"
