"""The element grids of a scene, by a convergence test: they belong to its geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.scenes.scene import Scene

CANDIDATES = (
    *((20, 20), (20, 40), (40, 20), (40, 40), (40, 80), (80, 40), (80, 80)),
    *((80, 160), (160, 80), (160, 160), (160, 240), (240, 160)),
)
CONVERGED = (320, 320)
_MOST_TO_SETTLE = 80 * 80  # elements: thousands of poses are to be found
_SHARES = {"fine": 1.0, "settle": 2.0, "coarse": 8.0}  # of the tolerances that each may be wrong by


@dataclass(frozen=True)
class Convergence:
    """grids: elements by purpose. errors: RMS of every candidate's worst load, as share of its tolerance, against
    `CONVERGED`. enough: False where no candidate meets the tolerances."""

    grids: dict[str, list[int]]
    errors: dict[tuple[int, int], float]
    enough: bool

    def __str__(self) -> str:
        nx, nz = self.grids["fine"]
        share = self.errors[nx, nz]
        return f"{nx}×{nz} elements a patch are {share:.2g} tolerances (RMS) off {CONVERGED[0]}×{CONVERGED[1]}"


def converged_grids(scene: Scene, poses: Array) -> Convergence:
    """The fewest elements, and which way they lie closer, whose loads at these poses (n, 6) are within tolerance."""
    tolerances = scene.tolerances_of()
    truth = ElasticFoundation(scene, CONVERGED)(poses)
    errors: dict[tuple[int, int], float] = {}
    for grid in CANDIDATES:
        off = ElasticFoundation(scene, grid)(poses) - truth
        errors[grid] = float((np.sqrt(np.mean(off**2, axis=0)) / tolerances).max())
        if errors[grid] < 0.5 * _SHARES["fine"] and grid[0] == grid[1]:
            break
    found = {}
    for purpose, share in _SHARES.items():
        tried = [grid for grid in errors if purpose == "fine" or grid[0] * grid[1] <= _MOST_TO_SETTLE]
        good = [grid for grid in tried if errors[grid] <= share] or [min(tried, key=lambda grid: errors[grid])]
        nx, nz = min(good, key=lambda grid: (grid[0] * grid[1], errors[grid]))
        found[purpose] = [nx, nz]
    found["teacher"] = [min(2 * n, 320) for n in found["fine"]]
    return Convergence(found, errors, any(error <= 1.0 for error in errors.values()))
